"""Straight-line sparse LU for the Newton matrices of an implicit step: lambda I - h J for several lambda at once.

One packed value holds a complex number for each lambda: real parts in the lower half of the lanes, imaginary parts in the upper half. Pivots are
static, on the diagonal, in Markowitz order (least fill first): for small h the matrix is close to lambda I, and a step whose pivots fail is rejected by
its Newton iteration. Entries that stay -h J[i,j] are kept as real scalars.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from llvmlite import ir

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.types import DOUBLE, I64, Float, Value, llvm_type

Entry = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Elimination:
    """Order of elimination: (pivot, rows below, columns right) a step; which off-diagonal entries become complex, which stay real."""

    n: int
    steps: tuple[tuple[int, tuple[int, ...], tuple[int, ...]], ...]
    complex_entries: tuple[Entry, ...]
    real_entries: tuple[Entry, ...]

    @property
    def updates(self) -> int:
        """Multiplications and subtractions of one factorisation."""
        return sum(len(below) * len(right) for _, below, right in self.steps)

    @property
    def entries(self) -> int:
        """Entries that one solve goes through."""
        return self.n + len(self.complex_entries) + len(self.real_entries)

    def size(self, lanes: int) -> int:
        """Doubles that the factors take: inverse pivots and complex entries twice (spread for multiplication), then real ones."""
        return 2 * lanes * (self.n + len(self.complex_entries)) + -(-len(self.real_entries) // lanes) * lanes


def eliminate(n: int, pattern: frozenset[Entry]) -> Elimination:
    """Symbolic elimination of a matrix with these nonzeros (the diagonal always counts), in Markowitz order, ties by index."""
    filled = {(i, j) for i, j in pattern if i != j}
    rows: dict[int, set[int]] = {k: {i for i, j in filled if j == k} for k in range(n)}
    columns: dict[int, set[int]] = {k: {j for i, j in filled if i == k} for k in range(n)}
    touched: set[Entry] = set()
    steps = []
    left = set(range(n))
    while left:
        pivot = min(left, key=lambda k: (len(rows[k]) * len(columns[k]), len(rows[k]) + len(columns[k]), k))
        left.remove(pivot)
        below, right = sorted(rows[pivot]), sorted(columns[pivot])
        steps.append((pivot, tuple(below), tuple(right)))
        for i in below:
            columns[i].discard(pivot)
        for j in right:
            rows[j].discard(pivot)
        for i in below:
            for j in right:
                if i != j:
                    touched.add((i, j))
                    filled.add((i, j))
                    rows[j].add(i)
                    columns[i].add(j)
    return Elimination(n, tuple(steps), tuple(sorted(touched)), tuple(sorted(filled - touched)))


class LinearCode:
    """Emits factorisation and solves for one elimination, with `lanes` lanes, factors at `memory` (a pointer)."""

    def __init__(self, plan: Elimination, lanes: int, builder: ir.IRBuilder, memory: Any) -> None:
        self.plan = plan
        self.lanes = lanes
        self.math = Arithmetic(builder, contract=True)
        self.builder = builder
        self.memory = memory
        self.complex_slot = {
            e: k for k, e in enumerate([(i, i) for i in range(plan.n)] + list(plan.complex_entries))
        }
        self.real_slot = {e: k for k, e in enumerate(plan.real_entries)}

    # ---- factors in memory ----------------------------------------------------------------------

    def _address(self, doubles: int) -> Any:
        return self.builder.gep(self.memory, [ir.Constant(I64, doubles)], inbounds=True, source_etype=DOUBLE)

    def _store(self, entry: Entry, value: Value) -> None:
        """Store a packed entry spread for multiplication: (re, re) and (-im, im)."""
        spread = self._spread(value)
        for part, v in enumerate(spread):
            self.builder.store(
                v.ir, self._address((2 * self.complex_slot[entry] + part) * self.lanes), align=8
            )

    def _load(self, entry: Entry) -> tuple[Value, ...] | Value:
        if entry in self.real_slot:
            first = 2 * self.lanes * len(self.complex_slot)
            loaded = self.builder.load(self._address(first + self.real_slot[entry]), typ=DOUBLE, align=8)
            return Value(loaded, Float())
        kind = Float(self.lanes)
        return tuple(
            Value(
                self.builder.load(
                    self._address((2 * self.complex_slot[entry] + part) * self.lanes),
                    typ=llvm_type(kind),
                    align=8,
                ),
                kind,
            )
            for part in (0, 1)
        )

    def _load_real(self, entry: Entry) -> Value:
        """The entry of the real eigenvalue's matrix (lane 0)."""
        if entry in self.real_slot:
            value = self._load(entry)
            assert isinstance(value, Value)
            return value
        loaded = self.builder.load(
            self._address(2 * self.complex_slot[entry] * self.lanes), typ=DOUBLE, align=8
        )
        return Value(loaded, Float())

    # ---- packed complex arithmetic --------------------------------------------------------------

    def _spread(self, a: Value) -> tuple[Value, Value]:
        half = self.lanes // 2
        low, high = list(range(half)), list(range(half, self.lanes))
        signs = Value(
            ir.Constant(llvm_type(Float(self.lanes)), [-1.0] * half + [1.0] * half), Float(self.lanes)
        )
        return self.math.shuffle(a, low + low), self.math.binary(
            "Mult", self.math.shuffle(a, high + high), signs
        )

    def _swap(self, a: Value) -> Value:
        half = self.lanes // 2
        return self.math.shuffle(a, [*range(half, self.lanes), *range(half)])

    def _times(self, a: tuple[Value, ...] | Value, b: Value) -> Value:
        """a*b; `a` spread or a real scalar, `b` packed."""
        if isinstance(a, Value):
            return self.math.binary("Mult", a, b)
        return self.math.binary(
            "Add", self.math.binary("Mult", a[0], b), self.math.binary("Mult", a[1], self._swap(b))
        )

    def _inverse(self, a: Value) -> Value:
        half = self.lanes // 2
        squares = self.math.binary("Mult", a, a)
        modulus = self.math.binary("Add", squares, self._swap(squares))
        signs = Value(
            ir.Constant(llvm_type(Float(self.lanes)), [1.0] * half + [-1.0] * half), Float(self.lanes)
        )
        return self.math.binary(
            "Mult", self.math.binary("Mult", a, signs), self.math.binary("Div", 1.0, modulus)
        )

    # ---- the three pieces -----------------------------------------------------------------------

    def factor(self, h: Value, jacobian: Mapping[Entry, Value], eigenvalues: Value) -> None:
        """Factor lambda I - h J; `eigenvalues` packed."""
        minus_h = self.math.negate(h)
        half = self.lanes // 2
        real_lanes = Value(
            ir.Constant(llvm_type(Float(self.lanes)), [1.0] * half + [0.0] * half), Float(self.lanes)
        )
        packed: dict[Entry, Value] = {}
        scalar: dict[Entry, Value] = {}
        for entry, value in jacobian.items():
            scalar[entry] = self.math.binary("Mult", minus_h, value)
        for i in range(self.plan.n):
            packed[i, i] = eigenvalues
            if (i, i) in scalar:
                packed[i, i] = self.math.binary(
                    "Add", eigenvalues, self.math.binary("Mult", scalar[i, i], real_lanes)
                )
        for entry in self.plan.real_entries:
            first = 2 * self.lanes * len(self.complex_slot)
            self.builder.store(scalar[entry].ir, self._address(first + self.real_slot[entry]), align=8)
        for pivot, below, right in self.plan.steps:
            inverse = self._inverse(packed[pivot, pivot])
            self._store((pivot, pivot), inverse)
            for i in below:
                if not right:
                    continue
                multiplier = self._spread(self._product(packed, scalar, (i, pivot), inverse))
                for j in right:
                    update = self._update(packed, scalar, (pivot, j), multiplier, real_lanes)
                    current = self._current(packed, scalar, (i, j), real_lanes)
                    packed[i, j] = (
                        self.math.negate(update)
                        if current is None
                        else self.math.binary("Sub", current, update)
                    )
        for entry in self.plan.complex_entries:
            self._store(entry, packed[entry])

    def _product(
        self, packed: dict[Entry, Value], scalar: dict[Entry, Value], entry: Entry, b: Value
    ) -> Value:
        return self._times(self._spread(packed[entry]) if entry in packed else scalar[entry], b)

    def _update(
        self,
        packed: dict[Entry, Value],
        scalar: dict[Entry, Value],
        entry: Entry,
        spread: tuple[Value, Value],
        ones: Value,
    ) -> Value:
        if entry in packed:
            return self._times(spread, packed[entry])
        # a real entry times a spread number: (re, im) again, from the halves of the spread parts
        half = self.lanes // 2
        joined = self.math.shuffle(
            spread[0], [*range(half), *range(self.lanes + half, 2 * self.lanes)], spread[1]
        )
        return self.math.binary("Mult", scalar[entry], joined)

    def _current(
        self, packed: dict[Entry, Value], scalar: dict[Entry, Value], entry: Entry, real_lanes: Value
    ) -> Value | None:
        if entry in packed:
            return packed[entry]
        return self.math.binary("Mult", scalar[entry], real_lanes) if entry in scalar else None

    def solve(self, load: Callable[[int], Value], store: Callable[[int, Value], None]) -> None:
        """Solve with packed right-hand sides b[i] = load(i), in place."""
        b = [load(i) for i in range(self.plan.n)]
        self._substitute(b, self._load, self._times)
        for i, value in enumerate(b):
            store(i, value)

    def solve_real(self, load: Callable[[int], Value], store: Callable[[int, Value], None]) -> None:
        """Solve with the real eigenvalue's matrix alone, for scalars b[i], or for lanes each of which is a right-hand side."""
        b = [load(i) for i in range(self.plan.n)]
        self._substitute(b, self._load_real, lambda a, v: self.math.binary("Mult", a, v))
        for i, value in enumerate(b):
            store(i, value)

    def _substitute(
        self, b: list[Value], entry: Callable[[Entry], Any], times: Callable[[Any, Value], Value]
    ) -> None:
        for pivot, below, _ in self.plan.steps:
            b[pivot] = times(entry((pivot, pivot)), b[pivot])
            for i in below:
                b[i] = self.math.binary("Sub", b[i], times(entry((i, pivot)), b[pivot]))
        for pivot, _, right in reversed(self.plan.steps):
            if right:
                terms = [times(entry((pivot, j)), b[j]) for j in right]
                summed = functools.reduce(functools.partial(self.math.binary, "Add"), terms)
                b[pivot] = self.math.binary("Sub", b[pivot], times(entry((pivot, pivot)), summed))
