"""The structure of a model as data: its groups and what is in them, slow ones first, and who reads what of whom.

In: a `Model`. Out: a `Diagram`. Guaranteed: the incidence is block triangular: what a member reads stands in its own block or in an earlier
one. A block is a group with the members without states that it both feeds and reads; any other member without states is a block alone. Agents of an
array that say the same thing are one member, and the groups of a family stand in one block, together with arrays that they read in turn. Initial values
make no dependence and are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hierc.compiler.arrays.columns import Integers, expanded, taken
from hierc.compiler.arrays.elements import Elements, spelled
from hierc.compiler.cascade.graphs import components, order
from hierc.compiler.expression import Input, Local
from hierc.compiler.model import Group, Model, Node, Source
from hierc.compiler.shapes.values import element_names
from hierc.compiler.structure.flat import leaves

#: A scalar of a node: a state, its derivative, or a definition.
Scalar = tuple[Literal["state", "rate", "local"], int]


@dataclass(frozen=True, slots=True)
class Reading:
    """What a member reads of another: the variables by path, `plan.p` for a whole vector, `plan.p'` for its derivative."""

    owner: int  # index in Diagram.members
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """An agent, a level with equations of its own, or `count` of them in an array that say the same thing: `car[2..9]`."""

    path: str
    template: str  # the agent's name, or `Agent.level`
    levels: tuple[str, ...]  # around it, from the outside
    group: str | None  # None: it has no states, and whoever reads it computes it
    block: int
    states: tuple[str, ...]  # of one element
    reads: tuple[Reading, ...]
    count: int = 1


@dataclass(frozen=True, slots=True)
class Diagram:
    """The members of a model, block by block in an order in which each block reads only earlier ones."""

    model: str
    file: str
    experiment: str | None
    groups: tuple[str, ...]  # in cascade order; the groups of a family have one name, `car[2..9]`
    members: tuple[Member, ...]
    group_count: int

    def divided(self) -> frozenset[str]:
        """The levels that hold several groups; the others are a group, or a part of one."""
        held: dict[str, set[str]] = {}
        for member in self.members:
            for level in member.levels:
                held.setdefault(level, set()).update((member.group,) if member.group else ())
        return frozenset(level for level, groups in held.items() if len(groups) > 1)


def diagram(model: Model) -> Diagram:
    """The diagram of a model."""
    elements = Elements(node.first for node in model.nodes)
    held = [_held(group, elements) for group in model.groups]
    group_of = {
        node: spelled(g.name, g.indices)
        for g, nodes in reversed([*zip(model.groups, held, strict=True)])
        for node in nodes
    }
    read_by = map(_continuous, model.nodes, _algebraic(model, elements))
    sources = [_by_owner(read, node.count, elements) for read, node in zip(read_by, model.nodes, strict=True)]
    inner = _folded(model, sources)
    blocks = [[n for n in block if n not in inner] for block in _blocks(held, sources)]
    blocks = [block for block in blocks if block]
    block_of = {node: index for index, block in enumerate(blocks) for node in block}
    places = {node: place for place, node in enumerate(node for block in blocks for node in block)}
    names = _Names(model, elements)
    members = tuple(
        Member(
            path=spelled(model.nodes[node].path, model.nodes[node].indices) or model.name,
            template=model.nodes[node].template,
            levels=tuple(spelled(level, model.nodes[node].indices) for level in model.nodes[node].levels),
            group=group_of.get(node),
            block=block_of[node],
            states=tuple(state.name for state in model.nodes[node].states),
            reads=tuple(
                Reading(places[owner], names.of(owner, read))
                for owner, read in sorted(sources[node].items(), key=lambda item: places[item[0]])
            ),
            count=model.nodes[node].count,
        )
        for node in places
    )
    groups = tuple(spelled(group.name, group.indices) for group in model.groups)
    count = sum(group.count for group in model.groups)
    return Diagram(model.name, model.file, model.experiment.name, groups, members, count)


def _folded(model: Model, sources: list[dict[int, dict[Scalar, Integers]]]) -> set[int]:
    """Make one node, the last, of all those that join the same thing over many agents: it reads what they read. Returns the others."""
    joined: dict[str, list[int]] = {}
    for node in model.nodes:
        if not node.states and " " in node.path:  # no name of a user's: a sum or the like
            joined.setdefault(node.path, []).append(node.id)
    into: dict[int, int] = {}
    for nodes in joined.values():
        into |= dict.fromkeys(nodes[:-1], nodes[-1])
    for other, last in into.items():
        _add(sources[last], sources[other])
    for reader, read in enumerate(sources):  # a part of a slice is read by itself too
        for other in into.keys() & read.keys():
            _add(read, {into[other]: read.pop(other)})
        if reader in into.values():
            read.pop(reader, None)
    return set(into)


def _add(read: dict[int, dict[Scalar, Integers]], more: Mapping[int, Mapping[Scalar, Integers]]) -> None:
    """Read what is in `more` too."""
    for owner, scalars in more.items():
        known = read.setdefault(owner, {})
        for scalar, numbers in scalars.items():
            known[scalar] = np.union1d(known.get(scalar, numbers), numbers)


def _held(group: Group, elements: Elements) -> list[int]:
    """The nodes that a group, or a family of groups, holds elements of."""
    blocks = [elements.blocks(expanded(column, 1)) for column in group.nodes]
    return list(dict.fromkeys(block for some in blocks for block in np.unique(some).tolist()))


def _by_owner(sources: Iterable[Source], count: int, elements: Elements) -> dict[int, dict[Scalar, Integers]]:
    """What `count` elements read, by the node that it belongs to: its scalars, each with the elements that are read."""
    found: dict[int, dict[Scalar, Integers]] = {}
    for source in sources:
        numbers, indices = expanded(source.node, count), expanded(source.index, count)
        blocks = elements.blocks(numbers)
        for block, index in elements.touched(source, count):
            read = np.unique(numbers[(blocks == block) & (indices == index)])
            scalars = found.setdefault(block, {})
            scalars[source.kind, index] = np.union1d(scalars.get((source.kind, index), read), read)
    return found


def _algebraic(model: Model, elements: Elements) -> list[set[int]]:
    """The definitions of each node that are variables; all of those that the compiler makes for sums over agents."""
    found: list[set[int]] = [set() for _ in model.nodes]
    for variable in model.variables:
        for source in variable.elements:
            if source.kind == "local":
                for block, index in elements.touched(source, variable.count):
                    found[block].add(index)
    for node, own in zip(model.nodes, found, strict=True):
        if not own and not node.states:
            own.update(range(len(node.definitions)))
    return found


def _continuous(node: Node, algebraic: Iterable[int]) -> tuple[Source, ...]:
    """The inputs of a node that its derivatives and algebraic variables use, in order of first use."""
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


def _blocks(held: Sequence[Sequence[int]], sources: Sequence[Iterable[int]]) -> list[list[int]]:
    """The nodes of each block, in execution order within one. `held`: the nodes of groups; `sources`: those that nodes read."""
    needs = [[other for other in read if other != node] for node, read in enumerate(sources)]
    for first, *others in held:
        for node in others:  # a group is one vertex: its first node, to which its others are tied
            needs[node].append(first)
            needs[first].append(node)
    part_of = {node: index for index, part in enumerate(components(needs)) for node in part}
    blocks: dict[int, list[int]] = {}
    for node in order(needs, lambda node: node):
        blocks.setdefault(part_of[node], []).append(node)
    return list(blocks.values())


class _Names:
    """Names of sources, as results have them: vectors that are read whole have one name, and elements are named together."""

    def __init__(self, model: Model, elements: Elements) -> None:
        self._model = model
        #: The path of a scalar's variable, and the scalar's own; all scalars of a variable in a node.
        self._paths: dict[tuple[int, Scalar], tuple[str, str]] = {}
        self._scalars: dict[tuple[int, str], set[Scalar]] = {}
        for variable in model.variables:
            if variable.access != "read":
                for source, name in zip(
                    variable.elements, element_names(variable.path, variable.shape), strict=True
                ):
                    for block, index in elements.touched(source, variable.count):
                        self._paths[block, (source.kind, index)] = variable.path, name
                        self._scalars.setdefault((block, variable.path), set()).add((source.kind, index))

    def of(self, owner: int, read: Mapping[Scalar, Integers]) -> tuple[str, ...]:
        """The names of scalars of one node, each once: states, each before its derivative, then algebraic variables."""
        ordered = sorted(read, key=lambda s: (s[0] == "local", s[1], s[0] == "rate"))
        return tuple(dict.fromkeys(self._name(owner, scalar, read) for scalar in ordered))

    def _name(self, owner: int, scalar: Scalar, read: Mapping[Scalar, Integers]) -> str:
        kind, index = scalar
        rate = kind == "rate"
        # A sum over agents is no variable: it is called what its node is.
        made = self._model.nodes[owner].path
        path, name = self._paths.get((owner, ("state", index) if rate else scalar), (made, made))
        whole = {("rate", k) if rate else (of, k) for of, k in self._scalars.get((owner, path), {scalar})}
        node = self._model.nodes[owner]
        indices = [taken(column, read[scalar] - node.first) for column in node.indices]
        return spelled(path if read.keys() >= whole else name, indices) + ("'" if rate else "")
