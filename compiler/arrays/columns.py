"""Columns: integers that differ from element to element of a block of agents.

An array of agents is never expanded: what it reads, and which entries of the parameter vector are its own, are said by columns, one integer an
element. `Index` is what stands where such a column may: an `int` is the same for all elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


class Column:
    """One integer for each element of a block; equal and hashed by content, never changed."""

    __slots__ = ("_hash", "values")

    def __init__(self, values: Integers | Sequence[int]) -> None:
        self.values: Integers = np.array(values, np.int64)
        self.values.flags.writeable = False
        self._hash: int | None = None

    def __len__(self) -> int:
        return len(self.values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Column) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = hash(self.values.tobytes())
        return self._hash

    def __repr__(self) -> str:
        shown = ", ".join(str(v) for v in self.values[:4].tolist())
        return f"Column({shown}{', …' if len(self) > 4 else ''}; {len(self)})"

    def __reduce__(self) -> tuple[Any, ...]:
        return (Column, (self.values,))


Index = int | Column


def column(values: Integers) -> Index:
    """A column of `values` (at least one), or the integer that all of them are."""
    first = int(values[0])
    return first if (values == first).all() else Column(values)


def expanded(index: Index, count: int) -> Integers:
    """The integers of `count` elements."""
    if isinstance(index, Column):
        return index.values
    return np.full(count, index, np.int64)


def taken(index: Index, places: Integers) -> Index:
    """What the elements at `places` have."""
    return index if isinstance(index, int) else column(index.values[places])


def added(index: Index, more: int) -> Index:
    """Every integer with `more` added."""
    return index + more if isinstance(index, int) else Column(index.values + more)


def difference(left: Index, right: Index) -> Index:
    """left - right, element by element."""
    if isinstance(left, int) and isinstance(right, int):
        return left - right
    count = len(left) if isinstance(left, Column) else len(right) if isinstance(right, Column) else 1
    return column(expanded(left, count) - expanded(right, count))


def mapped(index: Index, table: Integers) -> Index:
    """Every integer as the entry of a table at that place."""
    return int(table[index]) if isinstance(index, int) else column(table[index.values])


def column_of(values: Integers) -> Index:
    """A column of `values`, which differ from each other, or the only one of them."""
    return int(values[0]) if len(values) == 1 else Column(values)
