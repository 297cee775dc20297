"""Groupings side by side: what each is predicted to take, and what it takes.

In: an engine with the groups as compiled, a system, settings. Out: a row for each grouping that was tried: all contiguous ones of a model with few groups, of
others those that have a name, the predicted best and pieces of equal length. Times are CPU seconds of the integrator's loop, the least of several runs,
which alternate.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import grouping, partitions
from hierc.runtime.errors import SettingError
from hierc.runtime.families import family_statistics
from hierc.runtime.grouping import Decision

if TYPE_CHECKING:
    from hierc.runtime.machine.program import Announce
    from hierc.runtime.run import Engine
    from hierc.runtime.system import System

Integers = NDArray[np.int64]
Labels = tuple[int, ...]
#: Groups up to which every contiguous grouping is tried.
EVERY = 5
#: Lengths of pieces that are tried in larger models.
PIECES = (2, 4, 8, 16)
#: Times that each grouping is run, at least and at most, and s after which it is enough.
LEAST, MOST, ENOUGH = 3, 40, 0.15


@dataclass(frozen=True, slots=True)
class Compared:
    """A grouping. `kinds`: those of `group` that give it, "auto" first if it is what is taken; `groups` and their `steps`, those of an array together.

    `predicted` and `measured` are in s: the first None where nothing was predicted, the second where the run fails, for the reason in `failure`.
    """

    kinds: tuple[str, ...]
    groups: tuple[str, ...]
    steps: tuple[int, ...]
    predicted: float | None
    measured: float | None
    failure: str = ""


def compare(
    engine: Engine,
    system: System,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    announce: Announce | None = None,
) -> tuple[Compared, ...]:
    """Groupings of a model, the quickest first; arguments and errors as for `grouping.grouped`."""
    engine.group_settings(settings, groups)  # what is wrong with them is told at once
    decided = grouping.decision(engine, system, settings, groups, announce)
    longer = grouping.scale(engine, settings)
    trials = [
        _Trial(kinds, engine.with_groups(partition), predicted and longer * predicted)
        for kinds, partition, predicted in _candidates(engine, decided)
    ]
    trials = [trial for trial in trials if trial.prepare(system, settings, groups, announce)]
    for count in range(MOST):
        waiting = [t for t in trials if not t.failure and (count < LEAST or t.spent < ENOUGH)]
        for trial in waiting:
            trial.measure()
    return tuple(sorted((t.row() for t in trials), key=lambda row: (row.measured is None, row.measured)))


def _candidates(
    engine: Engine, decided: Decision | None
) -> Iterator[tuple[tuple[str, ...], Integers, float | None]]:
    """Kinds, partition and predicted cost of every grouping to try."""
    elements = engine.elements
    count = elements.groups
    levels, one = tuple(range(count)), (0,) * count
    chosen = levels if decided is None else decided.chosen.labels
    agents = partitions.agents(elements)
    named: dict[Labels, list[str]] = {}
    for kind, labels in (("auto", chosen), ("level", levels), ("one", one)):
        named.setdefault(labels, []).append(kind)
    if np.array_equal(agents, elements.home):
        named[levels].append("agent")
    else:
        yield ("agent",), agents, None
    for labels in dict.fromkeys((*named, *_others(count, decided))):
        predicted = None if decided is None else decided.neighbours.estimate(labels).seconds
        yield tuple(named.get(labels, ())), grouping.partition(elements, labels), predicted


def _others(count: int, decided: Decision | None) -> Iterator[Labels]:
    """Groupings without a name."""
    if 0 < count <= EVERY:
        for cuts in product((0, 1), repeat=count - 1):
            yield (0, *accumulate(cuts))
        return
    for length in PIECES:
        if length < count:
            yield tuple(k // length for k in range(count))
    if decided is not None:
        yield decided.neighbours.best().labels


class _Trial:
    """A grouping under measurement."""

    def __init__(self, kinds: tuple[str, ...], engine: Engine, predicted: float | None) -> None:
        self.kinds, self.engine, self.predicted = kinds, engine, predicted
        self.failure = ""
        self.spent, self.best = 0.0, float("inf")

    def prepare(
        self,
        system: System,
        settings: Mapping[str, Any],
        groups: Mapping[str, Mapping[str, Any]],
        announce: Announce | None,
    ) -> bool:
        """Run once, so that machine code is there and methods are chosen; False if one of the groups would need several methods."""
        engine = self.engine
        self.system = engine.equations(system)
        try:
            self.chosen = engine.group_settings(settings, groups)
            self.first = engine.run(self.system, settings, groups, announce=announce)
        except SettingError:
            return False
        if not self.first.status.ok:
            self.failure = self.first.status.message
        return True

    def measure(self) -> None:
        """Time one more run."""
        run = self.first
        initial = self.system.initial(run.start)
        simulation = self.engine.begin(self.system, self.chosen, initial, run.start, run.stop, None)
        began = time.process_time()
        simulation.advance()
        taken = time.process_time() - began
        self.spent, self.best = self.spent + taken, min(self.best, taken)

    def row(self) -> Compared:
        """What was found."""
        families = family_statistics(self.engine.elements, self.first.groups)
        return Compared(
            self.kinds,
            tuple(family.name for family in families),
            tuple(family.steps for family in families),
            self.predicted,
            None if self.failure else self.best,
            self.failure,
        )
