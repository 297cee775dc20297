"""A run from settings to finished trajectories: checks the settings, chooses methods, builds machine code, integrates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice
from hierc.runtime.contract import Plan
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.layout import Layout
from hierc.runtime.machine.forms import Wiring, wire
from hierc.runtime.machine.program import Announce, Program, build
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.result import output_times
from hierc.runtime.simulation import GroupSettings, Simulation, tighten
from hierc.runtime.status import Status
from hierc.runtime.system import System
from hierc.runtime.trajectory import GroupTrajectory

Floats = NDArray[np.float64]
#: Tolerances are tightened by the first for each reading edge, to the second at least.
TIGHTEN = (0.3, 0.03)
#: No tolerance is smaller than some dozen roundings.
LEAST_RTOL = 1e-14
#: Step attempts, for each group, from which the probe learns.
PROBE_ATTEMPTS = 24
#: States that are looked at again after a run that used a table outside its grid.
LOOKED_AT = 100_000
AUTO = "auto"


@dataclass(frozen=True)
class FinishedRun:
    """What a run leaves, as `Result` wants it."""

    system: System
    start: float
    stop: float
    t_reached: float
    status: Status
    groups: tuple[GroupTrajectory, ...]
    warnings: tuple[str, ...] = ()

    @property
    def plan(self) -> Plan:
        """The model's tables."""
        return self.system.plan

    def evaluate(self, paths: Sequence[str], t: Floats) -> dict[str, Floats]:
        """Values (len(t), *shape) of variables, in their declared units, at any times between start and t_reached."""
        variables = {v.path: v for v in self.plan.variables}
        states = np.hstack([g(t) for g in self.groups]) if self.groups else np.zeros((len(t), 0))
        chosen = [variables[p] for p in paths]
        nodes = sorted({n for v in chosen for n, what, _ in v.elements if what == "observed"})
        observed = (
            [self.system.observe(float(time), x, nodes) for time, x in zip(t, states, strict=True)]
            if nodes
            else []
        )
        result = {}
        for variable in chosen:
            columns = [
                states[:, self.system.offsets[node] + index]
                if what == "state"
                else np.array([row[node][index] for row in observed])
                for node, what, index in variable.elements
            ]
            table = np.stack(columns, axis=1) if columns else np.zeros((len(t), 0))
            result[variable.path] = table.reshape((len(t), *variable.shape)) / variable.scale
        return result


