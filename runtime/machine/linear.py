"""Straight-line sparse LU for the Newton matrices of an implicit step: lambda I - h J for several lambda at once.

One packed value holds a complex number for each lambda. Pivots are static, on the diagonal, in the order of `elimination.py`: for small h the matrix is
close to lambda I, and a step whose pivots fail is rejected by its Newton iteration. Entries that stay -h J[i,j] are kept as real scalars.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

from llvmlite import ir

from hierc.runtime.machine.elimination import Elimination, Entry
from hierc.runtime.machine.packed import Packed
from hierc.runtime.machine.types import DOUBLE, I64, Float, Value, llvm_type


def factor_size(plan: Elimination, lanes: int) -> int:
    """Doubles that the factors take: inverse pivots and complex entries twice (spread for multiplication), then real ones."""
    spread = 2 * lanes * (plan.n + len(plan.complex_entries))
    return spread + -(-len(plan.real_entries) // lanes) * lanes


class LinearCode:
    """Emits factorisation and solves for one elimination, with `lanes` lanes, factors at `memory` (a pointer)."""

    def __init__(self, plan: Elimination, lanes: int, builder: ir.IRBuilder, memory: Any) -> None:
        self.plan = plan
        self.lanes = lanes
        self.packed = Packed(builder, lanes)
        self.math = self.packed.math
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
        spread = self.packed.spread(value)
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

    # ---- the three pieces -----------------------------------------------------------------------

    def factor(self, h: Value, jacobian: Mapping[Entry, Value], eigenvalues: Value) -> None:
        """Factor lambda I - h J; `eigenvalues` packed."""
        minus_h = self.math.negate(h)
        real_lanes = self.packed.one
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
        for step in self.plan.steps:
            inverse = self.packed.inverse(packed[step.pivot, step.pivot])
            self._store((step.pivot, step.pivot), inverse)
            for i in step.below if step.right else ():
                multiplier = self.packed.spread(self._product(packed, scalar, (i, step.pivot), inverse))
                for j in step.right:
                    update = self._update(packed, scalar, (step.pivot, j), multiplier)
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
        return self.packed.times(self.packed.spread(packed[entry]) if entry in packed else scalar[entry], b)

    def _update(
        self,
        packed: dict[Entry, Value],
        scalar: dict[Entry, Value],
        entry: Entry,
        spread: tuple[Value, Value],
    ) -> Value:
        if entry in packed:
            return self.packed.times(spread, packed[entry])
        return self.math.binary("Mult", scalar[entry], self.packed.joined(spread))

    def _current(
        self, packed: dict[Entry, Value], scalar: dict[Entry, Value], entry: Entry, real_lanes: Value
    ) -> Value | None:
        if entry in packed:
            return packed[entry]
        return self.math.binary("Mult", scalar[entry], real_lanes) if entry in scalar else None

    def solve(self, load: Callable[[int], Value], store: Callable[[int, Value], None]) -> None:
        """Solve with packed right-hand sides b[i] = load(i), in place."""
        b = [load(i) for i in range(self.plan.n)]
        self._substitute(b, self._load, self.packed.times)
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
        for pivot, below in ((step.pivot, step.below) for step in self.plan.steps):
            b[pivot] = times(entry((pivot, pivot)), b[pivot])
            for i in below:
                b[i] = self.math.binary("Sub", b[i], times(entry((i, pivot)), b[pivot]))
        for pivot, right in ((step.pivot, step.right) for step in reversed(self.plan.steps)):
            if right:
                terms = [times(entry((pivot, j)), b[j]) for j in right]
                summed = functools.reduce(functools.partial(self.math.binary, "Add"), terms)
                b[pivot] = self.math.binary("Sub", b[pivot], times(entry((pivot, pivot)), summed))
