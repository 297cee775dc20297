"""Where a sequence repeats itself: the steps of an elimination of many equal agents are the same few, over and over.

In: anything that can be compared, in order. Out: stretches that cover it. Found greedily from the front, in time proportional to its length.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

#: Longest period that is looked for.
_LONGEST = 24


@dataclass(frozen=True, slots=True)
class Stretch:
    """`rounds` times `period` items from `first` on, equal from round to round; one round: items that do not repeat."""

    first: int
    period: int
    rounds: int

    @property
    def end(self) -> int:
        """The item after it."""
        return self.first + self.period * self.rounds


def stretches(items: Sequence[Hashable], least: int) -> list[Stretch]:
    """Cover a sequence; what repeats does so at least `least` times, and everything else is in stretches between."""
    n = len(items)
    equal = {p: _equal_from(items, p) for p in range(1, min(_LONGEST, n - 1) + 1)}
    found: list[Stretch] = []
    single = first = 0
    while first < n:
        best = Stretch(first, 1, 1)
        for period, same in equal.items():
            rounds = same[first] // period + 1
            if rounds >= least and period * rounds > best.period * best.rounds:
                best = Stretch(first, period, rounds)
        if best.rounds > 1:
            if single < first:
                found.append(Stretch(single, first - single, 1))
            found.append(best)
            single = best.end
        first = best.end
    return [*found, Stretch(single, n - single, 1)] if single < n else found


def _equal_from(items: Sequence[Hashable], period: int) -> list[int]:
    """How many items in a row, from each on, equal the one a period later."""
    same = [0] * (len(items) + 1)
    for k in range(len(items) - period - 1, -1, -1):
        same[k] = same[k + 1] + 1 if items[k] == items[k + period] else 0
    return same