@dataclass(frozen=True)
class Engine:
    """What runs of one plan have in common: its wiring, and the machine code built so far."""

    plan: Plan
    programs: dict[tuple[str, ...], Program] = field(default_factory=dict)
    layouts: dict[tuple[str, ...], Layout] = field(default_factory=dict)

    @cached_property
    def wiring(self) -> tuple[Wiring, ...]:
        """How the groups are connected, in cascade order."""
        return wire(self.plan)

    def layout(self, methods: Sequence[str]) -> Layout:
        """Where the memory lies of runs with these methods."""
        key = tuple(methods)
        if key not in self.layouts:
            self.layouts[key] = Layout(self.plan, self.wiring, key, self.program(key, None))
        return self.layouts[key]

    def program(self, methods: Sequence[str], announce: Announce | None) -> Program:
        """Machine code for these methods, one a group."""
        key = tuple(methods)
        if key not in self.programs:
            wanted = [(w.form, method) for w, method in zip(self.wiring, methods, strict=True)]
            self.programs[key] = build(self.plan.classes, wanted, announce)
        return self.programs[key]

    def run(
        self,
        system: System,
        settings: Mapping[str, Any],
        groups: Mapping[str, Mapping[str, Any]],
        most_steps: int | None = None,
        progress: Callable[[float], None] | None = None,
        announce: Announce | None = None,
    ) -> FinishedRun:
        """Integrate a system of this plan.

        `settings` holds start stop rtol atol method max_step min_step, `groups` what differs for single groups. Raises ValueError for settings that
        do not fit; a run that fails says so in its status.
        """
        start, stop = _finite("start", settings["start"]), _finite("stop", settings["stop"])
        if not stop > start:
            raise SettingError(f"stop ({stop:g} s) must be later than start ({start:g} s)")
        output_times(
            start, stop, settings.get("interval")
        )  # an impossible interval is refused before a long run
        chosen = group_settings(self.plan, self.wiring, settings, groups)
        try:
            x = system.initial(start)
        except ExternError as error:
            return FinishedRun(
                system, start, stop, start, Status("EXTERN_FAILED", f"at the start {error}"), ()
            )
        if not np.isfinite(x).all():
            return _bad_start(system, x, start, stop)
        simulation = self._begin(system, chosen, start, stop, announce)
        status = simulation.advance(progress, most_steps)
        trajectories = simulation.trajectories()
        warnings = (*self._slow(simulation.program), *self._excursions(system, start, trajectories))
        return FinishedRun(system, start, stop, simulation.reached, status, trajectories, warnings)

    def _begin(
        self,
        system: System,
        chosen: list[GroupSettings],
        start: float,
        stop: float,
        announce: Announce | None,
    ) -> Simulation:
        """A run about to begin, its methods chosen. Where the probe's methods stay, the probe is the run's beginning."""
        probing = [replace(s, method=choice.FAVOURITE) if s.method == AUTO else s for s in chosen]
        probe = Simulation(self, system, probing, start, stop, announce)
        if all(s.method != AUTO for s in chosen):
            return probe
        try:
            probe.attempt(PROBE_ATTEMPTS * len(chosen))
            decided = [
                replace(s, method=choice.choose(learnt)) if s.method == AUTO else s
                for s, learnt in zip(chosen, probe.learn(), strict=True)
            ]
        except ExternError:
            return probe  # going on with it tells of the failure
        return probe if decided == probing else Simulation(self, system, decided, start, stop, announce)

    def _excursions(self, system: System, start: float, trajectories: Sequence[GroupTrajectory]) -> list[str]:
        """What is to be said of tables that were used outside their grids.

        Machine code tells whether any was, in steps that were given up too; so the steps that were kept are looked at again.
        """
        if not self.plan.tables:
            return []
        marked = [program.links.marked() for program in self.programs.values()]
        for table in self.plan.tables:
            table.outside[:] = [0] * len(table.outside)
        again = System(self.plan, system.parameters)
        with suppress(ExternError):
            again.initial(start)
            if any(marked):
                knots = np.unique(np.concatenate([g.knots for g in trajectories]))
                most = min(max(LOOKED_AT // max(system.size, 1), 20), 1000)
                times = knots[np.unique(np.linspace(0, len(knots) - 1, most).astype(int))]
                states = np.hstack([g(times) for g in trajectories])
                for time, x in zip(times, states, strict=True):
                    again.rhs(float(time), x)
        return [
            f"table `{table.name}` was used outside its grid ({', '.join(places)}): there it has the value of its edge"
            for table in self.plan.tables
            if (places := table.excursions(table.outside))
        ]

    def _slow(self, program: Program) -> list[str]:
        """What is to be said, once, of externs that are called back."""
        new = [extern for extern in program.links.called_back if not extern.told]
        for extern in new:
            extern.told = True
        return [
            f"extern `{extern.name}` ({extern.target}) is called in Python, which is slow, as it cannot be compiled: {extern.translation}"
            for extern in new
        ]


def group_settings(
    plan: Plan, wiring: Sequence[Wiring], settings: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]
) -> list[GroupSettings]:
    """Settings of every group, checked, its tolerances tightened for those who read it. Raises ValueError."""
    factors = tighten(plan, wiring, *TIGHTEN)
    result = []
    for group, factor in zip(plan.groups, factors, strict=True):
        own = groups.get(group.name, {})
        merged = {**settings, **own}
        if "rtol" in own and "atol" not in own:
            merged["atol"] = own["rtol"]
        rtol, atol = _positive("rtol", merged["rtol"]), _positive("atol", merged["atol"])
        if rtol < LEAST_RTOL:
            raise SettingError(f"rtol must be at least {LEAST_RTOL:g}, not {rtol!r}: doubles hold no more")
        method = merged["method"]
        if method not in METHODS and method != AUTO:
            raise SettingError(f"unknown method `{method}`; there are {AUTO}, {', '.join(METHODS)}")
        max_step = math.inf if merged["max_step"] == math.inf else _positive("max_step", merged["max_step"])
        result.append(
            GroupSettings(
                method,
                max(rtol * factor, LEAST_RTOL),
                atol * factor,
                max_step,
                _finite("min_step", merged["min_step"]),
            )
        )
    return result


def _finite(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SettingError(f"{name} must be a finite number, not {value!r}")
    return float(value)


def _positive(name: str, value: object) -> float:
    number = _finite(name, value)
    if not number > 0:
        raise SettingError(f"{name} must be positive, not {value!r}")
    return number


def _bad_start(system: System, x: Floats, start: float, stop: float) -> FinishedRun:
    k = int(np.argmax(~np.isfinite(x)))
    name, place = system.state_at(k)
    where = f" ({place})" if place else ""
    status = Status("BAD_START", f"the initial value of `{name}`{where} is not a finite number")
    return FinishedRun(system, start, stop, start, status, ())
