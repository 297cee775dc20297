"""What the steps of a method cost in floating-point operations, counted in its very text.

The kernel, the steps and their pieces are plain Python as well as machine code. Here they run as Python on numbers that count (`counting.py`), over the
beginning of a run: that tells what a call of each kind costs in each group. How many calls a whole run makes, its own counters tell. Right-hand sides and
Jacobians are not run but counted in their text; what depends on time and inputs alone counts once a step.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from counting import ELEMENTARY, Floats, Meter, Number, dialect, floats

from hierc.runtime import control, kernel, records, segments
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.machine.split import split
from hierc.runtime.machine.types import Emitted, LaneConstant, LaneTable
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.methods import abm5, abm5_pieces, explicit, radau, radau_pieces
from hierc.runtime.methods.abm5 import ABM5
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.methods.explicit import Explicit
from hierc.runtime.methods.radau import Radau
from hierc.runtime.simulation import Simulation

#: The modules that make a step, those that others import from first.
MODULES: dict[type, tuple[ModuleType, ...]] = {
    Radau: (control, segments, radau_pieces, radau),
    Explicit: (control, segments, explicit),
    ABM5: (control, segments, explicit, abm5_pieces, abm5),
}
#: Segments that a counted run has room for.
_ROOM = 4000


# ---- in the text --------------------------------------------------------------------------------


def flops(code: ast.AST) -> int:
    """Operations of a function of a generated module, the costlier branch of each `if`."""
    match code:
        case ast.If(test=test, body=body, orelse=orelse):
            return flops(test) + max(sum(map(flops, body)), sum(map(flops, orelse)))
        case ast.IfExp(test=test, body=then, orelse=other):
            return flops(test) + max(flops(then), flops(other))
        case ast.BinOp() | ast.Compare():
            own = 1
        case ast.Call(func=ast.Attribute(attr=name)):
            own = 1 if name in ("fabs", "floor", "ceil", "copysign") else ELEMENTARY
        case ast.Call(func=ast.Name(id=name)):
            own = 1 if name in ("abs", "max", "min") else ELEMENTARY  # a table or an extern
        case ast.Subscript():
            return 0
        case _:
            own = 0
    return own + sum(flops(child) for child in ast.iter_child_nodes(code))


def halves(function: Callable[..., None]) -> tuple[int, int]:
    """Operations of a right-hand side: what time and inputs decide, and what the states do."""
    parts = split(parse_function(function), "dx", lambda array, _: array != "x")
    return flops(parts.before), flops(parts.after)


def wired(simulation: Simulation, g: int) -> tuple[Wiring, int]:
    """The wiring of a group, and the group's row in it."""
    return next((w, int(np.argmax(w.places == g))) for w in simulation.wiring if (w.places == g).any())


# ---- a group in Python --------------------------------------------------------------------------


class Equations:
    """The functions of a group of one node, by the names that the pieces use. They compute in plain floats, which count nothing; their calls are counted."""

    def __init__(self, simulation: Simulation, g: int, meter: Meter) -> None:
        form = wired(simulation, g)[0].form
        (self.call,) = form.calls
        self.publishing, self.published = form.publishing, form.published
        self.kind = simulation.elements.plan.classes[self.call.kind]
        self.n, self.meter = form.states, meter
        method = METHODS[simulation.settings[g].method]
        if isinstance(method, Radau):
            half = method.lanes // 2
            values = np.array(method.tables.eigenvalues)
            self.eigenvalues, self.middle = values[:half] + 1j * values[half:], method.tables.stages // 2
        self.matrices: list[np.ndarray[Any, Any]] = []

    def functions(self, g: int) -> dict[str, Callable[..., Any]]:
        """All of them, metered."""
        names = ("rhs_fixed", "rhs", "publish", "factor", "solve", "solve_real", "solve_lanes")
        return {name: self.meter.wrap(g, name, getattr(self, name)) for name in names}

    def _apply(self, function: Callable[..., None], count: int, t: Any, x: Any, u: Any, p: Any) -> Any:
        rows = [channel for _, channel in self.call.sources]
        times, states, inputs = np.atleast_1d(floats(t)), floats(x[: self.n]), floats(u[rows])
        results = np.full((count, len(times)), np.nan)
        for k, time in enumerate(times.tolist()):
            result = [np.nan] * count
            function(time, states[:, k].tolist(), inputs[:, k].tolist(), [], floats(p).tolist(), result)
            results[:, k] = result
        return results

    def _numbers(self, values: Floats) -> Any:
        return np.frompyfunc(lambda v: Number(float(v), self.meter), 1, 1)(values)

    def rhs_fixed(self, t: Any, u: Any, p: Any, v: Any) -> None:
        """Counted, but done with the rest."""

    def rhs(self, t: Any, x: Any, u: Any, p: Any, dx: Any, v: Any) -> None:
        dx[: self.n] = self._numbers(self._apply(self.kind.rhs, self.n, t, x, u, p))

    def publish(self, t: Any, x: Any, u: Any, p: Any, y: Any) -> None:
        for call in self.publishing:
            part = self.kind.parts[call.part]
            results = self._numbers(self._apply(part.function, self.kind.outs, t, x, u, p))
            for k, out in enumerate(self.published):
                if out in part.outs:
                    y[k] = results[out]

    def factor(self, t: Any, h: Any, x: Any, u: Any, p: Any, v: Any, factors: Any) -> None:
        middle = slice(self.middle, self.middle + 1)
        entries = self._apply(self.kind.jac, len(self.kind.pattern), t, x[:, middle], u[:, middle], p)
        jacobian = np.zeros((self.n, self.n))
        for (i, j), value in zip(self.kind.pattern, entries.ravel(), strict=True):
            if i < self.n and j < self.n:
                jacobian[i, j] = value
        self.matrices = [e * np.eye(self.n) - float(h) * jacobian for e in self.eigenvalues]

    def solve(self, b: Any, factors: Any) -> None:
        half, right = b.shape[1] // 2, floats(b[: self.n])
        for k, matrix in enumerate(self.matrices):
            solution = np.linalg.solve(matrix, right[:, k] + 1j * right[:, half + k])
            b[: self.n, k], b[: self.n, half + k] = self._numbers(solution.real), self._numbers(solution.imag)

    def solve_real(self, b: Any, factors: Any) -> None:
        b[: self.n] = self._numbers(np.linalg.solve(self.matrices[0].real, floats(b[: self.n])))

    solve_lanes = solve_real


