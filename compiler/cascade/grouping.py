"""Grouping: which nodes make a subsystem with a step size of its own, and the order of everything.

In: nodes and their dependences. Out: a `Grouping`. Guaranteed: every node with states is in exactly one group; groups are acyclic and in order of
dependence, then text; nodes are in an order in which each comes after those it reads, group by group.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from hierc.compiler.cascade.errors import (
    CyclicGroups,
    InTwoGroups,
    LevelWithoutStates,
    NameTaken,
    NoSuchMember,
)
from hierc.compiler.cascade.graphs import components, order
from hierc.compiler.cascade.proof import Cascade
from hierc.compiler.collector import Collector
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.instances import Instance, Standing, level_name
from hierc.compiler.structure.nodes import LocalNode
from hierc.grammar import tree
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class NamedGroup:
    """A group: its name and its nodes in execution order, by their ids in text order."""

    name: str
    nodes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Grouping:
    """Groups in cascade order, and all nodes in execution order."""

    groups: tuple[NamedGroup, ...]
    order: tuple[int, ...]


def make_groups(
    model_name: str,
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    cascade: Cascade,
    problems: Collector,
) -> Grouping:
    """Assign nodes to groups as the user wrote them."""
    names = _Assignment(model_name, instances, flat_nodes, nodes, cascade, problems).names()
    _warn_of_stateless_levels(instances, flat_nodes, nodes, names, cascade, problems)
    groups = list(dict.fromkeys(name for name in names if name is not None))
    index = {name: i for i, name in enumerate(groups)}
    edges: list[dict[int, Span]] = [{} for _ in groups]
    for here, name in enumerate(names):
        for read in cascade.reads[here]:
            other = names[read.source]
            if name is not None and other is not None and other != name:
                edges[index[name]].setdefault(index[other], read.span)
    _check_acyclic(groups, edges, names, problems)
    problems.stop_on_errors()
    sorted_groups = order([list(e) for e in edges], lambda g: names.index(groups[g]))
    rank: dict[str | None, int] = {groups[g]: place for place, g in enumerate(sorted_groups)}
    node_order = order(cascade.direct, lambda node: (rank.get(names[node], -1), node), cascade.computed)
    return Grouping(
        tuple(
            NamedGroup(groups[g], tuple(n for n in node_order if names[n] == groups[g]))
            for g in sorted_groups
        ),
        tuple(node_order),
    )


class _Assignment:
    """Finds the group of each node with states: the user's `group`, the innermost level, or the agents that need each other."""

    def __init__(
        self,
        model_name: str,
        instances: Sequence[Instance],
        flat_nodes: Sequence[FlatNode],
        nodes: Sequence[LocalNode],
        cascade: Cascade,
        problems: Collector,
    ) -> None:
        self._model_name = model_name
        self._instances = instances
        self._flat_nodes = flat_nodes
        self._nodes = nodes
        self._cascade = cascade
        self._problems = problems

    def names(self) -> list[str | None]:
        """The name of each node's group; None for nodes without states."""
        found: list[str | None] = [None] * len(self._nodes)
        written = self._of_user()
        for node, name in written.items():
            found[node] = name
        loose: list[int] = []
        for here in self._nodes:
            node = here.node.id
            if not here.node.states or found[node] is not None:
                continue
            levels = self._flat_nodes[node].levels
            if levels:
                found[node] = level_name(self._instances, levels[-1])
            else:
                loose.append(node)
        for part in self._connected(loose):
            name = "+".join(self._flat_nodes[node].path or self._model_name for node in part)
            for node in part:
                found[node] = name
        self._check_rest(found, written)
        return [name if self._nodes[n].node.states else None for n, name in enumerate(found)]

    def _check_rest(self, names: Sequence[str | None], written: Mapping[int, str]) -> None:
        """What no `group` names may have the name of none: a level that is split, or an agent."""
        spans = {i.named(g.name.text): g.name.span for i in self._instances for g in i.agent.groups.values()}
        rest = {name: node for node, name in enumerate(names) if name is not None and node not in written}
        for name in rest.keys() & set(written.values()):
            kind: Literal["level", "agent"] = "level" if self._flat_nodes[rest[name]].levels else "agent"
            path = self._flat_nodes[rest[name]].path
            self._problems.add(NameTaken(spans[name], name=name, kind=kind, rest=path))

    def _connected(self, loose: Sequence[int]) -> list[list[int]]:
        """Strongly connected sets among nodes that stand in no level."""
        place = {node: i for i, node in enumerate(loose)}
        edges = [[place[r.source] for r in self._cascade.reads[node] if r.source in place] for node in loose]
        return [[loose[i] for i in part] for part in components(edges)]

    def _of_user(self) -> dict[int, str]:
        """Nodes that `group` statements name."""
        found: dict[int, tuple[str, Span]] = {}
        for instance in self._instances:
            for group in instance.agent.groups.values():
                levels: set[tuple[Standing, ...]] = set()
                for pattern in group.members:
                    for node in self._members(instance, pattern, levels):
                        name, first = instance.named(group.name.text), found.get(node)
                        if first is not None and first[0] != name:
                            path = self._flat_nodes[node].path
                            problem = InTwoGroups(
                                pattern.span, name=path, first=first[0], second=name, first_span=first[1]
                            )
                            self._problems.add(problem)
                        found[node] = (name, pattern.span)
        return {node: name for node, (name, _) in found.items()}

    def _members(
        self, instance: Instance, pattern: tree.Pattern, levels: set[tuple[Standing, ...]]
    ) -> list[int]:
        """The nodes of the agents that a pattern names. `levels` collects where the group's members stand."""
        at = instance
        for step in pattern.path.steps:
            name = step.name.text
            if name not in at.children:
                level = name in at.agent.levels
                self._refuse(pattern, f"`{name}` is {'a level, not an agent' if level else 'no agent here'}")
                return []
            at = self._instances[at.children[name]]
        levels.add(at.levels)
        if len(levels) > 1:
            self._refuse(pattern, "its members stand in different levels")
            return []
        inside = [
            n for n, node in enumerate(self._flat_nodes) if self._within(node.instance, at, star=pattern.star)
        ]
        if any(len(self._flat_nodes[n].levels) > len(at.levels) for n in inside):
            self._refuse(pattern, "it has levels, which are groups already")
            return []
        return inside

    def _within(self, instance: Instance, outer: Instance, *, star: bool) -> bool:
        """Whether an instance is `outer` (not for `outer.*`) or in it."""
        here: Instance = instance
        if here.id == outer.id:
            return not star
        while here.parent is not None:
            here = self._instances[here.parent]
            if here.id == outer.id:
                return True
        return False

    def _refuse(self, pattern: tree.Pattern, reason: str) -> None:
        self._problems.add(NoSuchMember(pattern.span, pattern=pattern.span.text, reason=reason))


