"""What groups come from that are made of others: whose settings they have, and by which names they are known too.

In: the elements of a plan as it was compiled, and the partition that its new groups were made by. Guaranteed: a group made of several is integrated by the
tightest of their settings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.elements import Elements
from hierc.runtime.errors import SettingError
from hierc.runtime.regroup import former_groups
from hierc.runtime.simulation import of_group

Integers = NDArray[np.int64]
#: Settings of which the smallest counts.
_TIGHTEST = ("rtol", "atol", "max_step", "min_step")


@dataclass(frozen=True)
class Origin:
    """The former groups: `elements` has them, `partition` says which new group each element is in."""

    elements: Elements
    partition: Integers

    @cached_property
    def pairs(self) -> tuple[Integers, Integers]:
        """(new group, former group) that have elements in common, in ascending order."""
        return former_groups(self.elements, self.partition)

    def joined(
        self, settings: Mapping[str, Any], variants: Sequence[Mapping[str, Any]], of: Integers
    ) -> tuple[list[dict[str, Any]], Integers]:
        """The distinct sets of settings of the new groups, and which each has; `variants` and `of` are those of the former groups.

        Raises SettingError where one group would need two methods.
        """
        groups = list(self._by_group())
        if len(variants) == 1:
            return [dict(variants[0])], np.zeros(len(groups), np.int64)
        sets: dict[tuple[int, ...], int] = {}
        labels = np.zeros(len(groups), np.int64)
        for group, former in groups:
            key = tuple(sorted(set(of[former].tolist())))
            if key not in sets:
                self._check_methods(former, [variants[k] for k in of[former].tolist()])
            labels[group] = sets.setdefault(key, len(sets))
        return [_tightest(settings, [variants[k] for k in key]) for key in sets], labels

    def names(self) -> Iterator[tuple[str, int]]:
        """Names of former groups that are now whole in another one, with its place."""
        new, old = self.pairs
        whole = np.bincount(old, minlength=self.elements.groups) == 1
        for group, former in zip(new.tolist(), old.tolist(), strict=True):
            if whole[former]:
                yield self.elements.group_name(former), group

    def _by_group(self) -> Iterator[tuple[int, Integers]]:
        new, old = self.pairs
        cuts = np.flatnonzero(np.diff(new)) + 1
        yield from enumerate(np.split(old, cuts) if len(old) else ())

    def _check_methods(self, former: Integers, own: Sequence[Mapping[str, Any]]) -> None:
        named = {v["method"]: int(g) for g, v in zip(former, own, strict=True) if "method" in v}
        if len(named) > 1:
            (first, a), (second, b) = list(named.items())[:2]
            names = [f"`{self.elements.group_name(g)}`" for g in (a, b)]
            raise SettingError(
                f"{names[0]} and {names[1]} would be in one group, but have methods of their own, {first} and {second}"
            )


def _tightest(settings: Mapping[str, Any], own: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What holds for a group made of several with these settings beside those for all."""
    if len(own) == 1:
        return dict(own[0])
    every = [of_group(settings, v) for v in own]
    found = {name: min(v[name] for v in every) for name in _TIGHTEST}
    methods = [v["method"] for v in own if "method" in v]
    return {**found, "method": methods[0]} if methods else found
