"""Grouping: which nodes make a subsystem with a step size of its own, and the order of everything.

In: nodes and their dependences. Out: a `Grouping`. Guaranteed: every element with states is in exactly one group, and of the others those that several
groups share (`sharing.py`); groups are acyclic and in order of dependence, then text; nodes are in an order in which each comes after those it reads,
group by group.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hierc.compiler.arrays.columns import Integers, expanded
from hierc.compiler.arrays.elements import plain
from hierc.compiler.cascade.assignment import Assignment, Labels, NamedGroups, warn_of_large
from hierc.compiler.cascade.edges import Edges, element_edges
from hierc.compiler.cascade.errors import CyclicGroups, LevelWithoutStates
from hierc.compiler.cascade.graphs import order
from hierc.compiler.cascade.proof import Cascade
from hierc.compiler.cascade.sharing import share
from hierc.compiler.collector import Collector
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.instances import Instance, Standing, level_name
from hierc.compiler.structure.nodes import LocalNode


@dataclass(frozen=True, slots=True)
class Family:
    """Groups of equal form. `nodes`: columns of element numbers, as in `model.Group`, by node in execution order."""

    name: str
    nodes: tuple[tuple[int, Integers], ...]
    labels: Integers  # of the groups
    indices: tuple[Integers, ...]


@dataclass(frozen=True, slots=True)
class Grouping:
    """Families of groups in the order of their first groups; the cascade order of all groups, numbered through them, where it is another;
    and all nodes in execution order.
    """

    families: tuple[Family, ...]
    group_order: Integers | None
    order: tuple[int, ...]


def make_groups(
    model_name: str,
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    cascade: Cascade,
    problems: Collector,
) -> Grouping:
    """Assign elements to groups as the user wrote them."""
    assignment = Assignment(model_name, instances, flat_nodes, nodes, problems)
    labels = assignment.labels()
    edges = element_edges(nodes, labels.of_element, labels.count)
    _check_acyclic(labels, edges, problems)
    problems.stop_on_errors()
    warn_of_large(instances, flat_nodes, nodes, labels, problems)
    shared = share(flat_nodes, nodes, labels, edges)
    if shared is not labels:
        labels, edges = shared, element_edges(nodes, shared.of_element, shared.count)
    _warn_of_stateless_levels(instances, flat_nodes, nodes, labels, cascade, problems)
    rank = cascade_rank(edges)
    first = [min(rank[own[own >= 0]], default=-1) for own in (_labels(here, labels) for here in nodes)]
    node_order = order(cascade.direct, lambda node: (int(first[node]), node), cascade.computed)
    families = sorted(_families(nodes, node_order, labels), key=lambda family: int(rank[family.labels].min()))
    numbered = np.concatenate([family.labels for family in families]) if families else np.zeros(0, np.int64)
    group_order = np.argsort(rank[numbered], kind="stable")
    natural = bool((group_order == np.arange(len(group_order))).all())
    return Grouping(tuple(families), None if natural else group_order, tuple(node_order))


def _families(nodes: Sequence[LocalNode], node_order: Sequence[int], labels: Labels) -> Iterator[Family]:
    """Groups of one name, divided where what they hold or read differs in form."""
    members = _members(nodes, node_order, labels)
    for name, found in zip(labels.names, members, strict=True):
        for places in _alike(nodes, found, labels, name):
            whole = len(places) == len(name.labels)
            columns = [
                (
                    n,
                    elements
                    if whole
                    else elements[np.isin(labels.of_element[elements], name.labels[places])],
                )
                for n, elements in found
            ]
            kept = tuple((n, column_) for n, column_ in columns if len(column_))
            yield Family(name.name, kept, name.labels[places], tuple(c[places] for c in name.indices))


def _members(
    nodes: Sequence[LocalNode], node_order: Sequence[int], labels: Labels
) -> list[list[tuple[int, Integers]]]:
    """For each name, the nodes that have elements in its groups, with these elements, group by group."""
    names = np.zeros(labels.count, np.int64)
    for k, name in enumerate(labels.names):
        names[name.labels] = k
    found: list[list[tuple[int, Integers]]] = [[] for _ in labels.names]
    for n in node_order:
        node, own = nodes[n].node, _labels(nodes[n], labels)
        held = own >= 0
        for k in np.unique(names[own[held]]).tolist():
            inside = np.flatnonzero(held & (names[own] == k))
            found[k].append((n, inside[np.argsort(own[inside], kind="stable")] + node.first))
    return found


def _labels(here: LocalNode, labels: Labels) -> Integers:
    """The groups of a node's elements, -1 for those that are in none."""
    return labels.of_element[here.node.first : here.node.first + here.node.count]


