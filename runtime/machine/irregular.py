"""Elimination read from a table number by number: the dialect's text for what does not repeat. `bytable.py` makes the tables.

All entries are packed complex numbers. For the real eigenvalue alone, `entry_times` takes lane 0 of an entry, and each lane of b is a right-hand side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hierc.runtime.machine.dialect import Array, Lanes, at, lower_twice, swap_halves, upper_twice

if TYPE_CHECKING:  # given by TableCode
    SIGNS: Lanes  # -1 in the lower half of the lanes, 1 in the upper

    def entry_times(entry: Array[float], b: Lanes) -> Lanes:
        """`complex_times` or `real_times`."""
        ...


def complex_times(entry: Array[Lanes], b: Lanes) -> Lanes:
    """An entry times b, packed complex."""
    return times(entry[0], b)


def real_times(entry: Array[float], b: Lanes) -> Lanes:
    """The same for the real eigenvalue's matrix."""
    return entry[0] * b


def times(a: Lanes, b: Lanes) -> Lanes:
    """a*b, packed complex."""
    return lower_twice(a) * b + SIGNS * upper_twice(a) * swap_halves(b)


def inverse(a: Lanes) -> Lanes:
    """1/a, packed complex."""
    squares = a * a
    return -SIGNS * a / (squares + swap_halves(squares))


def factor_by_table(m: Array[Lanes], table: Array[int], pivots: int) -> None:
    """Eliminate in place. A pivot's record: its place, rows below, columns right; then for each row its place and, for each column, two places."""
    c = 0
    for _ in range(pivots):
        pivot = inverse(m[table[c]])
        m[table[c]] = pivot
        below = table[c + 1]
        right = table[c + 2]
        c += 3
        for _ in range(below):
            multiplier = times(m[table[c]], pivot)
            c += 1
            for _ in range(right):
                m[table[c + 1]] = m[table[c + 1]] - times(multiplier, m[table[c]])
                c += 2


def forward_by_table(b: Array[Lanes], m: Array[float], table: Array[int], pivots: int) -> None:
    """Forward substitution in place. A pivot's record: row, place (in doubles), count, and as many (row, place)."""
    c = 0
    for _ in range(pivots):
        known = entry_times(at(m, table[c + 1]), b[table[c]])
        b[table[c]] = known
        count = table[c + 2]
        c += 3
        for _ in range(count):
            b[table[c]] = b[table[c]] - entry_times(at(m, table[c + 1]), known)
            c += 2


def back_by_table(b: Array[Lanes], m: Array[float], table: Array[int], pivots: int) -> None:
    """Back substitution in place. Records as before, the last pivot's first."""
    c = 0
    for _ in range(pivots):
        row = table[c]
        place = table[c + 1]
        count = table[c + 2]
        rest = b[row] * 0.0
        c += 3
        for _ in range(count):
            rest = rest + entry_times(at(m, table[c + 1]), b[table[c]])
            c += 2
        if count > 0:
            b[row] = b[row] - entry_times(at(m, place), rest)
