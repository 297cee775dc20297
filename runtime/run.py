"""A run from settings to finished trajectories: checks the settings, chooses methods, builds machine code, integrates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice
from hierc.runtime.columns import distinct, labelled
from hierc.runtime.contract import Plan
from hierc.runtime.elements import Elements, expand
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.families import group_catalogue
from hierc.runtime.layout import Layout, cohorts
from hierc.runtime.machine.calls import Form
from hierc.runtime.machine.forms import Wiring, wire
from hierc.runtime.machine.program import Announce, Program, build
from hierc.runtime.methods.catalogue import METHODS, STATELESS
from hierc.runtime.observation import Variables, evaluate
from hierc.runtime.origin import Origin
from hierc.runtime.paths import PathError
from hierc.runtime.regroup import regrouped
from hierc.runtime.result import check_interval
from hierc.runtime.simulation import GroupSettings, Settings, Simulation, of_group, tighten
from hierc.runtime.status import Status
from hierc.runtime.system import System
from hierc.runtime.trajectory import Trajectories

if TYPE_CHECKING:
    from hierc.runtime.grouping import Decision

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Tolerances are tightened by the first for each reading edge, to the second at least.
TIGHTEN = (0.3, 0.03)
#: No tolerance is smaller than some dozen roundings.
LEAST_RTOL = 1e-14
#: Step attempts, for each group, from which the probe learns.
PROBE_ATTEMPTS = 24
#: States that are looked at again after a run that used a table outside its grid.
LOOKED_AT = 100_000
#: Groups of a wiring, spread evenly, that stand for all of them when a method is chosen.
REPRESENTATIVES = 3
#: Choices of methods that are remembered.
REMEMBERED = 16


@dataclass(frozen=True)
class FinishedRun:
    """What a run leaves, as `Result` wants it."""

    variables: Variables
    system: System
    start: float
    stop: float
    t_reached: float
    status: Status
    groups: Trajectories
    warnings: tuple[str, ...] = ()
    clocks: Integers | None = None  # of a run with timers: (groups, parts, 2), see `machine/timing.py`
    origin: Origin | None = None

    @property
    def plan(self) -> Plan:
        """The model's tables."""
        return self.system.plan

    @property
    def compiled(self) -> Elements:
        """The model's elements in groups as they were compiled."""
        return self.variables.elements if self.origin is None else self.origin.elements

    @property
    def joined(self) -> dict[str, int]:
        """The places of the groups that others, by their names as the model has them, are part of."""
        return {} if self.origin is None else dict(self.origin.names())

    def evaluate(self, names: Sequence[str], t: Floats) -> dict[str, Floats]:
        """Values (len(t), *shape) of variables, in their declared units, at any times between start and t_reached.

        A name stands for a variable, of some or all elements of an array (see `paths`), whose numbers then go before its shape.
        """
        return evaluate(self.variables, self.system, self.groups, names, t)


