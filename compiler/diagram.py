"""The structure of a model as data: its groups and what is in them, slow ones first, and who reads what of whom.

In: a `Model`. Out: a `Diagram`. Guaranteed: the incidence is block triangular: what a member reads stands in its own block or in an earlier
one. A block is a group with the members without states that it both feeds and reads; any other member without states is a block alone.
Initial values make no dependence and are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hierc.compiler.cascade.graphs import components, order
from hierc.compiler.expression import Input, Local
from hierc.compiler.model import Model, Node, Source
from hierc.compiler.shapes.values import element_names
from hierc.compiler.structure.flat import leaves


@dataclass(frozen=True, slots=True)
class Reading:
    """What a member reads of another: the variables by path, `plan.p` for a whole vector, `plan.p'` for its derivative."""

    owner: int  # index in Diagram.members
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """An agent, or a level with equations of its own."""

    path: str
    template: str  # the agent's name, or `Agent.level`
    levels: tuple[str, ...]  # around it, from the outside
    group: str | None  # None: it has no states, and whoever reads it computes it
    block: int
    states: tuple[str, ...]
    reads: tuple[Reading, ...]


@dataclass(frozen=True, slots=True)
class Diagram:
    """The members of a model, block by block in an order in which each block reads only earlier ones."""

    model: str
    file: str
    experiment: str | None
    groups: tuple[str, ...]  # in cascade order
    members: tuple[Member, ...]

    def divided(self) -> frozenset[str]:
        """The levels that hold several groups; the others are a group, or a part of one."""
        held: dict[str, set[str]] = {}
        for member in self.members:
            for level in member.levels:
                held.setdefault(level, set()).update((member.group,) if member.group else ())
        return frozenset(level for level, groups in held.items() if len(groups) > 1)


def diagram(model: Model) -> Diagram:
    """The diagram of a model."""
    group_of = {node: group.name for group in model.groups for node in group.nodes}
    sources = [continuous_sources(model, node) for node in model.nodes]
    blocks = _blocks(model, sources)
    block_of = {node: index for index, block in enumerate(blocks) for node in block}
    places = {node: place for place, node in enumerate(node for block in blocks for node in block)}
    names = _Names(model)
    members = tuple(
        Member(
            path=model.nodes[node].path or model.name,
            template=model.nodes[node].template,
            levels=model.nodes[node].levels,
            group=group_of.get(node),
            block=block_of[node],
            states=tuple(state.name for state in model.nodes[node].states),
            reads=tuple(
                Reading(places[owner], names.of(read))
                for owner, read in sorted(by_owner(sources[node]).items(), key=lambda item: places[item[0]])
            ),
        )
        for node in places
    )
    groups = tuple(group.name for group in model.groups)
    return Diagram(model.name, model.file, model.experiment.name, groups, members)


def by_owner(sources: Iterable[Source]) -> dict[int, list[Source]]:
    """Sources by the node that they belong to."""
    found: dict[int, list[Source]] = {}
    for source in sources:
        found.setdefault(source.node, []).append(source)
    return found


def continuous_sources(model: Model, node: Node) -> tuple[Source, ...]:
    """The inputs of a node that its derivatives and algebraic variables use, in order of first use."""
    algebraic = {
        element.index
        for variable in model.variables
        for element in variable.elements
        if element.node == node.id and element.kind == "local"
    }
    waiting = [node.definitions[index].value for index in algebraic] + [state.rate for state in node.states]
    inputs: set[int] = set()
    seen = set(algebraic)
    while waiting:
        for leaf in leaves(waiting.pop()):
            if isinstance(leaf, Input):
                inputs.add(leaf.index)
            elif isinstance(leaf, Local) and leaf.index not in seen:
                seen.add(leaf.index)
                waiting.append(node.definitions[leaf.index].value)
    return tuple(node.inputs[index] for index in sorted(inputs))


def _blocks(model: Model, sources: Sequence[Sequence[Source]]) -> list[list[int]]:
    """The nodes of each block, in execution order within one."""
    home = {node: group.nodes[0] for group in model.groups for node in group.nodes}
    homes = [home.get(node.id, node.id) for node in model.nodes]
    needs: list[list[int]] = [[] for _ in model.nodes]
    for node, read in enumerate(sources):
        needs[homes[node]] += [homes[source.node] for source in read if homes[source.node] != homes[node]]
    for node, at in enumerate(homes):
        if at != node:  # a group is one vertex: its first node, to which its others are tied
            needs[node].append(at)
            needs[at].append(node)
    part_of = {node: index for index, part in enumerate(components(needs)) for node in part}
    blocks: dict[int, list[int]] = {}
    for node in order(needs, lambda node: node):
        blocks.setdefault(part_of[node], []).append(node)
    return list(blocks.values())


class _Names:
    """Names of sources, as results have them: vectors that are read whole have one name."""

    def __init__(self, model: Model) -> None:
        own = [variable for variable in model.variables if variable.access != "read"]
        self._variable = {element: variable for variable in own for element in variable.elements}
        self._element = {
            element: name
            for variable in own
            for element, name in zip(
                variable.elements, element_names(variable.path, variable.shape), strict=True
            )
        }

    def of(self, sources: Sequence[Source]) -> tuple[str, ...]:
        """The names of scalars of one node, each once: states, each before its derivative, then algebraic variables."""
        given = set(sources)
        ordered = sorted(sources, key=lambda s: (s.kind == "local", s.index, s.kind == "rate"))
        return tuple(dict.fromkeys(self._name(source, given) for source in ordered))

    def _name(self, source: Source, given: set[Source]) -> str:
        rate = source.kind == "rate"
        element = Source(source.node, "state", source.index) if rate else source
        variable = self._variable[element]
        whole = (Source(e.node, "rate", e.index) if rate else e for e in variable.elements)
        name = variable.path if given.issuperset(whole) else self._element[element]
        return name + ("'" if rate else "")
