"""Functions of elements at many times, in machine code: outs and observed variables, where there are many of them.

In: an `out` or `observe` function of a class. Out: its address, for `through`, which goes over evaluations in order. Guaranteed: on finite numbers the
very bits of CPython (one lane, nothing contracted). Each function is an object of its own in the cache, made when it is first wanted.
"""

from __future__ import annotations

import ast
import ctypes
import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hierc.runtime.contract import Class
from hierc.runtime.externs import Extern
from hierc.runtime.files import cache_folder
from hierc.runtime.machine import callees
from hierc.runtime.machine.allowed import check_class
from hierc.runtime.machine.dialect import Array, at, invoke, unroll
from hierc.runtime.machine.program import cached, runtime_digest, text_of
from hierc.runtime.machine.types import Emitted, Float, Pointer, Type
from hierc.runtime.machine.unit import Loaded, Unit, parse_function
from hierc.runtime.records import Evaluation

if TYPE_CHECKING:  # given by _object
    READS: tuple[int, ...]
    SETS: tuple[int, ...]
    READ_COUNT: int
    SET_COUNT: int
    INPUTS: int
    OUTPUTS: int

    def compute(
        t: float, x: Array[float], u: Array[float], d: Array[float], p: Array[float], y: Array[float]
    ) -> None:
        """The function."""


# ---- the loops ----------------------------------------------------------------------------------


def through(
    evaluations: Array[Evaluation],
    shape: Array[int],
    times: Array[float],
    world: Array[float],
    room: Array[float],
) -> None:
    """Make some evaluations in order, each at all times. `shape` holds the number of evaluations and of times.

    `world` has a row of times for each number that is read or made; `room` holds one element's numbers.
    """
    for k in range(shape[0]):
        invoke(evaluations[k].code, evaluations[k], times, shape[1], world, room)


def each(e: Evaluation, times: Array[float], count: int, world: Array[float], room: Array[float]) -> float:
    """One evaluation at all times: `room` has its states, inputs and outputs one after the other."""
    u = at(room, INPUTS)
    y = at(room, OUTPUTS)
    for m in range(count):
        for k in unroll(READ_COUNT):
            room[READS[k]] = world[e.places[k] * count + m]
        compute(times[m], room, u, room, e.p, y)
        for k in unroll(SET_COUNT):
            world[e.targets[k] * count + m] = y[SETS[k]]
    return 0.0


# ---- functions ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Task:
    """A function of a class, `observe` (part -1) or that of an out part, as it is evaluated."""

    kind: Class
    part: int

    @property
    def function(self) -> Callable[..., None]:
        """The function (t, x, u, d, p, y)."""
        found = self.kind.observe if self.part < 0 else self.kind.parts[self.part].function
        assert found is not None
        return found

    @property
    def sets(self) -> tuple[int, ...]:
        """The entries of y that it sets."""
        return tuple(range(self.kind.observed)) if self.part < 0 else self.kind.parts[self.part].outs

    @property
    def reads(self) -> tuple[int, ...]:
        """What it looks at: states k, and inputs k as n + k."""
        return _reads(self.function, len(self.kind.states))

    @property
    def size(self) -> int:
        """States, inputs and outputs."""
        outputs = self.kind.observed if self.part < 0 else self.kind.outs
        return len(self.kind.states) + self.kind.inputs + outputs

    @property
    def calls_back(self) -> bool:
        """Whether it calls an extern that is not compiled in."""
        return any(isinstance(c, Extern) and isinstance(c.translation, str) for c in self.callees.values())

    @property
    def callees(self) -> dict[str, callees.Callee]:
        """The tables and externs that it calls."""
        return callees.called(self.function)


@functools.cache
def _reads(function: Callable[..., None], states: int) -> tuple[int, ...]:
    found = set()
    for node in ast.walk(parse_function(function)):
        match node:
            case ast.Subscript(value=ast.Name(id="x"), slice=ast.Constant(value=int(k))):
                found.add(k)
            case ast.Subscript(value=ast.Name(id="u"), slice=ast.Constant(value=int(k))):
                found.add(states + k)
    return tuple(sorted(found))


@functools.cache
def machine_code(task: Task) -> tuple[int, Loaded]:
    """The address of a function's loop over times, and what keeps it in memory."""
    content = [runtime_digest(), repr((task.reads, task.sets, len(task.kind.states), task.kind.inputs))]
    content.append(text_of(task.function))
    content += [f"{name}: {callees.description(callee)}" for name, callee in task.callees.items()]
    text = "\n".join(content)
    label = "b" + hashlib.sha256(text.encode()).hexdigest()[:16]
    made = cached(cache_folder("objects"), text, functools.partial(_object, label, task), None, "")
    code = Loaded([made[1]])
    return code.address(label), code


def _object(label: str, task: Task) -> tuple[dict[str, Any], Unit]:
    check_class(task.kind)
    unit = Unit(label)
    unit.callees.update(callees.emit(unit, label, task.callees))
    types: dict[str, Type] = {"t": Float(), **dict.fromkeys("xudpy", Pointer(Float()))}
    function = unit.model_function(parse_function(task.function), types, 1)
    inputs = len(task.kind.states)
    names = {
        "READS": task.reads,
        "SETS": task.sets,
        "READ_COUNT": len(task.reads),
        "SET_COUNT": len(task.sets),
        "INPUTS": inputs,
        "OUTPUTS": inputs + task.kind.inputs,
        "compute": Emitted(function, tuple(types.values()), None),
    }
    unit.lower(each, constants=names, export=label)
    return {}, unit


@functools.cache
def driver() -> tuple[Callable[..., None], Loaded]:
    """`through`, to be called with addresses, and what keeps it in memory."""

    def made() -> tuple[dict[str, Any], Unit]:
        unit = Unit("batch")
        unit.lower(through, export="through")
        return {}, unit

    code = Loaded([cached(cache_folder("objects"), f"batch {runtime_digest()}", made, None, "")[1]])
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(code.address("through")), code
