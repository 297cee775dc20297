"""The kernel, the steps and their pieces run as the Python they are, numpy arrays for lanes, beside the machine code made from them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from running import METHODS as NAMES
from small_models import ARM, OSCILLATOR, VAN_DER_POL, At, a_class, a_model

from hierc.runtime import kernel, records
from hierc.runtime.machine.calls import CallForm
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array
from hierc.runtime.machine.types import Emitted, LaneConstant, LaneTable
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.methods import abm5, abm5_pieces, adams, adams_pieces, explicit, fit, radau, radau_pieces
from hierc.runtime.methods.abm5 import ABM5
from hierc.runtime.methods.adams import Adams
from hierc.runtime.methods.catalogue import METHODS, every_method
from hierc.runtime.methods.explicit import Explicit
from hierc.runtime.methods.fit import Fit
from hierc.runtime.methods.radau import Radau
from hierc.runtime.model import Model
from hierc.runtime.segments import HEADER
from hierc.runtime.simulation import Simulation

Floats = NDArray[np.float64]
ROOM = 256
#: The modules that make each kind of method, those that others import from first.
MODULES: dict[type, tuple[ModuleType, ...]] = {
    Radau: (radau_pieces, radau),
    Explicit: (explicit,),
    Adams: (adams_pieces, adams),
    ABM5: (explicit, abm5_pieces, abm5),
    Fit: (fit,),
}


def bound(modules: Sequence[ModuleType], names: dict[str, Any]) -> dict[str, Any]:
    """The functions that the last of some modules knows, with other globals, as the lowering binds them."""
    made: dict[FunctionType, FunctionType] = {}
    world: dict[str, Any] = {}
    for module in modules:
        world = {**vars(module), **names}
        for name, value in vars(module).items():
            if isinstance(value, FunctionType):
                if value.__module__ == module.__name__:
                    made[value] = FunctionType(value.__code__, world, name)
                world[name] = made.get(value, value)
    return world


class Equations:
    """A group of one node in plain Python: what `compose.py` emits, by the names that the pieces use."""

    def __init__(self, simulation: Simulation, g: int) -> None:
        form = simulation.wiring[g].form
        self.call: CallForm = form.calls[-1]
        self.publishing, self.published = form.publishing, form.published
        self.kind = simulation.elements.plan.classes[self.call.kind]
        self.method = every_method()[simulation.settings[g].method]
        self.n = form.states
        if isinstance(self.method, Radau):
            self.eigenvalues = np.array(self.method.tables.eigenvalues)
            self.middle = self.method.tables.stages // 2
        self.matrices: list[NDArray[np.complex128]] = []

    def _apply(
        self, function: Callable[..., None], count: int, t: Floats, x: Floats, u: Floats, p: Floats
    ) -> Floats:
        """A class's function lane by lane: results (count, lanes)."""
        rows = [channel for _, channel in self.call.sources]
        results = np.full((count, len(t)), np.nan)
        for k, time in enumerate(t.tolist()):
            result = [np.nan] * count
            function(time, x[: self.n, k].tolist(), u[rows, k].tolist(), [], p.tolist(), result)
            results[:, k] = result
        return results

    def rhs_fixed(self, t: Floats, u: Floats, p: Floats, v: Floats) -> None:
        pass

    def rhs(self, t: Floats, x: Floats, u: Floats, p: Floats, dx: Floats, v: Floats) -> None:
        dx[: self.n] = self._apply(self.kind.rhs, self.n, t, x, u, p)

    def publish(self, t: Floats, x: Floats, u: Floats, p: Floats, y: Floats) -> None:
        for call in self.publishing:
            part = self.kind.parts[call.part]
            results = self._apply(part.function, self.kind.outs, t, x, u, p)
            for k, out in enumerate(self.published):
                if out in part.outs:
                    y[k] = results[out]

    def factor(self, t: float, h: float, x: Floats, u: Floats, p: Floats, v: Floats, factors: Floats) -> None:
        middle = slice(self.middle, self.middle + 1)
        values = self._apply(
            self.kind.jac, len(self.kind.pattern), np.array([t]), x[:, middle], u[:, middle], p
        ).ravel()
        jacobian = np.zeros((self.n, self.n))
        for (i, j), value in zip(self.kind.pattern, values, strict=True):
            if i < self.n and j < self.n:
                jacobian[i, j] = value
        half = len(self.eigenvalues) // 2
        packed = self.eigenvalues[:half] + 1j * self.eigenvalues[half:]
        self.matrices = [e * np.eye(self.n) - h * jacobian for e in packed]

    def solve(self, b: Floats, factors: Floats) -> None:
        half = b.shape[1] // 2
        for k, matrix in enumerate(self.matrices):
            solution = np.linalg.solve(matrix, b[: self.n, k] + 1j * b[: self.n, half + k])
            b[: self.n, k], b[: self.n, half + k] = solution.real, solution.imag

    def solve_real(self, b: Floats, factors: Floats) -> None:
        b[: self.n] = np.linalg.solve(self.matrices[0].real, b[: self.n])

    solve_lanes = solve_real


def python_value(value: Any) -> Any:
    match value:
        case LaneConstant(values):
            return np.array(values)
        case LaneTable(rows):
            return np.array(rows)
    return value