@dataclass(frozen=True)
class Engine:
    """What runs of one plan have in common: its wiring, and the machine code built so far."""

    plan: Plan
    programs: dict[tuple[str, ...], Program] = field(default_factory=dict)
    layouts: dict[tuple[str, ...], Layout] = field(default_factory=dict)
    decided: dict[object, Settings] = field(default_factory=dict)
    #: Of a plan whose groups are made from another's: what they come from.
    origin: Origin | None = None
    regrouped: dict[object, Engine] = field(default_factory=dict)
    groupings: dict[object, Decision | None] = field(default_factory=dict)
    #: Whether its machine code has timers.
    timed: bool = False

    def with_groups(self, partition: Integers) -> Engine:
        """The engine of the same model in other groups, those of a partition of its elements (see `regroup`)."""
        if np.array_equal(partition, self.elements.home):
            return self
        key = (partition.tobytes(), self.timed)
        if key not in self.regrouped:
            plan = regrouped(self.elements, partition)
            self.regrouped[key] = Engine(plan, origin=Origin(self.elements, partition), timed=self.timed)
        return self.regrouped[key]

    @cached_property
    def with_timers(self) -> Engine:
        """The same engine, with timers in its machine code."""
        return replace(self, programs={}, layouts={}, timed=True)

    @cached_property
    def elements(self) -> Elements:
        """The plan's tables, expanded."""
        return expand(self.plan)

    @cached_property
    def wiring(self) -> tuple[Wiring, ...]:
        """How the groups are connected."""
        return wire(self.elements)

    @cached_property
    def variables(self) -> Variables:
        """The plan's variables by name."""
        return Variables(self.elements)

    @cached_property
    def tightened(self) -> tuple[list[float], Integers]:
        """The factors on tolerances that there are, and which of them each group has."""
        return tighten(self.elements, self.wiring, *TIGHTEN)

    def layout(self, methods: Sequence[str]) -> Layout:
        """Where the memory lies of runs with these methods, one a group."""
        key = tuple(methods)
        if key not in self.layouts:
            self.layouts[key] = Layout(self.elements, self.wiring, key, self.program(key, None))
        return self.layouts[key]

    def program(self, methods: Sequence[str], announce: Announce | None) -> Program:
        """Machine code for these methods, one a group."""
        key = tuple(methods)
        if key not in self.programs:
            wanted = [
                (w.form, m) for w in self.wiring for m in dict.fromkeys(key[g] for g in w.places.tolist())
            ]
            self.programs[key] = build(self.plan.classes, wanted, announce, timed=self.timed)
        return self.programs[key]

    def program_for(self, form: Form, method: str) -> Program:
        """Machine code for one form under one method, beside that of the others."""
        key = (method, repr(form))
        if key not in self.programs:
            self.programs[key] = build(self.plan.classes, [(form, method)], timed=self.timed)
        return self.programs[key]

    def equations(self, system: System) -> System:
        """A system of this model, with its parameters, in the groups that are here."""
        return System(self.plan, system.parameters, self.elements)

    def group_settings(
        self, settings: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]
    ) -> Settings:
        """Settings of every group, checked, its tolerances tightened for those who read it. Raises ValueError.

        A name in `groups` stands for one group, `car[3]`, or for several, `car`; the one that means fewer goes before. Groups without states have a way of
        their own, whatever method is asked for.
        """
        factors, depths = self.tightened
        variants, of = self.own_settings(settings, groups)
        moving = self.elements.group_states > 0
        sets, labels = labelled((of * len(factors) + depths) * 2 + moving)
        made = []
        for pair, moves in (divmod(number, 2) for number in sets.tolist()):
            variant, depth = divmod(pair, len(factors))
            decided = _settings(of_group(settings, variants[variant]), factors[depth])
            made.append(decided if moves else replace(decided, method=STATELESS))
        return Settings(tuple(made), labels)

    def own_settings(
        self, settings: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]
    ) -> tuple[list[dict[str, Any]], Integers]:
        """The distinct sets of settings that groups have of their own, beside those for all, and which each group has; see `group_settings`."""
        if self.origin is None:
            return own_settings(self.elements, groups)
        variants, of = own_settings(self.origin.elements, groups)
        return self.origin.joined(settings, variants, of)

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

        `settings` holds start stop rtol atol method max_step min_step threads, `groups` what differs for single groups. Raises ValueError for settings that
        do not fit; a run that fails says so in its status.
        """
        start, stop = span(settings)
        check_interval(start, stop, settings.get("interval"))  # before a long run
        threads = settings.get("threads", 1)
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise SettingError(f"threads must be a whole number of at least 1, not {threads!r}")
        chosen = self.group_settings(settings, groups)
        try:
            x = system.initial(start)
        except ExternError as error:
            status = Status("EXTERN_FAILED", f"at the start {error}")
            return self._nothing(system, np.full(system.size, np.nan), start, stop, status)
        if not np.isfinite(x).all():
            return self._nothing(system, x, start, stop, _bad_start(system, x))
        simulation = self.begin(system, chosen, x, start, stop, announce)
        status = simulation.advance(progress, most_steps, threads)
        trajectories = simulation.trajectories()
        warnings = (*self._slow(simulation.program), *self._excursions(system, start, trajectories))
        return FinishedRun(
            self.variables,
            system,
            start,
            stop,
            simulation.reached,
            status,
            trajectories,
            warnings,
            simulation.clocks,
            self.origin,
        )

    def _nothing(
        self, system: System, initial: Floats, start: float, stop: float, status: Status
    ) -> FinishedRun:
        """What a run leaves that failed at its start."""
        nothing = Trajectories(self.elements, initial)
        return FinishedRun(self.variables, system, start, stop, start, status, nothing, origin=self.origin)

    def begin(
        self,
        system: System,
        chosen: Settings,
        initial: Floats,
        start: float,
        stop: float,
        announce: Announce | None,
    ) -> Simulation:
        """A run about to begin, its methods chosen. Where the probe's methods stay, the probe is the run's beginning.

        What is chosen follows from the system, the settings and the times alone, so it is remembered for runs that are equal in these.
        """
        key = (system.parameters.tobytes(), chosen.distinct, chosen.of.tobytes(), start, stop)
        if key in self.decided:
            return Simulation(self, system, self.decided[key], initial, start, stop, announce)
        probe = Simulation(self, system, chosen.tried, initial, start, stop, announce)
        if all(s.method != choice.AUTO for s in chosen.distinct):
            return probe
        try:
            probe.attempt(PROBE_ATTEMPTS * self.elements.groups)
            decided = self._decide(chosen, probe)
        except ExternError:
            return probe  # going on with it tells of the failure
        if len(self.decided) == REMEMBERED:
            del self.decided[next(iter(self.decided))]
        self.decided[key] = decided
        if decided.methods == probe.settings.methods:
            return probe
        return Simulation(self, system, decided, initial, start, stop, announce)

    def _decide(self, chosen: Settings, probe: Simulation) -> Settings:
        """The settings with methods for those that leave it to us, the same for all groups of a wiring that are set alike."""
        found = [
            (label, self.wiring[number].places[rows], self.wiring[number])
            for number, label, rows in cohorts(self.wiring, chosen.of)
            if chosen.distinct[label].method == choice.AUTO
        ]
        learnt = probe.learn((wiring, _some(places)) for _, places, wiring in found)
        made, of = list(chosen.distinct), chosen.of.copy()
        for (label, places, _), probes in zip(found, learnt, strict=True):
            of[places] = len(made)
            made.append(replace(chosen.distinct[label], method=choice.choose(*probes), free=True))
        return Settings(tuple(made), of)

    def _excursions(self, system: System, start: float, trajectories: Trajectories) -> list[str]:
        """What is to be said of tables that were used outside their grids.

        Machine code tells whether any was, in steps that were given up too; so the steps that were kept are looked at again.
        """
        if not self.plan.tables:
            return []
        marked = [program.links.marked() for program in self.programs.values()]
        for table in self.plan.tables:
            table.outside[:] = [0] * len(table.outside)
        again = self.equations(system)
        with suppress(ExternError):
            again.initial(start)
            if any(marked):
                knots = distinct(np.concatenate([g.knots for g in trajectories]))
                most = min(max(LOOKED_AT // max(system.size, 1), 20), 1000)
                times = knots[distinct(np.linspace(0, len(knots) - 1, most).astype(int))]
                states = trajectories.states(np.arange(system.size), times)
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


def _some(places: Integers) -> Integers:
    """A few groups that stand for all of them."""
    if len(places) <= REPRESENTATIVES:
        return places
    return places[np.linspace(0, len(places) - 1, REPRESENTATIVES).astype(np.int64)]


def own_settings(
    elements: Elements, groups: Mapping[str, Mapping[str, Any]]
) -> tuple[list[dict[str, Any]], Integers]:
    """The distinct sets of settings that groups have of their own, and which each group has."""
    of = np.zeros(elements.groups, np.int64)
    variants: list[dict[str, Any]] = [{}]
    named = [(group_places(elements, name), own) for name, own in groups.items()]
    for places, own in sorted(named, key=lambda item: -len(item[0])):
        for variant in distinct(of[places]).tolist():
            of[places[of[places] == variant]] = len(variants)
            variants.append({**variants[variant], **own})
    return variants, of


def group_places(elements: Elements, name: str) -> Integers:
    """The groups that a name means; none for an unknown one."""
    try:
        selection = group_catalogue(elements.plan).find(name)
    except PathError:
        return np.zeros(0, np.int64)
    entry, row = selection.named.entry[selection.chosen], selection.named.row[selection.chosen]
    found = [elements.families[k].places[row[entry == k]] for k in distinct(entry).tolist()]
    return np.concatenate(found)


def _settings(merged: Mapping[str, Any], factor: float) -> GroupSettings:
    rtol, atol = _positive("rtol", merged["rtol"]), _positive("atol", merged["atol"])
    if rtol < LEAST_RTOL:
        raise SettingError(f"rtol must be at least {LEAST_RTOL:g}, not {rtol!r}: doubles hold no more")
    method = merged["method"]
    if method not in METHODS and method != choice.AUTO:
        raise SettingError(f"unknown method `{method}`; there are {choice.AUTO}, {', '.join(METHODS)}")
    max_step = math.inf if merged["max_step"] == math.inf else _positive("max_step", merged["max_step"])
    min_step = _finite("min_step", merged["min_step"])
    return GroupSettings(method, max(rtol * factor, LEAST_RTOL), atol * factor, max_step, min_step)


def span(settings: Mapping[str, Any]) -> tuple[float, float]:
    """When a run starts and stops, s. Raises SettingError."""
    start, stop = _finite("start", settings["start"]), _finite("stop", settings["stop"])
    if not stop > start:
        raise SettingError(f"stop ({stop:g} s) must be later than start ({start:g} s)")
    return start, stop


def _finite(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SettingError(f"{name} must be a finite number, not {value!r}")
    return float(value)


def _positive(name: str, value: object) -> float:
    number = _finite(name, value)
    if not number > 0:
        raise SettingError(f"{name} must be positive, not {value!r}")
    return number


def _bad_start(system: System, x: Floats) -> Status:
    name, place = system.state_at(int(np.argmax(~np.isfinite(x))))
    where = f" ({place})" if place else ""
    return Status("BAD_START", f"the initial value of `{name}`{where} is not a finite number")
