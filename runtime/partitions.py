"""Partitions of a plan's elements into groups: as compiled, agent by agent, all in one.

In: `Elements`. Out: for each element the number of its group, in cascade order, and -1 for those in none. Guaranteed: no group needs a later one.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.elements import Elements

Integers = NDArray[np.int64]


def levels(elements: Elements) -> Integers:
    """The groups that the plan has."""
    return elements.home


def one(elements: Elements) -> Integers:
    """All states in one group."""
    return np.where(elements.home >= 0, 0, -1)


def agents(elements: Elements) -> Integers:
    """The finest groups there can be: agents, and levels of agents, by themselves, but together those that need each other in a circle."""
    from scipy.sparse import csr_array  # here, as few runs need it and it takes 0.1 s
    from scipy.sparse.csgraph import connected_components

    vertex, reads, read = _graph(elements)
    count = int(max(vertex.max(initial=-1), reads.max(initial=-1), read.max(initial=-1))) + 1
    graph = csr_array((np.ones(len(reads), np.int8), (reads, read)), shape=(count, count))
    _, part = connected_components(graph, directed=True, connection="strong")
    ranks = _ranks(elements, part[vertex], part[reads], part[read])
    return np.where(elements.home >= 0, ranks[part[vertex]], -1)


def _graph(elements: Elements) -> tuple[Integers, Integers, Integers]:
    """The vertex of each element, and edges (who reads, what is read).

    A vertex is an element with states, a group of elements without, or one part of an element in no group: so that a way through such an element leads only
    to what that part reads.
    """
    count = elements.count
    vertex = np.arange(count)
    for family in elements.families:
        stateless = elements.group_states[family.places] == 0
        vertex[family.nodes[stateless]] = family.nodes[stateless, :1]
    outs = np.repeat(vertex, np.diff(elements.outs))
    reads, read = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for block in elements.blocks:
        kind, own = elements.plan.classes[block.kind], np.arange(block.first, block.first + block.count)
        grouped = elements.home[own] >= 0
        for part in kind.parts:
            for out in part.outs:
                slots = elements.outs[own] + out
                outs[slots] = np.where(grouped, vertex[own], count + elements.outs[own] + part.outs[0])
    for block in elements.blocks:
        kind, own = elements.plan.classes[block.kind], np.arange(block.first, block.first + block.count)
        grouped = elements.home[own] >= 0
        for k, source in enumerate(block.sources):
            found = vertex[source.elements]
            if source.what == "out":
                found = outs[elements.outs[source.elements] + source.index]
            reads.append(vertex[own][grouped])
            read.append(found[grouped])
            for part in kind.parts:
                if k in part.inputs:
                    reads.append(outs[elements.outs[own] + part.outs[0]][~grouped])
                    read.append(found[~grouped])
    return vertex, np.concatenate(reads), np.concatenate(read)


def _ranks(elements: Elements, part: Integers, reads: Integers, read: Integers) -> Integers:
    """The number of each part that holds elements of groups, those that it reads first; where that leaves a choice, as the plan has them."""
    count = int(max(part.max(initial=-1), reads.max(initial=-1), read.max(initial=-1))) + 1
    place = np.full(
        count, -1, np.int64
    )  # of a part's first element among all; those in no group as soon as they can
    order = elements.order[::-1]
    place[part[order]] = len(order) - 1 - np.arange(len(order))
    edges = np.unique(np.stack([read, reads])[:, reads != read], axis=1)
    readers = np.split(edges[1], np.searchsorted(edges[0], np.arange(1, count)))
    missing = np.bincount(edges[1], minlength=count).tolist()
    ready = [(int(place[p]), p) for p in range(count) if not missing[p]]
    heapify(ready)
    ranks, rank = np.full(count, -1, np.int64), 0
    while ready:
        at, here = heappop(ready)
        if at >= 0:
            ranks[here], rank = rank, rank + 1
        for reader in readers[here].tolist():
            missing[reader] -= 1
            if not missing[reader]:
                heappush(ready, (int(place[reader]), reader))
    return ranks
