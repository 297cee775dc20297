"""Runs: many elements in a row as few entries.

In: rows of element numbers, one column for each group of a family. Out: entries as the contract has them. Guaranteed: the entries stand for the rows, in
their order; the work in Python is in proportion to the entries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hierc.compiler.arrays.columns import Index, Integers, column

#: Rows that are worth a run.
_LEAST = 3


@dataclass(frozen=True, slots=True)
class Run:
    """Elements first, first + step, …, `count` of them in each group; those of the next group are `shift` further."""

    first: int
    count: int
    step: int
    shift: int


#: Elements of each group: one for each, or several in a row.
Members = Index | Run


def members(rows: Integers) -> list[Members]:
    """Entries for rows, shape (elements of a group, groups)."""
    count, groups = rows.shape
    if count == 1:
        return [column(rows[0])]
    firsts = rows[:, 0]
    shifts = rows[:, 1] - firsts if groups > 1 else np.zeros(count, np.int64)
    even = (np.diff(rows, axis=1) == shifts[:, None]).all(axis=1)
    steps = np.diff(firsts)
    joined = even[1:] & even[:-1] & (shifts[1:] == shifts[:-1])  # rows k and k + 1 may share a run
    changes = 1 + np.flatnonzero(~joined[1:] | (steps[1:] != steps[:-1]))
    found: list[Members] = []
    row = 0
    while row < count:
        last = row
        if row < count - 1 and joined[row]:
            place = int(np.searchsorted(changes, row, side="right"))
            last = int(changes[place]) if place < len(changes) else count - 1
        if last - row + 1 >= _LEAST:
            found.append(Run(int(firsts[row]), last - row + 1, int(steps[row]), int(shifts[row])))
            row = last + 1
        else:
            found.append(column(rows[row]))
            row += 1
    return found
