"""Which groups a run has: as the levels are written, agent by agent, all in one, or those of least predicted cost.

Neighbours in the cascade whose steps are alike cost less in one group, which reads nothing of itself, publishes nothing to itself and has one step to begin;
neighbours whose steps differ cost more, since all of it takes the shortest ones. What a step costs follows from sizes (`coupling.py`), how many there are
from a probe with the groups as compiled. Which neighbours to join is then a shortest path.

What is decided depends on the model with the parameters that it was loaded with and on the settings of a run, not on the parameters of a single run: runs that
differ only in these are integrated alike. The constants were fitted to measured runs of the gallery in different groups, and are
part of the text, so that the same model has the same groups on every machine; `benchmarks/groupings.py` shows how well they predict.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice, partitions
from hierc.runtime.coupling import Coupling, Sizes
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.simulation import Settings, Simulation

if TYPE_CHECKING:
    from hierc.runtime.elements import Elements
    from hierc.runtime.machine.program import Announce
    from hierc.runtime.run import Engine
    from hierc.runtime.system import System

Integers = NDArray[np.int64]
KINDS = ("auto", "level", "agent", "one")
#: Groups are joined only if that is predicted to cost less than this part of leaving them as they are.
CLEARLY = 0.95
#: Step attempts from which the decision is made, and those for each group where there are more groups or a step calls back to Python.
ATTEMPTS, FOR_EACH = 4000, 24
#: Nothing is joined in a model of more groups, and to no group of more states: its machine code would take long to make.
MOST_GROUPS, MOST_STATES = 128, 64
#: Decisions that are remembered.
REMEMBERED = 16


@dataclass(frozen=True, slots=True)
class StepCost:
    """What a step of the favourite method takes, in ns: `base`, and for each of these in `Sizes`; `flop` for each in every iteration. `start`: once a group."""

    base: float
    state: float
    update: float
    input: float
    published: float
    chained: float
    flop: float
    start: float

    def of(self, sizes: Sizes, iterations: float) -> float:
        """A step of a group of this size."""
        return (
            self.base
            + self.state * sizes.states
            + self.update * sizes.updates
            + self.input * sizes.inputs
            + self.published * sizes.published
            + self.chained * sizes.chained
            + self.flop * iterations * sizes.flops
        )


COST = StepCost(65.0, 31.0, 5.0, 24.0, 110.0, 12.0, flop=0.83, start=1800.0)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A grouping: the number of its group for each of the compiled ones, in cascade order, and what a run is predicted to take, s of the kernel's time."""

    labels: tuple[int, ...]
    seconds: float

    @property
    def groups(self) -> int:
        """How many groups there are."""
        return self.labels[-1] + 1 if self.labels else 0


@dataclass(frozen=True, slots=True)
class Decision:
    """The grouping to take, the groups as compiled, and what predicts others."""

    chosen: Estimate
    levels: Estimate
    neighbours: Neighbours


def grouped(
    engine: Engine,
    kind: str,
    system: System,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    announce: Announce | None = None,
) -> Engine:
    """The engine with groups of a kind, one of `KINDS`; `engine` has them as compiled, and `settings` and `groups` are those of `Engine.run`.

    Raises SettingError for an unknown kind, and where one group would have to have several methods.
    """
    match kind:
        case "level":
            return engine
        case "agent":
            return engine.with_groups(partitions.agents(engine.elements))
        case "one":
            return engine.with_groups(partitions.one(engine.elements))
        case "auto":
            found = decision(engine, system, settings, groups, announce)
            return (
                engine
                if found is None
                else engine.with_groups(partition(engine.elements, found.chosen.labels))
            )
        case _:
            raise SettingError(f"unknown grouping `{kind}`; there are {', '.join(KINDS)}")


def partition(elements: Elements, labels: Sequence[int]) -> Integers:
    """The partition of the elements that a grouping is; `labels` as `Estimate` has them."""
    return np.where(elements.home >= 0, np.array(labels or (0,), np.int64)[elements.home], -1)


