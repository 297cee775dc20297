"""How the groups of an array were integrated, told together: ten thousand rows say less than one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct, median
from hierc.runtime.contract import Plan
from hierc.runtime.elements import Elements
from hierc.runtime.paths import Catalogue
from hierc.runtime.trajectory import GroupTrajectory

Integers = NDArray[np.int64]
_COUNTERS = ("steps", "rejected", "evaluations", "jacobians", "iterations")


@dataclass(frozen=True, slots=True)
class FamilyStats:
    """How all groups of one name were integrated, `car[1..100]`. Step sizes are in s, NaN where there was no step.

    Counters are sums over the `groups`; `steps_min`, `steps_median` and `steps_max` tell how many steps single groups took. `methods` and `states` (of one
    group) are all that occur.
    """

    name: str
    groups: int
    methods: tuple[str, ...]
    states: tuple[int, ...]
    steps: int
    steps_min: int
    steps_median: float
    steps_max: int
    rejected: int
    evaluations: int
    jacobians: int
    iterations: int  # of Newton's method
    step_min: float
    step_median: float
    step_max: float


def group_catalogue(plan: Plan) -> Catalogue:
    """The names of a plan's groups."""
    return Catalogue("unknown group", [(g.name, g.count, g.indices) for g in plan.groups])


def family_statistics(elements: Elements, groups: Sequence[GroupTrajectory]) -> tuple[FamilyStats, ...]:
    """The statistics of all groups, those of an array together, in the order of the plan."""
    known = group_catalogue(elements.plan)
    return tuple(
        _statistics(
            known.named(name).shown,
            np.concatenate([elements.families[k].places for k in known.entries(name)]),
            elements,
            groups,
        )
        for name in (known.plain if groups else ())
    )


def _statistics(
    name: str, places: Integers, elements: Elements, groups: Sequence[GroupTrajectory]
) -> FamilyStats:
    own = [groups[g] for g in places.tolist()]
    counters = {k: np.array([g.stats.get(k, 0) for g in own]) for k in _COUNTERS}
    sizes = np.concatenate([np.diff(g.knots) for g in own])
    low, middle, high = (sizes.min(), median(sizes), sizes.max()) if len(sizes) else (np.nan, np.nan, np.nan)
    return FamilyStats(
        name=name,
        groups=len(own),
        methods=tuple(dict.fromkeys(g.method for g in own)),
        states=tuple(distinct(elements.group_states[places]).tolist()),
        steps_min=int(counters["steps"].min()),
        steps_median=median(counters["steps"]),
        steps_max=int(counters["steps"].max()),
        step_min=float(low),
        step_median=float(middle),
        step_max=float(high),
        **{k: int(column.sum()) for k, column in counters.items()},
    )
