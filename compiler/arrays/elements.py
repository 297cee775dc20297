"""Elements of blocks: which block an element number belongs to, and how several of them are called.

Nothing here takes Python work for each element: columns are looked at as a whole.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers, expanded
from hierc.compiler.model import Source

#: Ranges of indices that a name lists before it abbreviates.
_RANGES = 4


class Elements:
    """The elements of all blocks of a model; `firsts` are the numbers of the blocks' first elements."""

    def __init__(self, firsts: Iterable[int]) -> None:
        self._firsts = list(firsts)
        self._first_column = np.array(self._firsts, np.int64)

    def block(self, number: int) -> int:
        """The block of an element."""
        return bisect_right(self._firsts, number) - 1

    def blocks(self, numbers: Integers) -> Integers:
        """The block of each element."""
        return slots_of(self._first_column, numbers)

    def touched(self, source: Source, count: int) -> list[tuple[int, int]]:
        """The blocks that a source of `count` elements lies in, each with the indices it has there; every pair once."""
        if isinstance(source.node, int):
            block = self.block(source.node)
            if isinstance(source.index, int):
                return [(block, source.index)]
            return [(block, index) for index in distinct(source.index.values).tolist()]
        blocks = self.blocks(source.node.values)
        if isinstance(source.index, int):
            return [(block, source.index) for block in distinct(blocks).tolist()]
        pairs = np.unique(np.stack([blocks, expanded(source.index, count)]), axis=1)
        return [(block, index) for block, index in pairs.T.tolist()]


def slots_of(firsts: Integers, numbers: Integers) -> Integers:
    """For each number the last place in `firsts`, which ascend, that has no greater one. Nothing is searched where all have the same."""
    if numbers.size:
        low, high = np.searchsorted(firsts, [numbers.min(), numbers.max()], side="right").tolist()
        if low == high:
            return np.full(numbers.shape, low - 1)
    return np.searchsorted(firsts, numbers, side="right") - 1


def distinct(values: Integers) -> Integers:
    """The different integers of a column, ascending: as np.unique, but nothing is sorted that stands in order."""
    changes = np.flatnonzero(values[1:] != values[:-1])
    heads = values[np.concatenate(([0], changes + 1))] if len(changes) else values[:1]
    return heads if (heads[1:] > heads[:-1]).all() else np.unique(heads)


# ---- names ----------------------------------------------------------------------------------


def plain(path: str) -> str:
    """A path without the marks of arrays: `car.engine` for `car[].engine`, of whatever element."""
    return path.replace("[]", "")


def spelled(path: str, indices: Sequence[Index]) -> str:
    """What a reader calls elements: `car[].engine` with the indices 2, 3, 4 is `car[2..4].engine`."""
    pieces = path.split("[]")
    columns = [
        distinct(i.values) if isinstance(i, Column) else np.array([i], np.int64)
        for i in indices[: len(pieces) - 1]
    ]
    text = pieces[0] + "".join(
        f"[{ranges(column)}]{rest}" for column, rest in zip(columns, pieces[1:], strict=False)
    )
    count = max((len(i) for i in indices if isinstance(i, Column)), default=1)
    most = int(np.prod([len(column) for column in columns])) if columns else 1
    return text if count >= most else f"{text} ({count} of {most})"


def ranges(values: Integers) -> str:
    """Ascending integers as ranges: `1, 4..6`."""
    ends = np.flatnonzero(np.diff(values) != 1)
    firsts, lasts = [0, *(ends + 1)], [*ends, len(values) - 1]
    if len(firsts) <= _RANGES:
        return ", ".join(_range(values, a, b) for a, b in zip(firsts, lasts, strict=True))
    shown = [_range(values, a, b) for a, b in zip(firsts[: _RANGES - 2], lasts, strict=False)]
    return ", ".join([*shown, "...", _range(values, firsts[-1], lasts[-1])])


def _range(values: Integers, first: int, last: int) -> str:
    return str(values[first]) if first == last else f"{values[first]}..{values[last]}"
