"""The calls that make up a group, and their division into those that states reach and those that only inputs do.

A sum over ten thousand agents is a thousand calls of a few functions, all of them before any state is looked at. `divide` finds such calls, `series` those of
them that differ in numbers only, so that one loop over a table can do them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from hierc.runtime.contract import Class

#: Where a call finds an input; "none": it does not look at it.
Where = tuple[Literal["channel", "state", "out", "none"], int]


@dataclass(frozen=True, slots=True)
class CallForm:
    """One call: `part` of class `kind`, or its right-hand side (part -1).

    States begin at `x`, values at `p`, the class's outs at `y` of the group's outs; `sources[k]` says where input k is found.
    """

    kind: int
    part: int
    x: int
    p: int
    y: int
    sources: tuple[Where, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """What equal groups have in common: n states, their right-hand sides' calls, the calls that publish `published` outs, sizes."""

    states: int
    inputs: int
    outs: int
    calls: tuple[CallForm, ...]
    publishing: tuple[CallForm, ...]
    published: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Division:
    """Calls that the group's states do not reach, and all others, each in order; `kept`: the outs of the former that the others read."""

    before: tuple[CallForm, ...]
    reached: tuple[CallForm, ...]
    kept: tuple[int, ...]


def divide(
    calls: Sequence[CallForm], classes: Sequence[Class], stateless: Callable[[CallForm], bool]
) -> Division:
    """Divide calls. `stateless(call)`: the call sets outs, for which its function needs no states but through its inputs."""
    before: list[CallForm] = []
    reached: list[CallForm] = []
    known: set[int] = set()
    for call in calls:
        given = all(
            where in ("channel", "none") or (where == "out" and k in known) for where, k in call.sources
        )
        if given and stateless(call):
            before.append(call)
            known.update(_made(call, classes))
        else:
            reached.append(call)
    kept = {k for call in reached for where, k in call.sources if where == "out" and k in known}
    return Division(tuple(before), tuple(reached), tuple(sorted(kept)))


def series(
    calls: Sequence[CallForm],
    classes: Sequence[Class],
    held: Callable[[CallForm], tuple[bool, ...]] = lambda call: (),
) -> list[tuple[CallForm, ...]]:
    """Calls in an order in which they may be made, those that differ in numbers only together; none reads an out of its own series.

    `held`: which inputs of a call do not depend on states, where that makes a difference.
    """
    depths: dict[int, int] = {}
    found: dict[tuple[int, int, int, tuple[str, ...], tuple[bool, ...]], list[CallForm]] = {}
    for call in calls:
        depth = 1 + max((depths.get(k, 0) for where, k in call.sources if where == "out"), default=0)
        if call.part >= 0:
            depths.update(dict.fromkeys(_made(call, classes), depth))
        places = tuple(where for where, _ in call.sources)
        found.setdefault((depth, call.kind, call.part, places, held(call)), []).append(call)
    return [tuple(found[key]) for key in sorted(found, key=lambda key: key[0])]


def _made(call: CallForm, classes: Sequence[Class]) -> list[int]:
    """The outs that a call sets."""
    return [call.y + out for out in classes[call.kind].parts[call.part].outs]