def _check_acyclic(
    groups: Sequence[str],
    edges: Sequence[dict[int, Span]],
    names: Sequence[str | None],
    problems: Collector,
) -> None:
    """Report a shortest closed path for each set of groups that depend on each other."""
    for part in components([list(e) for e in edges]):
        if len(part) > 1:
            path = _shortest(part, edges)
            reads = [edges[a][b] for a, b in zip(path, [*path[1:], path[0]], strict=True)]
            closed = tuple(groups[g] for g in path)
            shown = tuple((span.text, span) for span in reads)
            several = next((name for name in closed if names.count(name) > 1), None)
            problems.add(CyclicGroups(reads[0], groups=closed, reads=shown, several=several))


def _shortest(part: Sequence[int], edges: Sequence[dict[int, Span]]) -> list[int]:
    """A shortest closed path through the first of `part`."""
    start, inside = part[0], set(part)
    came_from: dict[int, int] = {}
    queue = deque([start])
    while start not in came_from:
        here = queue.popleft()
        for other in edges[here]:
            if other in inside and other not in came_from:
                came_from[other] = here
                queue.append(other)
    path = [came_from[start]]
    while path[-1] != start:
        path.append(came_from[path[-1]])
    return path[::-1]


def _warn_of_stateless_levels(
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    names: Sequence[str | None],
    cascade: Cascade,
    problems: Collector,
) -> None:
    """W611 for each level that has equations but, at any depth, no states; not for the levels inside it."""
    members: dict[Standing, set[int]] = {}
    for n, node in enumerate(flat_nodes):
        for standing in node.levels:
            members.setdefault(standing, set()).add(n)
    told: set[int] = set()
    for standing, inside in sorted(members.items(), key=lambda item: len(item[1]), reverse=True):
        if inside <= told or any(nodes[n].node.states for n in inside):
            continue
        told |= inside
        readers = [names[n] for n, direct in enumerate(cascade.direct) if inside & set(direct)]
        reader = next((r for r in readers if r is not None), None)
        (instance, outer), index = standing
        agent = instances[instance].agent
        span = agent.levels[agent.inside(outer)[index]].span
        problems.add(LevelWithoutStates(span, level=level_name(instances, standing), reader=reader))
