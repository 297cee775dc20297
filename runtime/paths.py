"""Names of parameters, variables and groups, with the indices of agents in arrays: `arm.q`, `car[3].x`, `car[2..5].x`, `car.x` for all cars.

In: the entries of a table, each with its path, `car[].x`, and the indices of its elements. Out: `Selection`: which elements a name means, and in
what shape. An array that a name gives no index stands for all of its elements.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct
from hierc.runtime.contract import Index
from hierc.runtime.elements import index_table, numbered

Integers = NDArray[np.int64]
#: A table's entry: its path, how many elements it has, and for each `[]` of the path their indices.
Entry = tuple[str, int, Sequence[Index]]
#: (least, greatest) index that a name gives, equal for a single one; None: all.
Wanted = tuple[int, int] | None

_STEP = re.compile(r"([^.\[\]]+)(?:\[([^\[\]]*)\])?(?:\.(?=.)|$)")
_SUBSCRIPT = re.compile(r"\s*(\d+)\s*(?:\.\.\s*(\d+)\s*)?")


class PathError(LookupError):
    """A name that means nothing; the message says why, and what is near."""


class NoShape(PathError):
    """A name of elements in arrays that differ in size, or whose values differ in shape."""


@dataclass(frozen=True)
class Named:
    """Everything of one name: `car[].x` of all cars, though several entries of the table make it.

    `entry` and `row` (count,) say where each element stands, `indices` (count, levels) what its name's indices are, in ascending order.
    """

    path: str
    entry: Integers
    row: Integers
    indices: Integers

    @property
    def plain(self) -> str:
        """The path without indices, which stands for all elements."""
        return self.path.replace("[]", "")

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.entry)

    def name(self, k: int) -> str:
        """The name of element k."""
        return numbered(self.path, self.indices[k].tolist())

    def names(self, chosen: Integers) -> list[str]:
        """The names of some elements."""
        first, *rest = self.path.split("[]")
        if not rest:
            return [first] * len(chosen)
        columns = self.indices[chosen].T.tolist()
        texts = [[f"[{i}]{text}" for i in column] for column, text in zip(columns, rest, strict=True)]
        return [first + "".join(parts) for parts in zip(*texts, strict=True)]

    @cached_property
    def shown(self) -> str:
        """The path with the ranges of its indices: `car[1..100].x`."""
        return _with_ranges(self.path, self.indices)


@dataclass(frozen=True)
class Selection:
    """Some elements of a name: `chosen` of `named`, row by row in the shape `shape` (none for a single element).

    `name` is how it was asked for, without `subscripts`, which choose a scalar of each element.
    """

    named: Named
    name: str
    chosen: Integers
    shape: tuple[int, ...]
    subscripts: tuple[int, ...] | None = None

    @cached_property
    def names(self) -> list[str]:
        """The full name of each element."""
        return self.named.names(self.chosen)

    @property
    def shown(self) -> str:
        """The path with the ranges of the indices of these elements."""
        return _with_ranges(self.named.path, self.named.indices[self.chosen])


def _with_ranges(path: str, indices: Integers) -> str:
    first, *rest = path.split("[]")
    low, high = indices.min(axis=0, initial=2**62), indices.max(axis=0, initial=0)
    ranges = [f"[{a}..{b}]" if a < b else f"[{a}]" for a, b in zip(low, high, strict=True)]
    return first + "".join(r + text for r, text in zip(ranges, rest, strict=True))


class Catalogue:
    """The names of one table. `missing` is how a message about a name that is not there begins, `unknown variable`.

    `shapes`: those of the entries, where a name may only mean elements of one shape.
    """

    def __init__(
        self, missing: str, entries: Sequence[Entry], shapes: Sequence[tuple[int, ...]] | None = None
    ) -> None:
        self.missing, self._entries, self._shapes = missing, entries, shapes
        self._places: dict[str, list[int]] = {}
        for k, entry in enumerate(entries):
            self._places.setdefault(entry[0].replace("[]", ""), []).append(k)
        self._made: dict[str, Named] = {}
        self._found: dict[str, Selection] = {}

    @property
    def plain(self) -> Sequence[str]:
        """All names, without indices, in the order of the table."""
        return tuple(self._places)

    def entries(self, plain: str) -> list[int]:
        """The numbers of the entries that make a name."""
        return self._places[plain]

    def named(self, plain: str) -> Named:
        """Everything of one name, which is in the table."""
        if plain not in self._made:
            self._made[plain] = self._name(self._places[plain])
        return self._made[plain]

    def _name(self, places: list[int]) -> Named:
        entries = [self._entries[k] for k in places]
        counts = [count for _, count, _ in entries]
        indices = np.concatenate([index_table(columns, count) for _, count, columns in entries])
        entry = np.repeat(places, counts)
        row = np.concatenate([np.arange(count) for count in counts])
        order = np.lexsort(indices.T[::-1]) if indices.shape[1] else np.arange(len(entry))
        return Named(entries[0][0], entry[order], row[order], indices[order])

    def find(self, name: str) -> Selection:
        """What a name means. Raises PathError."""
        if name not in self._found:
            self._found[name] = self._find(name)
        return self._found[name]

    def _find(self, name: str) -> Selection:
        if name in self._places and not self._entries[self._places[name][0]][2]:
            return Selection(self.named(name), name, np.arange(1), ())
        steps = _steps(name)
        plain = ".".join(step for step, _ in steps)
        if not steps or plain not in self._places:
            close = _close(plain or name, self._places, lambda p: self.named(p).shown)
            raise PathError(f"{self.missing} `{name}`{close}")
        named = self.named(plain)
        wanted: list[Wanted] = []
        subscripts: tuple[int, ...] | None = None
        for k, ((step, text), own) in enumerate(zip(steps, named.path.split("."), strict=True)):
            given = _subscripts(text, name)
            if own.endswith("[]"):
                wanted.append(given[0] if given else None)
                given = given[1:]
            if given and (k + 1 < len(steps) or any(low != high for low, high in given)):
                raise PathError(f"{self.missing} `{name}`: `{step}` is no array of agents")
            if given:
                subscripts = tuple(low for low, _ in given)
        asked = ".".join(
            _step(step, text, own) for (step, text), own in zip(steps, named.path.split("."), strict=True)
        )
        selection = _select(named, asked, wanted, subscripts)
        entries = distinct(named.entry[selection.chosen]).tolist()
        if self._shapes is not None and len({self._shapes[k] for k in entries}) > 1:
            raise NoShape(f"`{asked}` has no shape: its elements differ in it; give more indices")
        return selection

    def regular(self, name: str) -> list[str]:
        """The name, or where its arrays differ in size, names with more indices that have a shape. Raises PathError."""
        try:
            self.find(name)
        except NoShape:
            return [name for part in self._parts(name) for name in self.regular(part)]
        return [name]

    def _parts(self, name: str) -> list[str]:
        """A name with each of the indices that it leaves open in the outermost array where it leaves any."""
        steps = _steps(name)
        texts = [f"{step}[{text}]" if text else step for step, text in steps]
        named = self.named(".".join(step for step, _ in steps))
        chosen, level = np.arange(named.count), 0
        for place, own in enumerate(named.path.split(".")):
            if not own.endswith("[]"):
                continue
            step, text = steps[place]
            column = named.indices[chosen, level]
            low, high = _subscripts(text, name)[0] if text else (column.min(), column.max())
            chosen = chosen[(column >= low) & (column <= high)]
            if low < high:
                found = distinct(named.indices[chosen, level]).tolist()
                return [".".join((*texts[:place], f"{step}[{i}]", *texts[place + 1 :])) for i in found]
            level += 1
        raise ValueError(f"`{name}` leaves no index open")

    def below(self, name: str) -> list[str]:
        """The names, with the indices that `name` gives, of everything within an agent: of `car[3]`, `car[3].x` and so on. Raises PathError."""
        steps = _steps(name)
        plain = "".join(f"{step}." for step, _ in steps)
        texts = [f"{step}[{text}]" if text else step for step, text in steps]
        found = [p for p in self._places if p.startswith(plain)]
        if not steps or not found:
            owners = dict.fromkeys(p.rpartition(".")[0] for p in self._places)
            raise PathError(f"nothing in `{name}`{_close(plain[:-1], filter(None, owners))}")
        return [".".join([*texts, p.removeprefix(plain)]) for p in found]


def _close(name: str, known: Iterable[str], shown: Callable[[str], str] = str) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean `{shown(close[0])}`?" if close else ""


def _steps(name: str) -> list[tuple[str, str | None]]:
    """The steps of a path with their subscripts; none where it is no path."""
    found: list[tuple[str, str | None]] = []
    at = 0
    while at < len(name):
        match = _STEP.match(name, at)
        if match is None:
            return []
        found.append((match[1], match[2]))
        at = match.end()
    return found


def _step(step: str, text: str | None, own: str) -> str:
    return f"{step}[{text.partition(',')[0].replace(' ', '')}]" if text and own.endswith("[]") else step


def _subscripts(text: str | None, name: str) -> list[tuple[int, int]]:
    """The (least, greatest) of each subscript."""
    if text is None:
        return []
    found = []
    for part in text.split(","):
        match = _SUBSCRIPT.fullmatch(part)
        if match is None:
            raise PathError(
                f"`{name}`: a subscript is a number or a range such as 2..5, not `{part.strip()}`"
            )
        low = int(match[1])
        found.append((low, int(match[2]) if match[2] else low))
    return found


def _select(
    named: Named, asked: str, wanted: Sequence[Wanted], subscripts: tuple[int, ...] | None
) -> Selection:
    chosen = np.arange(named.count)
    shape: list[int] = []
    for level, range_ in enumerate(wanted):
        column = named.indices[chosen, level]
        if range_ is not None:
            chosen = chosen[_within(named, asked, level, column, range_)]
        if range_ is None or range_[0] < range_[1]:
            shape.append(len(distinct(named.indices[chosen, level])))
    if int(np.prod(shape)) != len(chosen):
        raise NoShape(f"`{asked}` has no shape: its arrays differ in size; give more indices")
    return Selection(named, asked, chosen, tuple(shape), subscripts)


def _within(
    named: Named, asked: str, level: int, column: Integers, wanted: tuple[int, int]
) -> NDArray[np.bool_]:
    low, high = wanted
    if low > high:
        raise PathError(f"`{asked}`: the range {low}..{high} is empty")
    for index in (low, high):
        if index not in column:
            array = "[]".join(named.path.split("[]")[: level + 1])
            raise PathError(
                f"no `{asked}`: `{array.replace('[]', '')}` goes from {column.min()} to {column.max()}"
            )
    return np.asarray((column >= low) & (column <= high))
