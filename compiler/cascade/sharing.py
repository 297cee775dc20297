"""Sharing: what is computed once, though several groups read it.

In: the groups of all elements with states, and what reads what. Out: `Labels` in which some elements without states have a group too. Guaranteed: groups
that do not need each other still do not; an element without states that has a group has one definition that others read.

Whoever reads what an element without states computes, computes it himself, with all that it is made of: where R groups read a sum of W scalars, R*W are
read. With the sum in a group of its own, W and R are: it reads its terms, and they its channel. So it gets one where that spares `SPARED` of them.
Where one of the groups is itself among what is summed, in a loop, the sum becomes a part of that one instead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from hierc.compiler.arrays.columns import Integers
from hierc.compiler.cascade.assignment import Labels, NamedGroups
from hierc.compiler.cascade.edges import Edges
from hierc.compiler.cascade.graphs import order
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.nodes import LocalNode

#: Reads, beside those there are in any case, that are worth a group.
SPARED = 64
#: Letters that the name of a group takes from an expression.
_LETTERS = 40


def share(flat_nodes: Sequence[FlatNode], nodes: Sequence[LocalNode], labels: Labels, edges: Edges) -> Labels:
    """Labels with groups for what is worth one; those objects themselves where nothing is. New labels follow those there are."""
    homes = _homes(edges, _candidates(nodes, edges))
    if not (homes >= 0).any():
        return labels
    of_element = labels.of_element.copy()
    families: list[tuple[FlatNode, Integers, Integers]] = []
    count = labels.count
    for (block, _), first in sorted(edges.definitions.items()):
        node = nodes[block].node
        own = homes[first - labels.count : first - labels.count + node.count]
        joined, alone = np.flatnonzero((own >= 0) & (own < labels.count)), np.flatnonzero(own >= labels.count)
        of_element[node.first + joined] = own[joined]
        if len(alone):
            new = count + np.arange(len(alone))
            of_element[node.first + alone] = new
            families.append((flat_nodes[block], alone, new))
            count += len(alone)
    return Labels(of_element, (*labels.names, *_named(families, labels)), count)


def _candidates(nodes: Sequence[LocalNode], edges: Edges) -> Integers:
    """The vertices, counted from the first definition on, whose element has no other definition that is read."""
    read = Counter(block for block, _ in edges.definitions)
    found = [
        first + np.arange(nodes[block].node.count) - edges.labels
        for (block, _), first in edges.definitions.items()
        if read[block] == 1
    ]
    return np.concatenate([np.zeros(0, np.int64), *found])


def _homes(edges: Edges, candidates: Integers) -> Integers:
    """For each definition without states, by its vertex counted from the first one: the label whose group computes it for others, its own vertex for a
    group of its own, or -1.
    """
    count, free = edges.labels, edges.vertices - edges.labels
    needs = _lists(edges.reads - count, edges.read, free)
    users = _lists(edges.read - count, edges.reads, free)
    upward = order([[n - count for n in own if n >= count] for own in needs], int)
    widths = [0] * free
    for v in upward:
        widths[v] = sum(1 if n < count else widths[n - count] for n in needs[v])
    around = np.full(int(edges.parts.max(initial=-1)) + 1, -1)  # the label in each part, if there is one
    around[edges.parts[:count]] = np.arange(count)
    loops = around[edges.parts[count:]]
    single = np.zeros(free, np.bool_)
    single[candidates] = True
    found = np.full(free, -1, np.int64)
    readers: list[set[int]] = [set() for _ in range(free)]
    for v in reversed(upward):
        for user in set(users[v]):
            home = user if user < count else int(found[user - count])
            readers[v] |= {home} if home >= 0 else readers[user - count]
        if single[v] and (len(readers[v]) - 1) * (widths[v] - 1) >= SPARED:
            found[v] = loops[v] if loops[v] >= 0 else count + v
    return found


def _lists(keys: Integers, values: Integers, count: int) -> list[list[int]]:
    """For each key from 0 to count - 1 its values."""
    inside = keys >= 0
    by_key = np.argsort(keys[inside], kind="stable")
    ends = np.searchsorted(keys[inside][by_key], np.arange(count + 1)).tolist()
    sorted_values: list[int] = values[inside][by_key].tolist()
    return [sorted_values[a:b] for a, b in pairwise(ends)]


def _named(families: Sequence[tuple[FlatNode, Integers, Integers]], labels: Labels) -> Iterator[NamedGroups]:
    """The names of groups without states, `sum(car.v)`. `families`: nodes, the places of their elements, the labels of these."""
    taken = {groups.name for groups in labels.names}
    found: dict[str, list[tuple[Integers, tuple[Integers, ...]]]] = {}
    for node, places, new in families:
        indices = tuple(column[places] for column in node.instance.domain.indices)
        found.setdefault(_name(node), []).append((new, indices))
    for name, parts in found.items():
        tables = [np.stack([np.zeros_like(new), *indices], axis=1) for new, indices in parts]
        table = np.concatenate(tables)
        if name not in taken and len(np.unique(table, axis=0)) == len(table):
            yield from (NamedGroups(name, new, indices) for new, indices in parts)
            continue
        first = 1  # they are numbered, all of one name together
        for new, indices in parts:
            yield NamedGroups(f"{name}[]", new, (*indices, first + np.arange(len(new))))
            first += len(new)


def _name(node: FlatNode) -> str:
    """The name of a node's groups: of one that the compiler made, what the user wrote."""
    if not node.made:
        return node.path
    text = " ".join(node.span.text.split())
    text = text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"
    name = node.instance.named(f"{node.template}({text})")
    return name + "[]" * (len(node.instance.domain.indices) - name.count("[]"))
