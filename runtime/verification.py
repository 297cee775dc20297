"""How wrong a run is, estimated by a second one with tolerances ten times tighter.

In: two runs of one system. Out: for each group, those of an array together, the largest difference of a state in units of what was asked for,
rtol*|x| + atol*nominal with |x| the state's largest size in the run. The times are the ends of the group's own steps and three times inside each,
where the polynomials are looked at that results and readers see. The estimate is as good as the second run is better than the first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.elements import Elements
from hierc.runtime.errors import SettingError
from hierc.runtime.families import named_groups
from hierc.runtime.run import LEAST_RTOL, Engine, FinishedRun
from hierc.runtime.simulation import of_group
from hierc.runtime.status import Status

Floats = NDArray[np.float64]
#: By how much the second run is tighter.
TIGHTER = 0.1
#: Where in each step the runs are compared.
_PLACES = np.array([0.25, 0.5, 0.75, 1.0])
#: Steps of a group that are looked at; of more, as many as these, spread evenly.
_MOST_STEPS = 20_000
#: Times at which states are evaluated at once.
_AT_ONCE = 10_000


@dataclass(frozen=True, slots=True)
class Verified:
    """The worst state of the groups of one name: its error, in units of the tolerance, and when (s)."""

    name: str
    error: float
    state: str
    time: float


@dataclass(frozen=True, slots=True)
class Verification:
    """The errors of all groups that have states, in cascade order, up to the time `reached` (s).

    That is the whole run unless the second one ended early, for the reason in `status`.
    """

    groups: tuple[Verified, ...]
    reached: float
    status: Status

    @property
    def error(self) -> float:
        """The largest of all, in units of the tolerance; 0 where there is nothing to integrate."""
        return max((group.error for group in self.groups), default=0.0)


def check_verifiable(settings: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises SettingError where the second run's tolerances would be smaller than doubles allow."""
    least = min(float(own.get("rtol", math.inf)) for own in (settings, *groups.values()))
    if least * TIGHTER < LEAST_RTOL:
        raise SettingError(
            f"a run at rtol {least:g} cannot be verified: the second run would need {least * TIGHTER:g}, "
            f"and {LEAST_RTOL:g} is the least"
        )


def verified(
    engine: Engine,
    run: FinishedRun,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    **others: Any,
) -> Verification:
    """Run again with tighter tolerances and compare; `settings`, `groups` and `others` as `Engine.run` has them."""
    tighter = {name: _tighter(own) for name, own in groups.items()}
    again = engine.run(run.system, _tighter(settings), tighter, **others)
    variants, of = engine.own_settings(settings, groups)
    asked = [of_group(settings, own) for own in variants]
    return compare(engine.elements, run, again, [asked[k] for k in of.tolist()])


def _tighter(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {**settings, **{name: settings[name] * TIGHTER for name in ("rtol", "atol") if name in settings}}


def compare(
    elements: Elements, run: FinishedRun, again: FinishedRun, asked: Sequence[Mapping[str, Any]]
) -> Verification:
    """The errors of a run, taken as its differences from a better one. `asked`: rtol and atol of each group, by place."""
    found = []
    for name, places in named_groups(elements):
        errors = [_worst(run, again, g, asked[g]) for g in places.tolist() if elements.group_states[g]]
        if errors:
            error, state, time = max(errors)
            found.append(Verified(name, error, run.system.state_names[state], time))
    return Verification(tuple(found), min(run.t_reached, again.t_reached), again.status)


def _worst(
    run: FinishedRun, again: FinishedRun, g: int, asked: Mapping[str, Any]
) -> tuple[float, int, float]:
    """Of one group: the largest error, the place of its state in the state vector, the time."""
    first, last = run.system.elements.group_offsets[g : g + 2].tolist()
    mine, better = run.groups[g], again.groups[g]
    times = _times(mine.knots, min(mine.reached, better.reached))
    if not len(times):
        return 0.0, first, run.start
    largest, difference, when = (np.zeros(last - first) for _ in range(3))
    for part in np.array_split(times, -(-len(times) // _AT_ONCE)):
        states = mine(part)
        differences = np.abs(states - better(part))
        rows = differences.argmax(axis=0)
        here = differences[rows, np.arange(len(rows))]
        when = np.where(here > difference, part[rows], when)
        difference = np.maximum(difference, here)
        largest = np.maximum(largest, np.abs(states).max(axis=0))
    errors = difference / (asked["rtol"] * largest + asked["atol"] * run.system.nominal[first:last])
    worst = int(np.argmax(errors))
    return float(errors[worst]), first + worst, float(when[worst])


def _times(knots: Floats, reached: float) -> Floats:
    """Times in each step, or in each of many steps spread evenly, that both runs reached."""
    steps = np.arange(len(knots) - 1)
    if len(steps) > _MOST_STEPS:
        steps = np.linspace(0, len(steps) - 1, _MOST_STEPS).astype(np.int64)
    begins, sizes = knots[steps], np.diff(knots)[steps]
    times = np.minimum(begins[:, None] + sizes[:, None] * _PLACES, knots[steps + 1][:, None]).ravel()
    return np.asarray(times[times <= reached])
