"""Assignment: the group that every element with states belongs to.

In: nodes. Out: `Labels`. What the user wrote comes first (`group g = …;`, `group each car;`), then the innermost level, then, for agents in no level,
the sets that need each other. An owner, the agent that has the group, has one in each of its elements. Part of the phase `grouping.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Integers
from hierc.compiler.arrays.elements import plain, spelled
from hierc.compiler.arrays.errors import NotAnArray
from hierc.compiler.cascade.edges import Edges, element_edges
from hierc.compiler.cascade.errors import InTwoGroups, LargeGroup, NameTaken, NoSuchMember
from hierc.compiler.collector import Collector
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.instances import Instance, Standing, level_name
from hierc.compiler.structure.nodes import LocalNode
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Agents of an array from which on one group for all of them, without a loop, is worth a warning.
MANY = 10
#: Members that the name of a group spells out.
SPELLED = 4


@dataclass(frozen=True, slots=True)
class NamedGroups:
    """Groups of one name, one in each element of their owner: their labels, rising, and the owner's indices."""

    name: str
    labels: Integers
    indices: tuple[Integers, ...]


@dataclass(frozen=True, slots=True)
class Labels:
    """The group of each element by its number, -1 for those that are in none. `count` is more than any label."""

    of_element: Integers
    names: tuple[NamedGroups, ...]
    count: int

    def name(self, label: int) -> str:
        """The name of a group: `car[3]`."""
        for groups in self.names:
            place = int(np.searchsorted(groups.labels, label))
            if place < len(groups.labels) and groups.labels[place] == label:
                return spelled(groups.name, [int(column[place]) for column in groups.indices])
        raise ValueError(f"no group {label}")

    def is_shared(self, label: int) -> bool:
        """Whether a group holds more than one element."""
        return int((self.of_element == label).sum()) > 1


@dataclass(frozen=True, slots=True)
class _Home:
    """The groups that a node belongs to; `owner` has one in each of its elements."""

    name: str
    owner: Instance
    written: bool  # by the user


