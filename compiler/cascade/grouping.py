"""Grouping: which nodes make a subsystem with a step size of its own, and the order of everything.

In: nodes and their dependences. Out: a `Grouping`. Guaranteed: every node with states is in exactly one group; groups are acyclic and in order of
dependence, then text; nodes are in an order in which each comes after those it reads, group by group.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from hierc.compiler.cascade.errors import CyclicGroups, InTwoGroups, LevelWithoutStates, NoSuchMember
from hierc.compiler.cascade.graphs import components, order
from hierc.compiler.cascade.proof import Cascade
from hierc.compiler.collector import Collector
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.instances import Instance
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
    _check_acyclic(groups, edges, problems)
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
        for node, name in self._of_user().items():
            found[node] = name
        loose: list[int] = []
        for here in self._nodes:
            node = here.node.id
            if not here.node.states or found[node] is not None:
                continue
            levels = self._flat_nodes[node].levels
            if levels:
                found[node] = self._level_name(*levels[-1])
            else:
                loose.append(node)
        for part in self._connected(loose):
            name = "+".join(self._flat_nodes[node].path or self._model_name for node in part)
            for node in part:
                found[node] = name
        return [name if self._nodes[n].node.states else None for n, name in enumerate(found)]

    def _level_name(self, instance: int, index: int) -> str:
        around = self._instances[instance]
        return around.named(list(around.agent.levels)[index])

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
                levels: set[str | None] = set()
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

    def _members(self, instance: Instance, pattern: tree.Pattern, levels: set[str | None]) -> list[int]:
        """The nodes of the agents that a pattern names. `levels` collects the levels of the group's members."""
        at = instance
        for step in pattern.path.steps:
            if step.name.text not in at.children:
                self._refuse(pattern, f"`{step.name.text}` is no agent here")
                return []
            at = self._instances[at.children[step.name.text]]
        level = self._first_step(instance, pattern).level
        levels.add(level)
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

    def _first_step(self, instance: Instance, pattern: tree.Pattern) -> Instance:
        return self._instances[instance.children[pattern.path.steps[0].name.text]]

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


def _check_acyclic(groups: Sequence[str], edges: Sequence[dict[int, Span]], problems: Collector) -> None:
    """Report a shortest closed path for each set of groups that depend on each other."""
    for part in components([list(e) for e in edges]):
        if len(part) > 1:
            path = _shortest(part, edges)
            reads = [edges[a][b] for a, b in zip(path, [*path[1:], path[0]], strict=True)]
            names = tuple(groups[g] for g in path)
            problems.add(
                CyclicGroups(reads[0], groups=names, reads=tuple((span.text, span) for span in reads))
            )


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
    """W611 for each level that has equations but, at any depth, no states."""
    for instance in instances:
        for index, (name, level) in enumerate(instance.agent.levels.items()):
            inside = {n for n, node in enumerate(flat_nodes) if (instance.id, index) in node.levels}
            if inside and not any(nodes[n].node.states for n in inside):
                readers = [names[n] for n, direct in enumerate(cascade.direct) if inside & set(direct)]
                reader = next((r for r in readers if r is not None), None)
                problems.add(LevelWithoutStates(level.name.span, level=instance.named(name), reader=reader))
