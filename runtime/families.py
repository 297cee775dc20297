"""How the groups of an array were integrated, told together: ten thousand rows say less than one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct, median
from hierc.runtime.contract import Plan
from hierc.runtime.elements import Elements
from hierc.runtime.paths import Catalogue, PathError
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


def named_groups(elements: Elements) -> Iterator[tuple[str, Integers]]:
    """The groups of each name, those of an array together, in the order of the plan: the name as it is shown, and their places."""
    known = group_catalogue(elements.plan)
    for name in known.plain:
        places = [elements.families[k].places for k in known.entries(name)]
        yield known.named(name).shown, np.concatenate(places)


V = TypeVar("V")
#: So many groups are not listed in a message.
MANY = 7
#: Groups that a mapping by groups names when it is printed.
_SHOWN = 6


class ByGroup(Mapping[str, V]):
    """Something for each group by its name, made when it is asked for; what names no group, or several, is explained.

    `joined`: the places of the groups that others, by the names that the model has for them, are part of.
    """

    def __init__(
        self, elements: Elements, make: Callable[[int], V], joined: Mapping[str, int] = MappingProxyType({})
    ) -> None:
        self._names = [elements.group_name(g) for g in range(elements.groups)]
        self._places = {name: g for g, name in enumerate(self._names)}
        self._plan, self._joined = elements.plan, joined
        self._make = make
        self._made: dict[str, V] = {}

    def __getitem__(self, group: str) -> V:
        if group not in self._made:
            known = self._places if group in self._places else self._joined
            if group not in known:
                raise KeyError(self._unknown(group))
            self._made[group] = self._make(known[group])
        return self._made[group]

    def _unknown(self, group: str) -> str:
        known = group_catalogue(self._plan)
        try:
            meant = [name for part in known.regular(group) for name in known.find(part).names]
        except PathError as error:
            bare = str(error) == f"{known.missing} `{group}`" and len(known.plain) < MANY
            names = ", ".join(f"`{known.named(name).shown}`" for name in known.plain)
            return f"{error}; the groups are {names}" if bare else str(error)
        return f"`{group}` is {len(meant)} groups: name one, such as `{meant[0]}`, or look at `families`"

    def __contains__(self, group: object) -> bool:
        return group in self._places or group in self._joined

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __repr__(self) -> str:
        return f"<{len(self._names)} groups: {', '.join(self._names[:_SHOWN])}{', …' if len(self._names) > _SHOWN else ''}>"

    def __len__(self) -> int:
        return len(self._places)


def family_statistics(elements: Elements, groups: Sequence[GroupTrajectory]) -> tuple[FamilyStats, ...]:
    """The statistics of all groups, those of an array together, in the order of the plan."""
    if not groups:
        return ()
    return tuple(_statistics(name, places, elements, groups) for name, places in named_groups(elements))


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
