"""A run from settings to finished trajectories: checks the settings, chooses methods, builds machine code, integrates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.contract import Plan
from hierc.runtime.machine.forms import Wiring, wire
from hierc.runtime.machine.program import build
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.simulation import GroupSettings, Simulation, tighten
from hierc.runtime.status import Status
from hierc.runtime.system import System
from hierc.runtime.trajectory import GroupTrajectory

Floats = NDArray[np.float64]
#: Tolerances are tightened by the first for each reading edge, to the second at least.
TIGHTEN = (0.3, 0.03)


@dataclass(frozen=True)
class FinishedRun:
    """What a run leaves, as `Result` wants it."""

    system: System
    start: float
    stop: float
    t_reached: float
    status: Status
    groups: tuple[GroupTrajectory, ...]

    @property
    def plan(self) -> Plan:
        return self.system.plan

    def evaluate(self, paths: Sequence[str], t: Floats) -> dict[str, Floats]:
        """Values (len(t), *shape) of variables at any times between start and t_reached."""
        variables = {v.path: v for v in self.plan.variables}
        states = np.hstack([g(t) for g in self.groups]) if self.groups else np.zeros((len(t), 0))
        chosen = [variables[p] for p in paths]
        nodes = sorted({n for v in chosen for n, what, _ in v.elements if what == "observed"})
        observed = [self.system.observe(float(time), x, nodes) for time, x in zip(t, states, strict=True)] if nodes else []
        result = {}
        for variable in chosen:
            columns = [
                states[:, self.system.offsets[node] + index]
                if what == "state"
                else np.array([row[node][index] for row in observed])
                for node, what, index in variable.elements
            ]
            table = np.stack(columns, axis=1) if columns else np.zeros((len(t), 0))
            result[variable.path] = table.reshape((len(t), *variable.shape))
        return result


def run(
    system: System,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    most_steps: int | None = None,
    progress: Callable[[float], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> FinishedRun:
    """Integrate a system. `settings` holds start stop rtol atol method max_step min_step, `groups` what differs for single groups."""
    plan = system.plan
    start, stop = _finite("start", settings["start"]), _finite("stop", settings["stop"])
    if not stop > start:
        raise ValueError(f"stop ({stop:g} s) must be later than start ({start:g} s)")
    wiring = wire(plan)
    chosen = _group_settings(plan, wiring, settings, groups)
    x = system.initial(start)
    if not np.isfinite(x).all():
        return _bad_start(system, x, start, stop)
    program = build(plan.classes, [(w.form, s.method) for w, s in zip(wiring, chosen, strict=True)], announce)
    simulation = Simulation(system, wiring, program, chosen, start, stop)
    status = simulation.advance(progress, most_steps)
    return FinishedRun(system, start, stop, simulation.reached, status, simulation.trajectories())


def _group_settings(
    plan: Plan, wiring: Sequence[Wiring], settings: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]
) -> list[GroupSettings]:
    factors = tighten(plan, wiring, *TIGHTEN)
    result = []
    for group, factor in zip(plan.groups, factors, strict=True):
        own = groups.get(group.name, {})
        merged = {**settings, **own}
        if "rtol" in own and "atol" not in own:
            merged["atol"] = own["rtol"]
        rtol, atol = _positive("rtol", merged["rtol"]), _positive("atol", merged["atol"])
        method = merged["method"]
        if method == "auto":
            method = "radau9"
        if method not in METHODS:
            raise ValueError(f"unknown method `{method}`; there are auto, {', '.join(METHODS)}")
        max_step = math.inf if merged["max_step"] == math.inf else _positive("max_step", merged["max_step"])
        result.append(GroupSettings(method, rtol * factor, atol * factor, max_step, float(merged["min_step"])))
    return result


def _finite(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, not {value!r}")
    return float(value)


def _positive(name: str, value: object) -> float:
    number = _finite(name, value)
    if not number > 0:
        raise ValueError(f"{name} must be positive, not {value!r}")
    return number


def _bad_start(system: System, x: Floats, start: float, stop: float) -> FinishedRun:
    k = int(np.argmax(~np.isfinite(x)))
    for node, first in system.offsets.items():
        kind = system.kind(node)
        if first <= k < first + len(kind.states):
            path = system.plan.nodes[node].path
            name = f"{path}.{kind.states[k - first]}" if path else kind.states[k - first]
    status = Status("BAD_START", f"the initial value of `{name}` is not a finite number ({x[k]!r})")
    return FinishedRun(system, start, stop, start, status, ())
