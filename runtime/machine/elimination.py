"""The order in which the Newton matrices of a group are eliminated, and what that fills.

In: the nonzeros of a Jacobian. Out: the steps of a symbolic elimination, in time about in proportion to what it fills; for patterns with narrow bands, as
chains of agents have, all of it is in proportion to their length. Where everything that is left together is (nearly) full, nothing is to be found out: it
becomes a dense block.

Pivots are static, on the diagonal, in Markowitz order: least fill first. Among equals those come first that wait for least: a chain is eliminated from both of
its ends, and processors have something to do while a quotient is on its way.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

Entry = tuple[int, int]

#: Rows from which on a block is worth its while.
BLOCK = 24
#: The part of its entries that are there.
FULL = 0.8


@dataclass(frozen=True, slots=True)
class Step:
    """The elimination of one pivot: the rows below it, the columns right of it, in ascending order."""

    pivot: int
    below: tuple[int, ...]
    right: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Elimination:
    """Order of elimination, and which off-diagonal entries become complex, which stay real.

    After the steps come dense blocks, independent of each other: the pivots of each in order. All of their entries are complex, and listed nowhere.
    """

    n: int
    steps: tuple[Step, ...]
    complex_entries: tuple[Entry, ...]
    real_entries: tuple[Entry, ...]
    blocks: tuple[tuple[int, ...], ...] = ()

    @property
    def updates(self) -> int:
        """Multiplications and subtractions of one factorisation."""
        dense = sum((m - 1) * m * (2 * m - 1) // 6 for m in map(len, self.blocks))
        return dense + sum(len(step.below) * len(step.right) for step in self.steps)

    @property
    def entries(self) -> int:
        """Entries that one solve goes through."""
        dense = sum((m - 1) * m for m in map(len, self.blocks))
        return dense + self.n + len(self.complex_entries) + len(self.real_entries)


def eliminate(n: int, pattern: frozenset[Entry]) -> Elimination:
    """Symbolic elimination of a matrix with these nonzeros (the diagonal always counts)."""
    rows: list[set[int]] = [set() for _ in range(n)]  # of each column: where it has entries that are left
    columns: list[set[int]] = [set() for _ in range(n)]  # of each row
    for i, j in pattern:
        if i != j:
            rows[j].add(i)
            columns[i].add(j)
    depth = [0] * n
    touched: set[Entry] = set()
    steps = []
    blocks: list[tuple[int, ...]] = []

    def price(k: int) -> tuple[int, int, int, int]:
        return len(rows[k]) * len(columns[k]), len(rows[k]) + len(columns[k]), depth[k], k

    queue = [price(k) for k in range(n)]
    heapq.heapify(queue)
    left = set(range(n))
    while queue:
        listed = heapq.heappop(queue)
        pivot = listed[-1]
        if pivot not in left or listed != price(pivot):
            continue  # gone, or listed again at its present price
        block = _block(pivot, rows, columns)
        if block:
            blocks.append(block)
            left.difference_update(block)
            continue
        left.remove(pivot)
        below, right = sorted(rows[pivot]), sorted(columns[pivot])
        steps.append(Step(pivot, tuple(below), tuple(right)))
        for i in below:
            columns[i].discard(pivot)
        for j in right:
            rows[j].discard(pivot)
        for i in below:
            for j in right:
                if i != j:
                    touched.add((i, j))
                    rows[j].add(i)
                    columns[i].add(j)
        for k in rows[pivot] | columns[pivot]:
            depth[k] = max(depth[k], depth[pivot] + 1)
            heapq.heappush(queue, price(k))
    real = {(i, j) for i, j in pattern if i != j} - touched
    of = {k: block for block in blocks for k in block}

    def listed_entries(entries: set[Entry]) -> tuple[Entry, ...]:
        return tuple(sorted((i, j) for i, j in entries if i not in of or of[i] is not of.get(j)))

    return Elimination(n, tuple(steps), listed_entries(touched), listed_entries(real), tuple(blocks))


def _block(pivot: int, rows: list[set[int]], columns: list[set[int]]) -> tuple[int, ...]:
    """What is left together with a pivot, if it is large, nearly full, and coupled to nothing else that is left."""
    if len(rows[pivot]) + len(columns[pivot]) < BLOCK - 1:
        return ()
    block = rows[pivot] | columns[pivot] | {pivot}
    entries = sum(len(columns[k]) for k in block)
    if len(block) < BLOCK or entries < FULL * len(block) * (len(block) - 1):
        return ()
    alone = all(columns[k] <= block and rows[k] <= block for k in block)
    return tuple(sorted(block)) if alone else ()
