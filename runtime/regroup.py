"""The same elements in other groups: a plan's tables worked out anew, without compiling.

In: `Elements` and a *partition*: for each element the number of its new group, in cascade order, and -1 for those that are in none. Out: a `Plan` that
differs in nothing but `groups` and `order`. Guaranteed: elements keep their order within a group; every call comes after what it reads. That no group reads
a later one is up to the partition.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.alike import Nodes, divided
from hierc.runtime.columns import distinct
from hierc.runtime.contract import Group, Members, Plan, Run
from hierc.runtime.elements import Elements, expand
from hierc.runtime.naming import Names

Integers = NDArray[np.int64]
Calls = tuple[tuple[Members, int], ...]
#: Elements in a row, evenly spaced, from which on one `Run` stands for them.
_LEAST_RUN = 3


@dataclass(frozen=True, slots=True)
class _Alike:
    """Groups that hold elements of the same blocks: their name, members (groups, elements), the indices in their names, their places."""

    name: str
    nodes: Integers
    indices: Integers
    places: Integers

    def group(self, rows: Integers, calls: Calls = ()) -> Group:
        """Some of them as a table's entry."""
        nodes, indices = self.nodes[rows], self.indices[rows]
        return Group(
            self.name, tuple(_entries(nodes)), calls, len(rows), tuple(map(tuple, indices.T.tolist()))
        )


def regrouped(elements: Elements, partition: Integers) -> Plan:
    """The plan with the groups of a partition."""
    alike = list(_alike(elements, partition))
    bare = tuple(a.group(np.arange(len(a.places))) for a in alike)
    plan = replace(elements.plan, groups=bare, order=_order([a.places for a in alike]))
    anew = expand(plan)  # where everything is now; what is called follows from it
    groups: list[Group] = []
    places: list[Integers] = []
    for a in alike:
        for rows, calls in divided(len(a.places), partial(_called, anew, a)):
            groups.append(a.group(rows, calls))
            places.append(a.places[rows])
    return replace(plan, groups=tuple(groups), order=_order(places))


def former_groups(elements: Elements, partition: Integers) -> tuple[Integers, Integers]:
    """Pairs (new group, former group) that have elements in common, in ascending order."""
    inside = elements.home >= 0
    pairs = distinct(partition[inside] * elements.groups + elements.home[inside])
    return pairs // max(elements.groups, 1), pairs % max(elements.groups, 1)


def _alike(elements: Elements, partition: Integers) -> Iterator[_Alike]:
    """The new groups, those together whose members are of the same blocks and named alike."""
    order = elements.order[np.argsort(partition[elements.order], kind="stable")]
    sizes = np.bincount(partition[order])
    starts = np.cumsum(sizes) - sizes
    _, former = former_groups(elements, partition)
    names = Names(elements, np.bincount(former, minlength=elements.groups) > 1)
    codes = elements.block[order] * len(names.patterns) + names.pattern[order]
    found: dict[bytes, list[int]] = {}
    for place, (first, size) in enumerate(zip(starts.tolist(), sizes.tolist(), strict=True)):
        found.setdefault(codes[first : first + size].tobytes(), []).append(place)
    for own in found.values():
        places = np.array(own, np.int64)
        nodes = order[starts[places][:, None] + np.arange(sizes[places[0]])]
        for name, rows, indices in names.of(nodes):
            yield _Alike(name, nodes[rows], indices, places[rows])


def _called(elements: Elements, alike: _Alike, rows: Integers) -> tuple[Integers, Calls]:
    """The rows, and what these groups call: the outs that their equations read, in order, then the equations. Raises Differ."""
    columns = Nodes(elements, alike.places[rows])
    own = [columns.number(column) for column in alike.nodes[rows].T]
    read = [(node, k) for n in own for node, what, k in columns.read_by(n, -1) if what == "out"]
    calls = columns.order_parts([(node, k) for node, k in read if columns.is_inside(node)])
    calls += [(n, -1) for n in own if columns.kind(n).states]
    made: list[tuple[Members, int]] = []
    for (_, part), several in groupby(calls, key=lambda call: (columns.block(call[0]).first, call[1])):
        called = np.stack([columns.columns[node] for node, _ in several], axis=1)
        made += [(entry, part) for entry in _entries(called)]
    return rows, tuple(made)


def _entries(nodes: Integers) -> Iterator[Members]:
    """Entries for elements (groups, members)."""
    if len(nodes) != 1:
        yield from map(tuple, nodes.T.tolist())
        return
    row, count = nodes[0], nodes.shape[1]
    turns = np.flatnonzero(np.diff(row, n=2)) + 1  # the last elements of runs
    at = 0
    while at < count:
        later = int(np.searchsorted(turns, at, "right"))
        last = int(turns[later]) if later < len(turns) else count - 1
        if last - at + 1 >= _LEAST_RUN:
            yield Run(int(row[at]), last - at + 1, int(row[at + 1] - row[at]))
            at = last + 1
        else:
            yield int(row[at])
            at += 1


def _order(places: Sequence[Integers]) -> tuple[int, ...] | None:
    """The cascade order of groups, numbered through families that stand at these places."""
    joined = np.concatenate([np.zeros(0, np.int64), *places])
    natural = bool((joined == np.arange(len(joined))).all())
    return None if natural else tuple(np.argsort(joined).tolist())
