"""LU of the dense blocks that an elimination ends with: the dialect's text. `bytable.py` says where the blocks are.

A block lies row by row, as packed complex numbers, so its entries need no table: each block's record is where it begins (in lanes), how many rows it has,
and which. As elsewhere the pivots are on the diagonal, which holds their inverses in the end, and all other entries are as the elimination leaves them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hierc.runtime.machine.dialect import Array, Lanes, at, splat
from hierc.runtime.machine.irregular import inverse, times

if TYPE_CHECKING:  # given by TableCode
    WIDTH: int  # doubles that an entry takes

    def entry_times(entry: Array[float], b: Lanes) -> Lanes:
        """`complex_times` or `real_times` of `irregular.py`."""
        ...


def factor(m: Array[Lanes], table: Array[int], blocks: int) -> None:
    """Factor blocks in place, row after row: a row takes all its updates while it is at hand."""
    c = 0
    for _ in range(blocks):
        block = at(m, table[c])
        size = table[c + 1]
        c += 2 + size
        for i in range(size):
            row = at(block, i * size)
            for k in range(i):
                above = at(block, k * size)
                multiplier = times(row[k], above[k])
                for j in range(k + 1, size):
                    row[j] = row[j] - times(multiplier, above[j])
            row[i] = inverse(row[i])


def solve(b: Array[Lanes], m: Array[float], table: Array[int], blocks: int) -> None:
    """Solve the blocks' systems in place."""
    c = 0
    for _ in range(blocks):
        block = at(m, table[c] * WIDTH)
        size = table[c + 1]
        rows = at(table, c + 2)
        c += 2 + size
        for i in range(size):
            row = at(block, i * size * WIDTH)
            known = b[rows[i]] - product(row, b, rows, 0, i)
            b[rows[i]] = entry_times(at(row, i * WIDTH), known)
        for back in range(size):
            i = size - 1 - back
            row = at(block, i * size * WIDTH)
            rest = product(row, b, rows, i + 1, size)
            b[rows[i]] = b[rows[i]] - entry_times(at(row, i * WIDTH), rest)


def product(row: Array[float], b: Array[Lanes], rows: Array[int], first: int, end: int) -> Lanes:
    """Entries `first` to `end` (exclusive) of a block's row times b; in two sums, so that a term need not wait for the one before it."""
    even = splat(0.0)
    odd = splat(0.0)
    k = first
    for _ in range((end - first) // 2):
        even = even + entry_times(at(row, k * WIDTH), b[rows[k]])
        odd = odd + entry_times(at(row, (k + 1) * WIDTH), b[rows[k + 1]])
        k += 2
    if k < end:
        even = even + entry_times(at(row, k * WIDTH), b[rows[k]])
    return even + odd