def _alike(
    nodes: Sequence[LocalNode], members: Sequence[tuple[int, Integers]], labels: Labels, name: NamedGroups
) -> list[Integers]:
    """The groups of a family that hold equally many elements of each node, and read of themselves the same."""
    everything = np.arange(len(name.labels))
    if len(everything) == 1:
        return [everything]
    marks: list[Integers] = []
    for n, elements in members:
        here = nodes[n]
        groups = np.searchsorted(name.labels, labels.of_element[elements])
        counts = np.bincount(groups, minlength=len(everything))
        marks.append(counts)
        if counts.min() < counts.max():
            continue
        for k in range(here.continuous):
            read = expanded(here.node.inputs[k].node, here.node.count)[elements - here.node.first]
            own = labels.of_element[read] == labels.of_element[elements]
            marks += list(own.reshape(len(everything), -1).T.astype(np.int64))
    marks = [mark for mark in marks if (mark != mark[0]).any()]
    if not marks:
        return [everything]
    _, kinds = np.unique(np.stack(marks), axis=1, return_inverse=True)
    kinds = kinds.reshape(-1)
    ranked = sorted(set(kinds.tolist()), key=lambda kind: int(np.argmax(kinds == kind)))
    return [everything[kinds == kind] for kind in ranked]


def cascade_rank(edges: Edges) -> Integers:
    """The place of each group in the cascade: after those that it reads and, where that leaves a choice, as they are numbered."""
    count = edges.labels
    inside = (edges.reads < count) & (edges.read < count)
    forward = bool((edges.reads[inside] >= edges.read[inside]).all())
    if forward and edges.vertices == count:
        return np.arange(count)
    needs: list[list[int]] = [[] for _ in range(edges.vertices)]
    for reads, read in zip(edges.reads.tolist(), edges.read.tolist(), strict=True):
        if reads != read:
            needs[reads].append(read)
    groups = [vertex for vertex in order(needs, lambda vertex: (vertex < count, vertex)) if vertex < count]
    rank = np.empty(count, np.int64)
    rank[groups] = np.arange(count)
    return rank


def _check_acyclic(labels: Labels, edges: Edges, problems: Collector) -> None:
    """Report a shortest closed path for each set of groups that depend on each other."""
    for part in edges.closed():
        path = edges.shortest_cycle(part)
        closed = tuple(labels.name(label) for label, _ in path)
        shown = tuple((span.text, span) for _, span in path)
        several = next((labels.name(label) for label, _ in path if labels.is_shared(label)), None)
        problems.add(CyclicGroups(shown[0][1], groups=closed, reads=shown, several=several))


def _warn_of_stateless_levels(
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    labels: Labels,
    cascade: Cascade,
    problems: Collector,
) -> None:
    """W611 for each level that has equations but, at any depth, no group; not for the levels inside it."""
    grouped = {n for n, here in enumerate(nodes) if (_labels(here, labels) >= 0).any()}
    members: dict[Standing, set[int]] = {}
    for n, node in enumerate(flat_nodes):
        for standing in node.levels:
            members.setdefault(standing, set()).add(n)
    told: set[int] = set()
    for standing, inside in sorted(members.items(), key=lambda item: len(item[1]), reverse=True):
        if inside <= told or inside & grouped:
            continue
        told |= inside
        readers = [
            n for n, direct in enumerate(cascade.direct) if inside & set(direct) and nodes[n].node.states
        ]
        reader = labels.name(int(labels.of_element[nodes[readers[0]].node.first])) if readers else None
        (instance, outer), index = standing
        agent = instances[instance].agent
        span = agent.levels[agent.inside(outer)[index]].span
        problems.add(LevelWithoutStates(span, level=plain(level_name(instances, standing)), reader=reader))
