"""Values given from outside: parameters by path, from the command line or from Python.

In: paths with numbers or (nested) lists of them, in the declared units. Problems have no place: there is no text to point into.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from math import prod

import numpy as np

from hierc.compiler import model
from hierc.compiler.arrays.columns import expanded
from hierc.compiler.arrays.elements import plain
from hierc.compiler.arrays.errors import CountsDiffer, EmptyArray, NotAnArray, OutOfArray, StructuralElement
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.expression import Number
from hierc.compiler.resolve.errors import UnknownParameter
from hierc.compiler.shapes.values import Scalar, Shape, Value, type_text
from hierc.compiler.structure.errors import WrongValue
from hierc.compiler.suggest import did_you_mean_without, without_level
from hierc.grammar.problems import closest

#: Values by path. `object`, because they are checked here.
Given = Mapping[str, object]


def outside_value(path: str, value: object, scalar: Scalar, shape: Shape, scale: float) -> Value:
    """`value` as a parameter of this type, in SI; `scale` is one of its declared unit. Raises Rejected (E911) if it does not fit."""
    found_shape, numbers = _flattened(value)
    wrong = found_shape != shape or numbers is None
    if numbers is None or wrong or not all(_fits(n, scalar, scale) for n in numbers):
        raise Rejected(
            WrongValue(None, name=path, wanted=f"`{type_text(scalar, shape)}`", given=f"`{value}`")
        )
    return Value(scalar, shape, tuple(Number(None, float(n) * scale) for n in numbers))


def _flattened(value: object) -> tuple[Shape, list[float] | None]:
    """The shape of a number or of nested lists, and its numbers row by row; None where the rows differ or something is no number."""
    if hasattr(value, "tolist"):
        value = value.tolist()  # an array
    if isinstance(value, bool | int | float):
        return (), [value] if abs(value) < float("inf") and abs(value) < 10**300 else None
    if not isinstance(value, Sequence) or isinstance(value, str):
        return (), None
    rows = [_flattened(item) for item in value]
    if not rows or any(shape != rows[0][0] for shape, _ in rows):
        return (), None
    numbers: list[float] = []
    for _, row in rows:
        if row is None:
            return (), None
        numbers += row
    return (len(rows), *rows[0][0]), numbers


def _fits(value: float, scalar: Scalar, scale: float) -> bool:
    if not abs(value * scale) < float("inf"):
        return False
    return (
        scalar == "real"
        or (scalar == "int" and value == int(value))
        or (scalar == "bool" and value in (0, 1))
    )


def check_given(parameters: Iterable[model.Parameter], given: Given) -> None:
    """Check names, types and shapes of values from outside. Raises ModelError with all that is wrong.

    In an array of agents `car.tau` means all of them, `car[3].tau` one, `car[2..5].tau` some: one value for all, or a value for each in a list, which
    for arrays in arrays is one of lists.
    """
    problems = Collector()
    known: dict[str, list[model.Parameter]] = {}
    for parameter in parameters:
        known.setdefault(plain(parameter.path), []).append(parameter)
    for path, value in given.items():
        whole = _SUBSCRIPT.sub(".", path)
        blocks = known.get(whole)
        try:
            if blocks is None or (whole != path and not blocks[0].indices):
                firsts = {name: entries[0] for name, entries in known.items()}
                advice = _advice(path, firsts) or _for_elements(path, whole, tuple(known))
                raise Rejected(
                    UnknownParameter(None, agent=None, name=path, candidates=tuple(known), advice=advice)
                )
            _check_value(path, value, blocks, _elements(path, blocks))
        except Rejected as rejection:
            problems.rejected(rejection)
    problems.stop_on_errors()


def _for_elements(path: str, whole: str, known: Sequence[str]) -> str | None:
    """What a misspelt name of elements of an array may have meant, of the same elements."""
    if whole in known:
        return f"did you mean `{whole}`?"  # a subscript after a single agent
    close = closest(whole, known)
    if close is None or close.rpartition(".")[0] != whole.rpartition(".")[0]:
        return None
    owner = path.rpartition(".")[0]
    return f"did you mean `{owner}.{close.rpartition('.')[2]}`?" if "[" in owner else None


#: The subscript of an array of agents in a path.
_SUBSCRIPT = re.compile(r"\[([0-9]+)(?:\.\.([0-9]+))?\]\.")


def _elements(path: str, blocks: Sequence[model.Parameter]) -> Shape:
    """How many elements a path means of each array in which it means several; nothing where these differ in size. Raises Rejected (E801) for one that
    is not there.
    """
    template = blocks[0].path.split(".")
    arrays = [place for place, name in enumerate(template) if name.endswith("[]")]
    columns = [np.concatenate([expanded(b.indices[k], b.count) for b in blocks]) for k in range(len(arrays))]
    chosen = np.ones(len(columns[0]) if columns else 1, np.bool_)
    names = path.replace("..", "\0").split(".")
    single = next((k for k, name in enumerate(names[:-1]) if "[" in name and k not in arrays), None)
    if single is not None:
        raise Rejected(NotAnArray(None, name=names[single].partition("[")[0], arrays=()))
    several: list[int] = []
    for place, column in zip(arrays, columns, strict=True):
        match = _SUBSCRIPT.search(names[place].replace("\0", "..") + ".")
        if match is None:
            several.append(len(np.unique(column[chosen])))
            continue
        if blocks[0].structural:
            raise Rejected(StructuralElement(None, name=template[-1], path=_SUBSCRIPT.sub(".", path)))
        ends = [int(match[1]), int(match[2] or match[1])]
        first, last = int(column.min()), int(column.max())
        if ends[1] < ends[0]:
            raise Rejected(EmptyArray(None, name=names[place].partition("[")[0], first=ends[0], last=ends[1]))
        outside = next((end for end in ends if not first <= end <= last), None)
        if outside is not None:
            raise Rejected(
                OutOfArray(None, text=path, index=outside, first=first, last=last, where=(), index_name=None)
            )
        chosen &= (column >= ends[0]) & (column <= ends[1])
        several += [ends[1] - ends[0] + 1] if ends[0] < ends[1] else []
    return tuple(several) if prod(several) == chosen.sum() else ()


def _check_value(path: str, value: object, blocks: Sequence[model.Parameter], several: Shape) -> None:
    """Check a value for elements of arrays, so many of each, which may be one for each of them. Raises Rejected (E911, E802)."""
    block = blocks[0]
    shape, _ = _flattened(value)
    each = several and len(shape) == len(several) + len(block.shape) and shape[len(several) :] == block.shape
    for wanted, given in zip(several, shape, strict=False) if each else ():
        if given != wanted:
            raise Rejected(CountsDiffer(None, text=path, wanted=wanted, given=given))
    outside_value(path, value, block.scalar, shape if each else block.shape, block.scale)


def _advice(path: str, known: Mapping[str, model.Parameter]) -> str | None:
    """What to give instead of one element of a vector, or by a path that goes through a level."""
    whole = known.get(path.partition("[")[0].strip())
    if whole is not None and whole.shape:
        kind, value = ("vector", "[…]") if len(whole.shape) == 1 else ("matrix", "[[…], …]")
        return f"give the whole {kind}: `{whole.path}={value}`"
    shorter = without_level(path, known)
    return did_you_mean_without(shorter) if shorter is not None else None
