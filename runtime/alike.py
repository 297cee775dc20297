"""Groups of one family looked at together: where a group has an element, the family has a column, the elements of all its groups.

In: `Elements` and the places of some groups. Out: columns of elements, by number, and what they read. Guaranteed: whatever decides about code is the same
down a column; where it is not, `Differ` is raised, and `divided` goes on with those groups apart that agree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct
from hierc.runtime.contract import Class
from hierc.runtime.elements import Block, Elements, order_parts, part_of

Integers = NDArray[np.int64]
Made = TypeVar("Made")


class Differ(Exception):
    """Groups of a family differ in what must be equal; `labels` tell them apart."""

    def __init__(self, labels: Integers) -> None:
        self.labels = labels


def same(column: Integers) -> int:
    """What all of a column's groups have. Raises Differ."""
    if len(column) > 1 and (column != column[0]).any():
        raise Differ(column)
    return int(column[0])


def divided(count: int, make: Callable[[Integers], Made]) -> Iterator[Made]:
    """What is made of `count` groups, by their rows: of all together, or where they differ of those that agree."""
    pending = [np.arange(count)]
    while pending:
        rows = pending.pop()
        try:
            yield make(rows)
        except Differ as differ:
            pending += [rows[differ.labels == label] for label in distinct(differ.labels)[::-1]]


def inputs_of(kind: Class, part: int) -> Sequence[int]:
    """The inputs that one part of a class (-1: its right-hand side) may read."""
    return range(kind.inputs) if part < 0 else kind.parts[part].inputs


@dataclass(frozen=True, slots=True)
class Read:
    """A source of a column: a column of elements, by its number, what is read of them, and which."""

    node: int
    what: str
    index: Integers


class Nodes:
    """Columns of elements of the groups at `places`, numbered as they are met; equal ones are one."""

    def __init__(self, elements: Elements, places: Integers) -> None:
        self.elements, self.places = elements, places
        self.columns: list[Integers] = []
        self._numbers: dict[bytes, int] = {}
        self._reads: dict[int, tuple[Read, ...]] = {}
        self._inside: dict[int, bool] = {}

    def number(self, column: Integers) -> int:
        """The number of a column."""
        key = column.tobytes()
        if key not in self._numbers:
            self._numbers[key] = len(self.columns)
            self.columns.append(column)
        return self._numbers[key]

    def block(self, node: int) -> Block:
        """The block that a column's elements belong to."""
        return self.elements.blocks[same(self.elements.block[self.columns[node]])]

    def kind(self, node: int) -> Class:
        """Their class."""
        return self.elements.plan.classes[self.block(node).kind]

    def sources(self, node: int) -> tuple[Read, ...]:
        """Where their inputs come from."""
        if node not in self._reads:
            block = self.block(node)
            rows = self.columns[node] - block.first
            self._reads[node] = tuple(
                Read(self.number(s.elements[rows]), s.what, s.index[rows]) for s in block.sources
            )
        return self._reads[node]

    def is_inside(self, node: int) -> bool:
        """Whether the groups compute a column's outs themselves: their own elements', and those of elements without states."""
        if node not in self._inside:
            home = self.elements.home[self.columns[node]]
            self._inside[node] = bool(same(((home == self.places) | (home < 0)).astype(np.int64)))
        return self._inside[node]

    def read_by(self, node: int, part: int) -> list[tuple[int, str, int]]:
        """As `Elements.read_by`; outs of other groups need no index."""
        sources = self.sources(node)
        return [
            (s.node, s.what, same(s.index) if self.is_inside(s.node) else -1)
            for s in (sources[k] for k in inputs_of(self.kind(node), part))
        ]

    def order_parts(self, wanted: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
        """Calls (column, part) that make the outs (column, out); see `elements.order_parts`."""
        return order_parts(wanted, lambda n, out: part_of(self.kind(n), out), self.read_by, self.is_inside)