def python_group(simulation: Simulation, g: int) -> SimpleNamespace:
    """A group's record as an object: numbers from the machine's own record, memory as numpy arrays, pieces as functions."""
    settings, form = simulation.settings[g], simulation.wiring[g].form
    method = every_method()[settings.method]
    record = SimpleNamespace()
    for name, kind in records.Group.fields().items():
        is_array = getattr(kind, "__origin__", None) is Array
        setattr(record, name, None if is_array else simulation.groups[name][g].item())
    composer = Composer(
        Unit("oracle"), "oracle", form, simulation.elements.plan.classes, parse_function, method.lanes
    )
    made = method.names(composer)
    equations = Equations(simulation, g)
    names = {
        k: getattr(equations, k) if isinstance(v, Emitted) else python_value(v) for k, v in made.names.items()
    }
    names |= {k: python_value(v) for k, v in method.step_names().items()}
    functions = bound(MODULES[type(method)], names)
    for piece in (method.step, *method.pieces):
        setattr(record, piece.__name__, functions[piece.__name__])
    n = form.states
    wiring = simulation.wiring[g]
    first = int(simulation.elements.group_offsets[g])
    record.x = np.concatenate([simulation.initial[first : first + n], np.zeros(n)])
    record.p = simulation.system.values_of(wiring.values[0])
    record.absolute = np.full(n, settings.atol)
    record.u = np.zeros(max(form.inputs, 1) * max(method.input_rows, 1) * 2).reshape(-1, method.lanes)
    record.work = np.zeros(-(-made.work // method.lanes) * method.lanes).reshape(-1, method.lanes)
    record.capacity = ROOM
    record.track = np.zeros(ROOM * record.stride)
    owners = wiring.owners[0].tolist()
    record.sources = [
        SimpleNamespace(group=o, first=owners.index(o), count=owners.count(o), cursor=0)
        for o in dict.fromkeys(owners)
    ]
    widths = [every_method()[m].width for m in simulation.settings.methods]
    record.channels = [
        HEADER + c * widths[o] for o, c in zip(owners, wiring.channels[0].tolist(), strict=True)
    ]
    return record


@pytest.fixture(autouse=True)
def _exact_newton(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's iteration goes on until nothing of where it began is left."""
    for name, method in METHODS.items():
        if isinstance(method, Radau):
            monkeypatch.setitem(METHODS, name, replace(method, newton_tolerance=1e-7))


COUNTERS = (
    "count", "steps", "rejected", "evaluations", "iterations", "jacobians", "failures", "fresh", "spacings",
)  # fmt: skip


def beside(model: Model, methods: Sequence[str], attempts: int) -> None:
    """Both make so many attempts; then their records and segments agree.

    Steps are kept equal: free ones follow error estimates, which are small differences and agree to a few digits only.
    """
    settings = {"rtol": 1e-3, "atol": 1e-3, "method": "radau9", "max_step": 0.06, "min_step": 0.0}
    names = [g.name for g in model.plan.groups]
    overrides = {name: {"method": method} for name, method in zip(names, methods, strict=True)}
    overrides[names[0]]["max_step"] = 0.04
    chosen = model.engine.group_settings(settings, overrides)
    simulation = Simulation(model.engine, model.system(), chosen, model.initial(), 0.0, 0.5)
    groups = [python_group(simulation, g) for g in range(len(names))]
    run = SimpleNamespace(**{k: simulation.run[k][0].item() for k in records.Run.fields()})
    run.budget = attempts
    outcome = kernel.advance(run, groups)
    assert outcome == simulation.attempt(attempts)
    assert run.group == simulation.run["group"][0]
    assert run.window == pytest.approx(simulation.run["window"][0], rel=1e-12)
    for g, record in enumerate(groups):
        machine = {name: simulation.groups[name][g] for name in records.Group.fields()}
        assert {k: getattr(record, k) for k in COUNTERS} == {k: machine[k] for k in COUNTERS}
        for name in ("t", "trial", "previous", "last_size"):
            assert getattr(record, name) == pytest.approx(machine[name], rel=1e-12), name
        used = record.count * record.stride
        track = simulation.tracks.array(g)[:used].reshape(-1, record.stride)
        assert record.track[:used].reshape(-1, record.stride) == pytest.approx(track, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("method", NAMES)
def test_one_group(method: str) -> None:
    model = a_model({"v": At(VAN_DER_POL, (), 1)}, None, {"v.mu": 3.0})
    beside(model, [method], 12)


@pytest.mark.parametrize("writer", NAMES)
@pytest.mark.parametrize("reader", NAMES)
def test_a_reader_and_its_writer(writer: str, reader: str) -> None:
    """Inputs from states and from a published out."""
    nodes = {
        "o": At(OSCILLATOR, (), 1),
        "a": At(ARM, ((0, "state", 0), (0, "state", 1)), 2),
        "b": At(ARM, ((1, "out", 1), (0, "state", 1)), 2),
    }
    model = a_model(nodes, None, {"o.w": 2.0, "a.k": 1.0, "a.d": 0.5, "b.k": 2.0, "b.d": 0.3})
    for attempts in (1, 9, 30, 1000):  # paused at different places, and to the end
        beside(model, [writer, writer, reader], attempts)


#: A product of two inputs and the time.
PRODUCT = a_class(
    "Product",
    {},
    {(0, 0): "u[1]*t", (0, 1): "u[0]*t"},
    inputs=2,
    outs=[("u[0]*u[1]*t", (0, 1))],
)


@pytest.mark.parametrize("method", NAMES)
def test_a_group_without_states(method: str) -> None:
    """It reads a state and a published out, and is read."""
    nodes = {
        "o": At(OSCILLATOR, (), 1),
        "a": At(ARM, ((0, "state", 0), (0, "state", 1)), 2),
        "p": At(PRODUCT, ((0, "state", 0), (1, "out", 1))),
        "b": At(ARM, ((2, "out", 0), (0, "state", 1)), 2),
    }
    groups = {name: [name] for name in nodes}
    model = a_model(nodes, groups, {"o.w": 2.0, "a.k": 1.0, "a.d": 0.5, "b.k": 2.0, "b.d": 0.3})
    for attempts in (4, 30, 1000):
        beside(model, [method] * 4, attempts)
