"""Timed machine code: how much of a step goes to which of its parts, told by the processor's counter.

Only units that are made for it have timers. In those, every call by one of the names of `SECTIONS`, in a function that has a group `g`, adds the ticks
it took and one to `g.clocks`, two integers a section. What the methods call these functions is the same for all of them, so nothing here knows a method.
A timer costs something itself: `idle` tells how much, on the spot.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import TYPE_CHECKING

from llvmlite import ir

from hierc.runtime.machine.dialect import outlined
from hierc.runtime.machine.types import I64, Int, Operand, Value
from hierc.runtime.records import Group

if TYPE_CHECKING:
    from hierc.runtime.machine.lower import Lowering

#: What is told apart.
PARTS = ("rhs", "algebra", "inputs", "publishing", "steps", "timer", "timers")
RHS, ALGEBRA, INPUTS, PUBLISHING, STEPS, TIMER, TIMERS = range(len(PARTS))
#: The parts by what is called.
SECTIONS = {
    "rhs_fixed": RHS, "rhs": RHS, "factor": ALGEBRA, "solve": ALGEBRA, "solve_lanes": ALGEBRA, "solve_real": ALGEBRA,
    "read_inputs": INPUTS, "publish": PUBLISHING, "nothing": TIMER, "nothings": TIMERS,
}  # fmt: skip


def section(call: ast.Call) -> int | None:
    """The part that a call belongs to; None for one that is not timed."""
    match call:
        case ast.Call(func=ast.Name(id="invoke"), args=[ast.Attribute(attr="step"), *_]):
            return STEPS
        case ast.Call(func=ast.Name(id=name)):
            return SECTIONS.get(name)
    return None


def timed(low: Lowering, part: int, call: Callable[[], Operand | None]) -> Operand | None:
    """What `call` emits, and around it a timer."""
    began = _ticks(low)
    result = call()
    spent = Value(low.builder.sub(_ticks(low).ir, began.ir), Int())
    for place, amount in ((2 * part, spent), (2 * part + 1, 1)):
        clock = ast.parse(f"g.clocks[{place}]", mode="eval").body
        low.assign(clock, low.math.binary("Add", low.load(clock), amount))
    return result


def _ticks(low: Lowering) -> Value:
    """The processor's counter, which runs evenly: that of cycles on x86, of time elsewhere."""
    module = low.function.module
    name = "llvm.readcyclecounter" if module.triple.startswith("x86_64") else "llvm.readsteadycounter"
    counter = module.globals.get(name) or ir.Function(module, ir.FunctionType(I64, []), name)
    return Value(low.builder.call(counter, []), Int())


# ---- what a timer costs; lowered with timers ------------------------------------------------------


def idle(g: Group, count: int) -> float:
    """Time nothing, so many times: `TIMER` then has what each timer adds to its own part, `TIMERS` what it adds to what is around it."""
    nothings(g, count)
    return 0.0


@outlined
def nothings(g: Group, count: int) -> None:
    """Some timers."""
    for _ in range(count):
        nothing(g)


def nothing(g: Group) -> None:
    """What takes no time."""
