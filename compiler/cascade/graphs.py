"""Strongly connected parts and topological order of directed graphs given as lists of successors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heapify, heappop, heappush
from typing import Any


def components(successors: Sequence[Sequence[int]]) -> list[list[int]]:
    """The strongly connected parts, each sorted, in the order of their first vertices."""
    if not successors:
        return []
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    starts = np.cumsum([0, *(len(s) for s in successors)])
    targets = np.array([t for s in successors for t in s], dtype=np.int32)
    graph = csr_array((np.ones(len(targets), dtype=np.int8), targets, starts), shape=(len(successors),) * 2)
    _, labels = connected_components(graph, directed=True, connection="strong")
    parts: dict[int, list[int]] = {}
    for vertex, label in enumerate(labels.tolist()):
        parts.setdefault(label, []).append(vertex)
    return list(parts.values())


def order(
    needs: Sequence[Sequence[int]],
    priority: Callable[[int], Any],
    within: Sequence[Sequence[int]] | None = None,
) -> list[int]:
    """Vertices with each after those it needs and, where that leaves a choice, by `priority`.

    Vertices that need each other stay together: in the order of what they need `within` such a part, then by priority.
    """
    parts = components(needs)
    part_of = {vertex: index for index, part in enumerate(parts) for vertex in part}
    wanted = [{part_of[n] for v in part for n in needs[v]} - {index} for index, part in enumerate(parts)]
    users: list[list[int]] = [[] for _ in parts]
    for index, others in enumerate(wanted):
        for other in others:
            users[other].append(index)
    missing = [len(others) for others in wanted]
    rank = [min(priority(v) for v in part) for part in parts]
    ready = [(rank[index], index) for index, count in enumerate(missing) if count == 0]
    heapify(ready)
    result: list[int] = []
    while ready:
        _, index = heappop(ready)
        result += _inside(parts[index], priority, within)
        for user in users[index]:
            missing[user] -= 1
            if missing[user] == 0:
                heappush(ready, (rank[user], user))
    return result


def _inside(
    part: Sequence[int], priority: Callable[[int], Any], within: Sequence[Sequence[int]] | None
) -> list[int]:
    """The order inside a strongly connected part."""
    if within is None or len(part) == 1:
        return sorted(part, key=priority)
    place = {vertex: index for index, vertex in enumerate(part)}
    needs = [[place[n] for n in within[vertex] if n in place] for vertex in part]
    return [part[index] for index in order(needs, lambda index: priority(part[index]))]
