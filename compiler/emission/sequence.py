"""Sequence: the order of items of which some need others.

In: vertices of many items each, and links between items. Out: vertices with some of their items, in a row. Guaranteed: each item comes once, after all it
needs; a vertex comes as a whole unless it needs itself in a round; only vertices in such rounds are sorted item by item.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import TypeVar

import numpy as np

from hierc.compiler.arrays.columns import Integers
from hierc.compiler.cascade.graphs import components

Item = TypeVar("Item", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Link:
    """Items `readers` of vertex `reader` need items `sources` of vertex `source`, each its own."""

    reader: int
    source: int
    readers: Integers
    sources: Integers


class Circular(ValueError):
    """Items need each other."""


def ordered(wanted: Iterable[Item], needs: Callable[[Item], Iterable[Item]]) -> list[Item]:
    """The wanted items and all that they need, each after what it needs. Raises Circular if they need each other."""
    order: dict[Item, None] = {}
    open_: set[Item] = set()
    stack = list(wanted)[::-1]
    while stack:
        item = stack[-1]
        missing = [] if item in order else [i for i in needs(item) if i not in order]
        if not missing:
            order[item] = None
            stack.pop()
        elif item in open_:
            raise Circular(f"{item} and {missing[0]} need each other")
        else:
            open_.add(item)
            stack.extend(missing[::-1])
    return list(order)


def sequence(
    sizes: Sequence[int], links: Sequence[Link], wanted: Iterable[int]
) -> list[tuple[int, Integers]]:
    """All items of the wanted vertices and of those that they need; vertex k has `sizes[k]`. Raises Circular."""
    wanted = list(wanted)
    needs: list[dict[int, None]] = [{} for _ in sizes]
    for link in links:
        needs[link.reader][link.source] = None
    try:
        return [(v, np.arange(sizes[v])) for v in ordered(wanted, needs.__getitem__)]
    except Circular:
        pass
    parts = components([list(n) for n in needs])
    part_of = {v: k for k, part in enumerate(parts) for v in part}
    inside: list[list[Link]] = [[] for _ in parts]
    for link in links:
        if part_of[link.reader] == part_of[link.source]:
            inside[part_of[link.reader]].append(link)

    def others(part: int) -> list[int]:
        return [part_of[n] for v in parts[part] for n in needs[v] if part_of[n] != part]

    found: list[tuple[int, Integers]] = []
    for k in ordered((part_of[v] for v in wanted), others):
        found += _within(parts[k], sizes, inside[k])
    return found


def _within(part: Sequence[int], sizes: Sequence[int], links: Sequence[Link]) -> list[tuple[int, Integers]]:
    """The items of vertices that need each other."""
    ends = np.cumsum([sizes[v] for v in part])
    first = dict(zip(part, [0, *ends.tolist()], strict=False))
    none = [np.zeros(0, np.int64)]
    readers = np.concatenate([*none, *(first[link.reader] + link.readers for link in links)])
    sources = np.concatenate([*none, *(first[link.source] + link.sources for link in links)])
    order = _sorted(int(ends[-1]), readers, sources)
    vertices = np.searchsorted(ends, order, side="right")
    cuts = 1 + np.flatnonzero(np.diff(vertices))
    pieces = zip(np.split(vertices, cuts), np.split(order, cuts), strict=True)
    return [(part[int(v[0])], items - first[part[int(v[0])]]) for v, items in pieces]


def _sorted(count: int, readers: Integers, sources: Integers) -> Integers:
    """The integers below `count`, readers after their sources. Raises Circular."""
    if (sources < readers).all():
        return np.arange(count)
    if (sources > readers).all():
        return np.arange(count)[::-1]
    by_source = np.argsort(sources, kind="stable")
    starts = np.searchsorted(sources[by_source], np.arange(count + 1)).tolist()
    users = readers[by_source].tolist()
    missing = np.bincount(readers, minlength=count).tolist()
    ready = [k for k in range(count) if not missing[k]]
    heapify(ready)
    order: list[int] = []
    while ready:
        item = heappop(ready)
        order.append(item)
        for user in users[starts[item] : starts[item + 1]]:
            missing[user] -= 1
            if not missing[user]:
                heappush(ready, user)
    if len(order) < count:
        raise Circular(f"{count - len(order)} of {count} items need each other")
    return np.array(order, np.int64)
