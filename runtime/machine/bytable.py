"""The LU of `linear.py` for large patterns: the same elimination, read from a table instead of written out.

Straight-line code grows with the number of updates; beyond `LARGE` of them compiling it would take longer than most runs. Here one loop goes through a
constant table of places. All entries are packed complex numbers; below the pivots stand the multipliers, on the diagonal the pivots' inverses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from llvmlite import ir

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.dialect import Array, Lanes, lower_twice, swap_halves, upper_twice
from hierc.runtime.machine.linear import Elimination, Entry
from hierc.runtime.machine.types import (
    DOUBLE,
    I64,
    Emitted,
    Float,
    LaneConstant,
    Value,
    llvm_type,
)

if TYPE_CHECKING:
    from hierc.runtime.machine.unit import Unit

    # given by TableCode
    SIGNS: Lanes  # -1 in the lower half of the lanes, 1 in the upper
    LANES: int

#: Updates above which a factorisation is read from a table.
LARGE = 1000


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
            m[table[c]] = multiplier
            c += 1
            for _ in range(right):
                m[table[c + 1]] = m[table[c + 1]] - times(multiplier, m[table[c]])
                c += 2


def solve_by_table(b: Array[Lanes], m: Array[Lanes], table: Array[int], pivots: int) -> None:
    """Forward and back substitution in place. A pivot's record, forward and then, in reverse order, back: row, count, (place, row) each."""
    c = 0
    for _ in range(pivots):
        known = b[table[c]]
        count = table[c + 1]
        c += 2
        for _ in range(count):
            b[table[c + 1]] = b[table[c + 1]] - times(m[table[c]], known)
            c += 2
    for _ in range(pivots):
        row = table[c]
        count = table[c + 1]
        place = table[c + 2]
        left = b[row]
        c += 3
        for _ in range(count):
            left = left - times(m[table[c]], b[table[c + 1]])
            c += 2
        b[row] = times(m[place], left)


def solve_real_by_table(b: Array[Lanes], m: Array[float], table: Array[int], pivots: int) -> None:
    """As `solve_by_table` for the real eigenvalue alone, lane 0 of each entry; each lane of b is a right-hand side (there may be one)."""
    c = 0
    for _ in range(pivots):
        known = b[table[c]]
        count = table[c + 1]
        c += 2
        for _ in range(count):
            b[table[c + 1]] = b[table[c + 1]] - m[table[c] * LANES] * known
            c += 2
    for _ in range(pivots):
        row = table[c]
        count = table[c + 1]
        place = table[c + 2]
        left = b[row]
        c += 3
        for _ in range(count):
            left = left - m[table[c] * LANES] * b[table[c + 1]]
            c += 2
        b[row] = m[place * LANES] * left


class TableCode:
    """Emits factorisation and solves of one elimination by table, into `unit`."""

    def __init__(self, plan: Elimination, lanes: int, unit: Unit) -> None:
        self.plan, self.lanes, self.unit = plan, lanes, unit
        entries = [(i, i) for i in range(plan.n)] + list(plan.complex_entries) + list(plan.real_entries)
        self.places = {entry: k for k, entry in enumerate(entries)}
        half = lanes // 2
        self.names: dict[str, Any] = {"SIGNS": LaneConstant((-1.0,) * half + (1.0,) * half), "LANES": lanes}

    @property
    def size(self) -> int:
        """Doubles that the factors take."""
        return self.lanes * len(self.places)

    def fill(
        self, math: Arithmetic, h: Value, jacobian: Mapping[Entry, Value], eigenvalues: Value, memory: Any
    ) -> None:
        """Store lambda I - h J, fill-in as zeros."""
        half = self.lanes // 2
        kind = Float(self.lanes)
        ones = Value(ir.Constant(llvm_type(kind), [1.0] * half + [0.0] * half), kind)
        zero = Value(ir.Constant(llvm_type(kind), [0.0] * self.lanes), kind)
        minus_h = math.negate(h)
        for (i, j), place in self.places.items():
            value = eigenvalues if i == j else zero
            if (i, j) in jacobian:
                value = math.binary(
                    "Add", value, math.binary("Mult", math.binary("Mult", minus_h, jacobian[i, j]), ones)
                )
            where = ir.Constant(I64, place * self.lanes)
            address = math.builder.gep(memory, [where], inbounds=True, source_etype=DOUBLE)
            math.builder.store(value.ir, address, align=8)

    def factoring(self) -> tuple[Emitted, Value]:
        """The function factor_by_table, and its table."""
        table: list[int] = []
        for pivot, below, right in self.plan.steps:
            table += [self.places[pivot, pivot], len(below), len(right)]
            for i in below:
                table.append(self.places[i, pivot])
                for j in right:
                    table += [self.places[pivot, j], self.places[i, j]]
        return self.unit.dialect(factor_by_table, self.lanes, self.names), self.unit.table(
            "factor_table", table
        )

    def solving(self, *, real: bool, width: int) -> tuple[Emitted, Value]:
        """The function solve_by_table or solve_real_by_table, and their table."""
        table: list[int] = []
        for pivot, below, _ in self.plan.steps:
            table += [pivot, len(below)]
            for i in below:
                table += [self.places[i, pivot], i]
        for pivot, _, right in reversed(self.plan.steps):
            table += [pivot, len(right), self.places[pivot, pivot]]
            for j in right:
                table += [self.places[pivot, j], j]
        made = self.unit.dialect(solve_real_by_table if real else solve_by_table, width, self.names)
        return made, self.unit.table("solve_table", table)
