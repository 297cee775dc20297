"""Detours: a level that depends on a later one beside it by way of what stands elsewhere.

In: the nodes and what they read. Out: a `Detour` for each read that leaves a block, an agent or a level that has levels, and leads back into a later level
of it. A read of a later level inside the block is none: `proof.py` reports it as it stands.

Blocks are looked at together by how many of them stand around them: those of one depth are disjoint. A way out of a block and back lies in a cycle of the
graph in which each of them is one vertex, so where that graph has none, and it seldom has, there is nothing to search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hierc.compiler.cascade.graphs import components
from hierc.compiler.expression import Input, Local
from hierc.compiler.model import Node
from hierc.compiler.structure.flat import FlatNode, leaves
from hierc.compiler.structure.instances import Block, Standing
from hierc.compiler.structure.nodes import LocalNode, Scalar
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class Detour:
    """Node `reader`, in level number `level` of `block`, reads at `span` what depends on level number `later` of it, by way of the nodes `through`.

    The last of them reads the later level at `back`.
    """

    block: Block
    reader: int
    level: int
    later: int
    span: Span
    through: tuple[int, ...]
    back: Span


def reads(here: LocalNode) -> Iterator[tuple[int, Scalar, Span]]:
    """What the continuous equations of a node read: the input, the scalar, and where."""
    for k in range(here.continuous):
        for source in here.touched[k]:
            yield k, source, here.node.input_spans[k]


def continuous(here: LocalNode) -> list[tuple[Scalar, Span]]:
    """What the continuous equations of a node read, and where."""
    return [(source, span) for _, source, span in reads(here)]


def inputs_behind(node: Node, definition: int) -> list[int]:
    """The inputs that a definition of a node without states uses."""
    found: list[int] = []
    seen = {definition}
    waiting = [definition]
    while waiting:
        for leaf in leaves(node.definitions[waiting.pop()].value):
            if isinstance(leaf, Input):
                found.append(leaf.index)
            elif isinstance(leaf, Local) and leaf.index not in seen:
                seen.add(leaf.index)
                waiting.append(leaf.index)
    return found


def behind(here: LocalNode, source: Scalar) -> list[tuple[Scalar, Span]]:
    """What a definition of a node without states reads, and where."""
    inputs = inputs_behind(here.node, source.index)
    return [(read, here.node.input_spans[k]) for k in inputs for read in here.touched[k]]


def detours(flat_nodes: Sequence[FlatNode], nodes: Sequence[LocalNode]) -> Iterator[Detour]:
    """All detours, one for each node and place where it reads.

    In an array of agents with levels, a way from one element's level to another's later one is none, and what leads back to the same element is not
    told from it here: groups that need each other are reported in any case.
    """
    for depth in range(max((len(node.levels) for node in flat_nodes), default=0)):
        around = [node.levels[depth] if len(node.levels) > depth else None for node in flat_nodes]
        for part in _cycles(around, nodes):
            search = _Search(around, nodes, part)
            for here in sorted(part):
                yield from search.from_node(here)


def _cycles(around: Sequence[Standing | None], nodes: Sequence[LocalNode]) -> Iterator[set[int]]:
    """The nodes of each cycle, where all nodes of a block count as one vertex."""
    vertices: dict[int | Block, int] = {}
    keys = [n if inside is None else inside[0] for n, inside in enumerate(around)]
    vertex = [vertices.setdefault(key, len(vertices)) for key in keys]
    reads: list[set[int]] = [set() for _ in vertices]
    for n, here in enumerate(nodes):
        reads[vertex[n]] |= {vertex[source.node] for source, _ in continuous(here)}
    members: list[list[int]] = [[] for _ in vertices]
    for n, v in enumerate(vertex):
        members[v].append(n)
    for part in components([sorted(r) for r in reads]):
        if len(part) > 1:
            yield {n for v in part for n in members[v]}


class _Search:
    """Follows what nodes read, inside one cycle."""

    def __init__(self, around: Sequence[Standing | None], nodes: Sequence[LocalNode], part: set[int]) -> None:
        self._around = around
        self._nodes = nodes
        self._part = part

    def from_node(self, here: int) -> Iterator[Detour]:
        """The detours that begin with a read of this node."""
        inside = self._around[here]
        if inside is None or self._nodes[here].node.count > 1:
            return
        block, level = inside
        for source, span in continuous(self._nodes[here]):
            if source.node in self._part and not self._is_in(source.node, block):
                found = self._back(source, block, level)
                if found is not None:
                    through, later, back = found
                    yield Detour(block, here, level, later, span, through, back)

    def _is_in(self, node: int, block: Block) -> bool:
        inside = self._around[node]
        return inside is not None and inside[0] == block

    def _back(self, start: Scalar, block: Block, level: int) -> tuple[tuple[int, ...], int, Span] | None:
        """A shortest way from `start` outside to a level of `block` later than `level`: the nodes on it, that level, the last read."""
        came_from: dict[tuple[int, int | None], Scalar | None] = {self._key(start): None}
        waiting = [start]
        for at in waiting:  # grows while it is read
            for source, span in self._reads(at):
                inside = self._around[source.node]
                if inside is not None and inside[0] == block:
                    if inside[1] > level:
                        return self._way(at, came_from), inside[1], span
                elif source.node in self._part and self._key(source) not in came_from:
                    came_from[self._key(source)] = at
                    waiting.append(source)
        return None

    def _reads(self, at: Scalar) -> list[tuple[Scalar, Span]]:
        here = self._nodes[at.node]
        return continuous(here) if here.node.states else behind(here, at)

    def _key(self, source: Scalar) -> tuple[int, int | None]:
        """A node with states is one thing: they depend on all that it reads."""
        return source.node, None if self._nodes[source.node].node.states else source.index

    def _way(self, last: Scalar, came_from: dict[tuple[int, int | None], Scalar | None]) -> tuple[int, ...]:
        way: list[int] = []
        at: Scalar | None = last
        while at is not None:
            way.append(at.node)
            at = came_from[self._key(at)]
        return tuple(reversed(way))