class Assignment:
    """Finds the group of each element."""

    def __init__(
        self,
        model_name: str,
        instances: Sequence[Instance],
        flat_nodes: Sequence[FlatNode],
        nodes: Sequence[LocalNode],
        problems: Collector,
    ) -> None:
        self._model_name = model_name
        self._instances = instances
        self._flat_nodes = flat_nodes
        self._nodes = nodes
        self._problems = problems

    def labels(self) -> Labels:
        """The groups of all elements."""
        homes = self._homes()
        self._check_rest(homes)
        total = self._nodes[-1].node.first + self._nodes[-1].node.count if self._nodes else 0
        of_element = np.full(total, -1, np.int64)
        found: dict[tuple[str, int], NamedGroups] = {}
        count = 0
        for here, home in zip(self._nodes, homes, strict=True):
            if home is None:
                continue
            key, domain = (home.name, home.owner.id), home.owner.domain
            if key not in found:
                found[key] = NamedGroups(home.name, np.arange(count, count + domain.count), domain.indices)
                count += domain.count
            places = self._flat_nodes[here.node.id].instance.domain.within(domain)
            of_element[here.node.first : here.node.first + here.node.count] = found[key].labels[places]
        labels = Labels(of_element, tuple(found.values()), count)
        loose = [self._is_loose(n, home) for n, home in enumerate(homes)]
        return self._joined(labels, loose)

    def _homes(self) -> list[_Home | None]:
        """The groups of each node; None for nodes without states. Agents in no level have one each, so far."""
        written = self._of_user()
        homes: list[_Home | None] = []
        for n, (here, flat) in enumerate(zip(self._nodes, self._flat_nodes, strict=True)):
            if not here.node.states:
                homes.append(None)
            elif n in written:
                homes.append(written[n])
            elif flat.levels:
                (instance, _), _ = flat.levels[-1]
                name = level_name(self._instances, flat.levels[-1])
                homes.append(_Home(name, self._instances[instance], written=False))
            else:
                homes.append(_Home(flat.path or self._model_name, flat.instance, written=False))
        return homes

    def _is_loose(self, n: int, home: _Home | None) -> bool:
        return home is not None and not home.written and not self._flat_nodes[n].levels

    def _check_rest(self, homes: Sequence[_Home | None]) -> None:
        """What no `group` names may have the name of none: a level that is split, or an agent."""
        spans = {i.named(g.name.text): g.name.span for i in self._instances for g in i.agent.groups.values()}
        rest = {home.name: n for n, home in enumerate(homes) if home is not None and not home.written}
        taken = {home.name for home in homes if home is not None and home.written} & spans.keys()
        for name in rest.keys() & taken:
            kind: Literal["level", "agent"] = "level" if self._flat_nodes[rest[name]].levels else "agent"
            path = plain(self._flat_nodes[rest[name]].path)
            self._problems.add(NameTaken(spans[name], name=plain(name), kind=kind, rest=path))

    # ---- agents in no level ---------------------------------------------------------------------------------------------------------

    def _joined(self, labels: Labels, loose: Sequence[bool]) -> Labels:
        """Agents in no level that need each other become one group, in the place of the first of them."""
        free = np.zeros(labels.count, np.bool_)
        for here in (here for here, is_loose in zip(self._nodes, loose, strict=True) if is_loose):
            free[labels.of_element[here.node.first : here.node.first + here.node.count]] = True
        edges = _among(element_edges(self._nodes, labels.of_element, labels.count), free)
        parts = edges.closed()
        if not parts:
            return labels
        first = np.arange(labels.count)  # of the set that each label is in
        for part in parts:
            first[part] = part[0]
        joined = np.zeros(labels.count, np.bool_)
        joined[np.concatenate(parts)] = True
        names = [_without(groups, joined) for groups in labels.names]
        names += self._together(labels, parts)
        kept = sorted((groups for groups in names if len(groups.labels)), key=lambda g: int(g.labels[0]))
        of_element = np.where(labels.of_element >= 0, first[labels.of_element], -1)
        return Labels(of_element, tuple(kept), labels.count)

    def _together(self, labels: Labels, parts: Sequence[Integers]) -> Iterator[NamedGroups]:
        """Groups of several agents. Sets that are made of the same agents, of different elements, are one family."""
        owner = np.zeros(labels.count, np.int64)
        place = np.zeros(labels.count, np.int64)
        for k, groups in enumerate(labels.names):
            owner[groups.labels], place[groups.labels] = k, np.arange(len(groups.labels))
        alike: dict[tuple[int, ...], list[Integers]] = {}
        for part in parts:
            if len(part) > SPELLED:
                yield NamedGroups(self._abbreviated(labels, part, owner), part[:1], ())
            else:
                alike.setdefault(tuple(owner[part].tolist()), []).append(part)
        for members, sets in alike.items():
            rising = sorted(sets, key=_first)
            table = np.stack(rising)
            name = "+".join(labels.names[k].name for k in members)
            indices = [
                column[place[table[:, m]]]
                for m, k in enumerate(members)
                for column in labels.names[k].indices
            ]
            yield NamedGroups(name, table[:, 0], tuple(indices))

    def _abbreviated(self, labels: Labels, part: Integers, owner: Integers) -> str:
        """The name of a group of many agents: all of an array by its name."""
        whole = [labels.names[k] for k in np.unique(owner[part]).tolist()]
        if sum(len(groups.labels) for groups in whole) == len(part):
            return "+".join(dict.fromkeys(plain(groups.name) for groups in whole))
        return "+".join([*(labels.name(int(label)) for label in part[:SPELLED]), "…"])

    # ---- what the user wrote ----------------------------------------------------------------------------------------------------------

    def _of_user(self) -> dict[int, _Home]:
        """Nodes that `group` statements name."""
        found: dict[int, tuple[_Home, Span]] = {}
        for instance in self._instances:
            for group in instance.agent.groups.values():
                home = _Home(instance.named(group.name.text), instance, written=True)
                levels: set[tuple[Standing, ...]] = set()
                for pattern in group.members:
                    for n in self._members(instance, pattern, levels):
                        self._put(found, n, home, pattern.span)
            for each in instance.agent.each.values():
                for n, block in self._each(instance, each):
                    self._put(found, n, _Home(block.path, block, written=True), each.name.span)
        return {n: home for n, (home, _) in found.items()}

    def _put(self, found: dict[int, tuple[_Home, Span]], n: int, home: _Home, span: Span) -> None:
        first = found.get(n)
        if first is not None and first[0].name != home.name:
            names = (self._flat_nodes[n].path, first[0].name, home.name)
            path, one, other = (plain(name) for name in names)
            self._problems.add(InTwoGroups(span, name=path, first=one, second=other, first_span=first[1]))
        found[n] = (home, span)

    def _each(self, instance: Instance, each: tree.GroupEach) -> Iterator[tuple[int, Instance]]:
        """The nodes of the agents of an array, with the blocks that they are in."""
        array = instance.arrays.get(each.name.text)
        if array is None:
            arrays = tuple(instance.arrays)
            self._problems.add(NotAnArray(each.name.span, name=each.name.text, arrays=arrays))
            return
        for block in (self._instances[b] for b in array.blocks):
            inside = self._inside([block], star=False)
            if any(len(self._flat_nodes[n].levels) > len(block.levels) for n in inside):
                self._refuse(each.name.span, each.name.text, "it has levels, which are groups already")
                return
            yield from ((n, block) for n in inside)

    def _members(
        self, instance: Instance, pattern: tree.Pattern, levels: set[tuple[Standing, ...]]
    ) -> list[int]:
        """The nodes of the agents that a pattern names. `levels` collects where the group's members stand."""
        at, text = [instance], pattern.span.text
        for step in pattern.path.steps:
            name, agent = step.name.text, at[0].agent
            if name not in agent.subs:
                reason = "a level, not an agent" if name in agent.levels else "no agent here"
                self._refuse(pattern.span, text, f"`{name}` is {reason}")
                return []
            if step.subs:
                self._refuse(pattern.span, text, "a group holds all agents of an array")
                return []
            at = [block for here in at for block in self._named(here, name)]
        levels.update(here.levels for here in at)
        if len(levels) > 1:
            self._refuse(pattern.span, text, "its members stand in different levels")
            return []
        inside = self._inside(at, star=pattern.star)
        if any(len(self._flat_nodes[n].levels) > len(at[0].levels) for n in inside):
            self._refuse(pattern.span, text, "it has levels, which are groups already")
            return []
        return inside

    def _named(self, here: Instance, name: str) -> list[Instance]:
        ids = here.arrays[name].blocks if name in here.arrays else (here.children[name],)
        return [self._instances[i] for i in ids]

    def _inside(self, outer: Sequence[Instance], *, star: bool) -> list[int]:
        """The nodes of some agents (not for `outer.*`) and of all inside them."""
        ids = {instance.id for instance in outer}
        return [n for n, node in enumerate(self._flat_nodes) if self._within(node.instance, ids, star=star)]

    def _within(self, instance: Instance, outer: set[int], *, star: bool) -> bool:
        here: Instance = instance
        if here.id in outer:
            return not star
        while here.parent is not None:
            here = self._instances[here.parent]
            if here.id in outer:
                return True
        return False

    def _refuse(self, span: Span, pattern: str, reason: str) -> None:
        self._problems.add(NoSuchMember(span, pattern=pattern, reason=reason))