def bound(modules: Sequence[ModuleType], names: Mapping[str, Any]) -> dict[str, Any]:
    """The functions that the last of some modules knows, with other globals, as the lowering binds them."""
    made: dict[FunctionType, FunctionType] = {}
    world: dict[str, Any] = {}
    for module in modules:
        world = {**vars(module), **names}
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and name not in names:
                if value.__module__ == module.__name__:
                    made[value] = FunctionType(value.__code__, world, name)
                world[name] = made.get(value, value)
    return world


def _python(value: Any) -> Any:
    match value:
        case LaneConstant(values):
            return np.array(values, object)
        case LaneTable(rows):
            return np.array(rows, object)
    return value


class CountedRun:
    """The beginning of a run of groups of one node each, in Python, on numbers that count."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, self.meter = simulation, Meter()
        count = simulation.elements.groups
        self.groups = [self._group(g) for g in range(count)]
        self.run = SimpleNamespace(**{k: simulation.run[k][0].item() for k in records.Run.fields()})

    def advance(self, attempts: int) -> Meter:
        """Make so many attempts; returns the meter."""
        self.run.budget = attempts
        kernel.advance(self.run, self.groups)  # type: ignore[arg-type]
        return self.meter

    def _array(self, values: Floats) -> Any:
        return np.frompyfunc(lambda v: Number(float(v), self.meter), 1, 1)(values)

    def _group(self, g: int) -> SimpleNamespace:
        """A group's record as an object: numbers, memory, and functions."""
        simulation, meter = self.simulation, self.meter
        settings, (wiring, row) = simulation.settings[g], wired(simulation, g)
        form, method = wiring.form, METHODS[settings.method]
        record = SimpleNamespace()
        for name, kind in records.Group.fields().items():
            value = None if getattr(kind, "__origin__", None) is Array else simulation.groups[name][g].item()
            setattr(record, name, Number(value, meter) if kind is float and value is not None else value)
        classes = simulation.elements.plan.classes
        made = method.names(Composer(Unit("count"), "count", form, classes, parse_function, method.lanes))
        functions = Equations(simulation, g, meter).functions(g)
        names = {k: functions[k] if isinstance(v, Emitted) else _python(v) for k, v in made.names.items()}
        names |= {k: _python(v) for k, v in method.step_names().items()} | dialect(meter)
        reading = bound((control, segments), names)["read_inputs"]
        names["read_inputs"] = meter.wrap(g, "read_inputs", reading)
        world = bound(MODULES[type(method)], names)
        record.step = meter.wrap(g, "step", world["step"])
        for piece in method.pieces:
            setattr(
                record, piece.__name__, meter.wrap(g, _kind(record, piece.__name__), world[piece.__name__])
            )
        n, lanes = form.states, method.lanes
        first = int(simulation.elements.group_offsets[g])
        record.x = self._array(np.concatenate([simulation.initial[first : first + n], np.zeros(n)]))
        record.p = simulation.system.values_of(wiring.values[row])
        record.absolute = self._array(np.full(n, settings.atol))
        record.u = self._array(np.zeros((max(form.inputs, 1) * method.input_rows, lanes)))
        record.work = self._array(np.zeros((-(-made.work // lanes), lanes)))
        record.capacity, record.track = _ROOM, self._array(np.zeros(_ROOM * record.stride))
        owners = wiring.owners[row].tolist()
        record.sources = [
            SimpleNamespace(group=o, first=owners.index(o), count=owners.count(o), cursor=0)
            for o in dict.fromkeys(owners)
        ]
        widths = [METHODS[m].width for m in simulation.settings.methods]
        channels = wiring.channels[row].tolist()
        record.channels = [segments.HEADER + c * widths[o] for o, c in zip(owners, channels, strict=True)]
        return record


def _kind(record: SimpleNamespace, name: str) -> Callable[[], str]:
    """A piece's name, that of a start where a multistep method has no history yet."""
    return lambda: f"{name} at the start" if record.fresh == 0 and name in ("attempt", "accept") else name
