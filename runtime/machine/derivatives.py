"""The derivatives of a group's nodes, by slots of a `Chain`, and the group's Jacobian from them: in registers, or in memory for a large group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from llvmlite import ir

from hierc.runtime.machine.body import Body
from hierc.runtime.machine.elimination import Entry
from hierc.runtime.machine.jacobian import ONE, Chain
from hierc.runtime.machine.rows import Number, counted, each_row, load, store
from hierc.runtime.machine.types import DOUBLE, I64, Float, Value


@dataclass(frozen=True, slots=True)
class Derivatives:
    """Derivatives as values; everything about them is written out."""

    body: Body
    values: dict[int, Value] = field(default_factory=dict)

    def take(self, entries: Sequence[int], into: Any, first: int) -> None:
        """The entries that one call has stored, in the slots from `first` on."""
        for k, e in enumerate(entries):
            self.values[first + k] = self.body.math.extract(self.body.load(into, e), 0)

    def follow(self, chain: Chain) -> dict[Entry, Value]:
        """The group's Jacobian."""
        math, values = self.body.math, self.values
        for slot, factor, value in chain.terms:
            term = values[value] if factor == ONE else math.binary("Mult", values[factor], values[value])
            values[slot] = math.binary("Add", values[slot], term) if slot in values else term
        return {entry: values[slot] for entry, slot in chain.entries.items()}


@dataclass(frozen=True, slots=True)
class StoredDerivatives:
    """Derivatives in `memory`, a double for each slot."""

    body: Body
    memory: Any

    def take(self, entries: Sequence[int], into: Any, first: Number) -> None:
        """The entries that one call has stored, in the slots from `first` on."""
        builder = self.body.builder
        for k, e in enumerate(entries):
            place = first + k if isinstance(first, int) else builder.add(first, ir.Constant(I64, k))
            store(builder, self.memory, place, self.body.math.extract(self.body.load(into, e), 0))

    def follow(self, chain: Chain) -> None:
        """Make the sums."""
        if not chain.terms:
            return
        builder, math = self.body.builder, self.body.math
        store(builder, self.memory, ONE, Value(ir.Constant(DOUBLE, 1.0), Float()))
        with counted(builder, chain.size - chain.sums) as k:
            place = builder.add(k, ir.Constant(I64, chain.sums))
            store(builder, self.memory, place, Value(ir.Constant(DOUBLE, 0.0), Float()))
        with each_row(self.body.unit, builder, chain.terms) as (slot, factor, value):
            product = math.binary(
                "Mult", load(builder, self.memory, factor, 1), load(builder, self.memory, value, 1)
            )
            store(
                builder, self.memory, slot, math.binary("Add", load(builder, self.memory, slot, 1), product)
            )