def _first(part: Integers) -> int:
    return int(part[0])


def _without(groups: NamedGroups, joined: NDArray[np.bool_]) -> NamedGroups:
    left = ~joined[groups.labels]
    return NamedGroups(groups.name, groups.labels[left], tuple(column[left] for column in groups.indices))


def _among(edges: Edges, free: NDArray[np.bool_]) -> Edges:
    """The edges between some labels, and those that lead through elements without states."""
    allowed = np.concatenate([free, np.ones(edges.vertices - edges.labels, np.bool_)])
    kept = allowed[edges.reads] & allowed[edges.read]
    return replace(edges, reads=edges.reads[kept], read=edges.read[kept], at=edges.at[kept])


def warn_of_large(
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    labels: Labels,
    problems: Collector,
) -> None:
    """W613 for each level that holds many agents of an array in one group, of which none needs itself through another."""
    candidates = [
        here
        for here in nodes
        if here.node.states and here.node.count >= MANY and _is_in_level(here, flat_nodes, labels)
    ]
    if not candidates:
        return
    stateful = np.flatnonzero(labels.of_element >= 0)
    own = np.full(len(labels.of_element), -1, np.int64)
    own[stateful] = np.arange(len(stateful))
    parts = element_edges(nodes, own, len(stateful)).parts
    for here in candidates:
        elements = np.arange(here.node.first, here.node.first + here.node.count)
        if len(np.unique(parts[own[elements]])) == here.node.count:
            instance = flat_nodes[here.node.id].instance
            while (
                instance.instance is not None
                and instance.instance.index is None
                and instance.parent is not None
            ):
                instance = instances[instance.parent]
            if instance.instance is not None:
                level = labels.name(int(labels.of_element[here.node.first]))
                name = instance.instance.name
                count = sum(i.domain.count for i in instances if i.outline == instance.outline)
                problems.add(LargeGroup(name.span, level=level, count=count, array=name.text))


def _is_in_level(here: LocalNode, flat_nodes: Sequence[FlatNode], labels: Labels) -> bool:
    """Whether all elements of a node are in one group, that of a level."""
    own = labels.of_element[here.node.first : here.node.first + here.node.count]
    return bool(flat_nodes[here.node.id].levels) and int(own.min()) == int(own.max())
