"""Local variables while a function is lowered: values where they are set once, outside of branches and loops; all others have stack slots.

LLVM's mem2reg turns slots into registers. A local that begins as a scalar and goes on in lanes moves to a wider slot. Where the sides of a branch end with a
local in different slots, `join` brings it into the one that holds every side's value.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.types import Float, Type, UnsupportedCode, Value, llvm_type

Slots = dict[str, tuple[Any, Type]]


class Locals:
    """The locals of one function, by name. `once`: those that are set once, as `set_once` finds them."""

    def __init__(self, builder: ir.IRBuilder, math: Arithmetic, once: frozenset[str]) -> None:
        self.builder = builder
        self.math = math
        self.once = once
        self.values: dict[str, Value] = {}
        self.slots: Slots = {}
        self._outside: frozenset[str] = frozenset()  # those older than the loop

    def __contains__(self, name: object) -> bool:
        return name in self.values or name in self.slots

    def store(self, name: str, value: Value) -> None:
        """Set a local, making it if it is new."""
        if name in self.once:
            self.values[name] = value
            return
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
        if name in self.values:
            return self.values[name]
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


def set_once(arguments: Iterable[str], body: Sequence[ast.stmt]) -> frozenset[str]:
    """The locals of a function that are set in one place, which everything after it has come through: arguments, and names outside of branches and loops."""
    counts = Counter(arguments)
    counts.update(_names_set(body))
    outside = {*arguments, *_names_set([s for s in body if isinstance(s, ast.Assign)])}
    return frozenset(name for name in outside if counts[name] == 1)


def _names_set(body: Sequence[ast.stmt]) -> Iterator[str]:
    """Every name that statements set, as often as they do."""
    for statement in body:
        match statement:
            case ast.Assign(targets=targets):
                for target in targets:
                    items = target.elts if isinstance(target, ast.Tuple) else [target]
                    yield from (item.id for item in items if isinstance(item, ast.Name))
            case ast.AugAssign(target=ast.Name(id=name)):
                yield name
            case ast.For(target=target, body=inner):
                yield from (n.id for n in ast.walk(target) if isinstance(n, ast.Name))
                yield from _names_set(inner)
            case ast.If(body=inner, orelse=orelse) | ast.While(body=inner, orelse=orelse):
                yield from _names_set([*inner, *orelse])