def decision(
    engine: Engine,
    system: System,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    announce: Announce | None = None,
) -> Decision | None:
    """Which groups to join; None where there is nothing to decide, or nothing to go by as the run fails at once. Remembered for equal systems and settings.

    Decided and predicted for the model's own experiment where it says how long that takes, so that runs piece by piece are integrated alike and decide once.
    """
    if not 1 < engine.elements.groups <= MOST_GROUPS:
        return None
    chosen = engine.group_settings(settings, groups)
    span = _span(engine, settings)
    key = (system.parameters.tobytes(), chosen.distinct, chosen.of.tobytes(), *span)
    if key not in engine.groupings:
        _, own = engine.own_settings(settings, groups)
        if len(engine.groupings) == REMEMBERED:
            del engine.groupings[next(iter(engine.groupings))]
        engine.groupings[key] = _decided(engine, system, chosen, own, span, announce)
    return engine.groupings[key]


def _span(engine: Engine, settings: Mapping[str, Any]) -> tuple[float, float]:
    """Start and stop that are decided for, s."""
    own = engine.plan.experiment.settings
    meant = {"start": 0.0, **own} if own.get("stop") is not None else settings
    return float(meant["start"]), float(meant["stop"])


def scale(engine: Engine, settings: Mapping[str, Any]) -> float:
    """By how much the run is longer than what estimates are for."""
    start, stop = _span(engine, settings)
    return (float(settings["stop"]) - float(settings["start"])) / (stop - start)


def _decided(
    engine: Engine,
    system: System,
    chosen: Settings,
    own: Integers,
    span: tuple[float, float],
    announce: Announce | None,
) -> Decision | None:
    free = [s.method == choice.AUTO or s.method.startswith("radau") for s in chosen.distinct]
    joinable = np.array(free)[chosen.of] & (engine.elements.group_states > 0)
    # Groups with equal numbers here may be joined.
    sorts = np.where(joinable, own, -1 - np.arange(len(own))).tolist()
    if all(a != b for a, b in pairwise(sorts)):
        return None
    try:
        probe = _probe(engine, system, chosen, span, announce)
    except ExternError:
        return None
    if probe is None:
        return None
    neighbours = Neighbours(engine, probe, sorts, span[1] - span[0])
    levels, best = neighbours.estimate(range(len(sorts))), neighbours.best()
    return Decision(best if best.seconds < CLEARLY * levels.seconds else levels, levels, neighbours)


def _probe(
    engine: Engine,
    system: System,
    chosen: Settings,
    span: tuple[float, float],
    announce: Announce | None,
) -> Simulation | None:
    """The beginning of a run with the groups as compiled; None if it has none. Raises ExternError."""
    initial = system.initial(span[0])
    if not np.isfinite(initial).all():
        return None
    simulation = Simulation(engine, system, chosen.tried, initial, *span, announce)
    attempts = FOR_EACH * engine.elements.groups
    simulation.attempt(attempts if simulation.program.links.called_back else max(attempts, ATTEMPTS))
    return simulation


@dataclass(frozen=True, slots=True)
class _Pace:
    """How a group went in the probe: steps and rejected ones a second, iterations of an attempt, the factor on its tolerances.

    `reads`: the first group that it reads, if it reads any. A group's steps are rejected where what it reads changes its course: not when it is joined with
    all of that.
    """

    steps: float
    rejected: float
    iterations: float
    depth: int
    reads: int | None


