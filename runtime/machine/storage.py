"""Local variables while a function is lowered: each in a stack slot, which LLVM's mem2reg turns into registers.

A local that begins as a scalar and goes on in lanes moves to a wider slot. Where the sides of a branch end with a local in different slots, `join`
brings it into the one that holds every side's value.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.types import Float, Type, UnsupportedCode, Value, llvm_type

Slots = dict[str, tuple[Any, Type]]


class Locals:
    """The locals of one function, by name."""

    def __init__(self, builder: ir.IRBuilder, math: Arithmetic) -> None:
        self.builder = builder
        self.math = math
        self.slots: Slots = {}
        self._outside: frozenset[str] = frozenset()  # those older than the loop

    def __contains__(self, name: object) -> bool:
        return name in self.slots

    def store(self, name: str, value: Value) -> None:
        """Set a local, making it if it is new."""
        if name not in self.slots:
            self._place(name, value.type)
        slot, kind = self.slots[name]
        if (
            kind != value.type
            and isinstance(value.type, Float)
            and value.type.lanes > 1
            and isinstance(kind, Float)
        ):
            if name in self._outside:
                raise UnsupportedCode(f"{name!r} is a scalar before a loop and has lanes within it")
            self._place(name, value.type)
            slot, kind = self.slots[name]
        self.builder.store(self.math.convert(value, kind).ir, slot)

    def load(self, name: str) -> Value:
        """The value of a local."""
        slot, kind = self.slots[name]
        return Value(self.builder.load(slot, typ=llvm_type(kind)), kind)

    def _place(self, name: str, kind: Type) -> None:
        with self.builder.goto_entry_block():
            self.slots[name] = (self.builder.alloca(llvm_type(kind)), kind)

    @contextmanager
    def loop(self) -> Iterator[None]:
        """Within a loop, what was there before cannot become wider: the next round would read the old slot."""
        outside, self._outside = self._outside, frozenset(self.slots)
        yield
        self._outside = outside

    def join(self, sides: Sequence[tuple[ir.Block, Slots]], after: ir.Block) -> None:
        """End the sides of a branch, (last block, slots) each, with a jump to `after`, where every local has one slot."""
        self.slots = {}
        for name, (slot, kind) in (item for _, slots in sides for item in slots.items()):
            if name not in self.slots or self.math.common(kind, self.slots[name][1]) != self.slots[name][1]:
                self.slots[name] = (slot, kind)
        for end, slots in sides:
            self.builder.position_at_end(end)
            for name, (slot, kind) in slots.items():
                if self.slots[name][0] is not slot:
                    self.store(name, Value(self.builder.load(slot, typ=llvm_type(kind)), kind))
            self.builder.branch(after)
        self.builder.position_at_end(after)