class Neighbours:
    """What it would cost to join neighbours; groups of different `sorts` never are."""

    def __init__(self, engine: Engine, probe: Simulation, sorts: Sequence[int], span: float) -> None:
        pieces = probe.program.pieces
        methods = probe.settings.methods
        self._coupling = Coupling(
            engine.plan.classes,
            engine.wiring,
            lambda w: pieces[w.form, methods[int(w.places[0])]].updates,
        )
        self._sorts, self._span = sorts, span
        self._factors, depths = engine.tightened
        self._paces = _paces(probe, depths, self._coupling)
        self._arrays = _Arrays(engine.elements)
        self._lasts = [[*self._ends(first)] for first in range(len(sorts))]
        self._sizes = [list(self._coupling.joined(g, lasts[-1])) for g, lasts in enumerate(self._lasts)]

    def _ends(self, first: int) -> Iterator[int]:
        """The groups that may be the last of one that begins with the group `first`, in ascending order."""
        states = 0
        for last, regular in enumerate(self._arrays.regular(first), first):
            states += self._coupling.groups[last].states
            if self._sorts[last] != self._sorts[first] or (last > first and states > MOST_STATES):
                return
            if regular:
                yield last

    def estimate(self, labels: Sequence[int]) -> Estimate:
        """The predicted cost of a grouping: for each group as compiled the number of its new one."""
        groups = [[*members] for _, members in groupby(range(len(labels)), key=labels.__getitem__)]
        costs = [self._cost(members[0], members[-1], len(groups) - 1 - k) for k, members in enumerate(groups)]
        return Estimate(tuple(labels), 1e-9 * sum(costs))

    def best(self) -> Estimate:
        """The grouping of least predicted cost: a shortest path from the end, where what follows counts by its cost and by how many groups it has,
        as that tightens the tolerances of those before it.
        """
        count, most = len(self._sorts), len(self._factors) - 1
        path: list[dict[int, tuple[float, tuple[int, ...]]]] = [{} for _ in range(count)]
        path.append({0: (0.0, ())})
        for first in reversed(range(count)):
            for last in self._lasts[first]:
                for after, (rest, firsts) in path[last + 1].items():
                    total = rest + self._cost(first, last, after)
                    groups = min(after + 1, most)
                    if total < path[first].get(groups, (math.inf,))[0]:
                        path[first][groups] = (total, (first, *firsts))
        total, firsts = min(path[0].values())
        labels = np.searchsorted(firsts, np.arange(count), "right") - 1
        return Estimate(tuple(labels.tolist()), 1e-9 * total)

    def _cost(self, first: int, last: int, after: int) -> float:
        """Predicted ns of a group of neighbours that is followed by so many."""
        paces = self._paces[first : last + 1]
        depth = min(after, max(pace.depth for pace in paces))
        order = 1.0 / choice.COSTS[choice.FAVOURITE].order
        attempts = 0.0
        for pace in paces:
            inside = first < last and pace.reads is not None and pace.reads >= first
            tighter = (self._factors[pace.depth] / self._factors[depth]) ** order
            attempts = max(attempts, tighter * (pace.steps + (0.0 if inside else pace.rejected)))
        iterations = max(pace.iterations for pace in paces)
        return COST.start + self._span * attempts * COST.of(self._joined(first, last), iterations)

    def _joined(self, first: int, last: int) -> Sizes:
        known = self._sizes[first]
        return known[last - first] if last - first < len(known) else [*self._coupling.joined(first, last)][-1]


class _Arrays:
    """Which neighbours it is well to join, so that the groups of an array stay alike and share their code: whole arrays, pieces of an array of 2, 4, 8 … groups
    beginning with its first, and what belongs to one element of an array.
    """

    def __init__(self, elements: Elements) -> None:
        count = elements.groups
        self._family: list[str] = [""] * count
        self._indices: list[tuple[int, ...]] = [()] * count
        for family in elements.families:
            for place, row in zip(family.places.tolist(), family.indices.tolist(), strict=True):
                self._family[place], self._indices[place] = family.name, tuple(row)
        self._total = Counter(self._family)
        met: Counter[str] = Counter()
        self._number: list[int] = []  # of each group among those of its name
        for name in self._family:
            self._number.append(met[name])
            met[name] += 1

    def regular(self, first: int) -> Iterator[bool]:
        """Whether the group `first`, it and the next one, and so on, may be joined."""
        met: Counter[str] = Counter()
        name, element, number = self._family[first], True, self._number[first]
        for last in range(first, len(self._family)):
            met[self._family[last]] += 1
            element = element and self._indices[last] == self._indices[first] != ()
            size = last - first + 1
            room = 1 << (size - 1).bit_length()
            piece = met[name] == size and not number % room and size in (room, self._total[name] - number)
            whole = all(self._total[known] == found for known, found in met.items())
            yield last == first or element or piece or whole


def _paces(probe: Simulation, depths: Integers, coupling: Coupling) -> list[_Pace]:
    """How all groups went, as far as all of them came."""
    trajectories, reached = probe.trajectories(), probe.reached
    passed = reached - probe.start
    found = []
    for g, (group, depth) in enumerate(zip(coupling.groups, depths.tolist(), strict=True)):
        knots, stats = trajectories[g].knots, trajectories[g].stats
        taken, made = len(knots) - 1, float(np.interp(reached, knots, np.arange(len(knots))))
        owners = [owner for owner, *_ in group.reads]
        tried = taken + int(stats["rejected"])
        steps = made / passed if passed > 0.0 else 0.0
        iterations = int(stats["iterations"]) / max(tried, 1)
        rejected = steps * int(stats["rejected"]) / max(taken, 1)
        found.append(_Pace(steps, rejected, iterations, depth, min(owners, default=None)))
    return found
