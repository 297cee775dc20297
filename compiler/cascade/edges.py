"""The graph of what reads what, element by element, on whole columns.

In: nodes, and a label for each of their elements: elements with one label are one vertex. Out: edges between labels. What elements without states and
label compute is a vertex of its own, one for each definition that others read, so that a way through such an element leads only to what that definition
uses.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from hierc.compiler.arrays.columns import Integers, expanded
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.cascade.detours import inputs_behind
from hierc.compiler.model import Source
from hierc.compiler.structure.nodes import LocalNode
from hierc.grammar.source import Span


@dataclass(frozen=True)
class Edges:
    """`reads[k]` reads `read[k]` at `spans[at[k]]`. Vertices below `labels` are labels, those from there on definitions without states.

    `definitions`: for each definition (block, index) without states that is read, the vertex of its first element.
    """

    labels: int
    vertices: int
    reads: Integers
    read: Integers
    at: Integers
    spans: tuple[Span, ...]
    definitions: Mapping[tuple[int, int], int]

    @cached_property
    def parts(self) -> Integers:
        """The strongly connected part that each vertex belongs to."""
        shape = (self.vertices, self.vertices)
        ones = np.ones(len(self.reads), np.int8)
        graph = csr_array((ones, (self.reads, self.read)), shape=shape)
        _, parts = connected_components(graph, directed=True, connection="strong")
        return np.asarray(parts, np.int64)

    def closed(self) -> list[Integers]:
        """The labels that need each other: one array for each part that has two or more."""
        parts = self.parts[: self.labels]
        order = np.argsort(parts, kind="stable")
        _, starts, counts = np.unique(parts[order], return_index=True, return_counts=True)
        several = counts > 1
        ends = starts + counts
        return [np.sort(order[s:e]) for s, e in zip(starts[several], ends[several], strict=True)]

    def shortest_cycle(self, labels: Integers) -> list[tuple[int, Span]]:
        """A shortest closed path through the first of some labels that need each other: labels, with the places where each reads the next."""
        start = int(labels[0])
        inside = self.parts == self.parts[start]
        kept = np.flatnonzero(inside[self.reads] & inside[self.read] & (self.reads != self.read))
        onward: dict[int, list[tuple[int, int]]] = {}
        for k in kept.tolist():
            onward.setdefault(int(self.reads[k]), []).append((int(self.read[k]), int(self.at[k])))
        came_from: dict[int, tuple[int, int]] = {}
        queue = deque([start])
        while start not in came_from:
            here = queue.popleft()
            for other, at in onward.get(here, ()):
                if other not in came_from:
                    came_from[other] = (here, at)
                    queue.append(other)
        path: list[tuple[int, Span]] = []
        here = start
        while not path or here != start:
            here, at = came_from[here]
            path.append((here, self.spans[at]))
        return [(vertex, span) for vertex, span in reversed(path) if vertex < self.labels]


def element_edges(nodes: Sequence[LocalNode], labels: Integers, count: int) -> Edges:
    """The edges between labels. `labels`: for each element by its number, -1 for those that have none; `count`: how many labels there are.

    Elements with states must have one.
    """
    return _Builder(nodes, labels, count).result()


class _Builder:
    """Collects edges, node by node."""

    def __init__(self, nodes: Sequence[LocalNode], labels: Integers, count: int) -> None:
        self._nodes = nodes
        self._labels = labels
        self._count = count
        self._vertices = count
        self._elements = Elements(here.node.first for here in nodes)
        self._stateless = np.array([not here.node.states for here in nodes], np.bool_)
        self._definitions: dict[tuple[int, int], int] = {}
        self._waiting: list[tuple[int, int]] = []
        self._edges: list[tuple[Integers, Integers, int]] = []
        self._spans: list[Span] = []

    def result(self) -> Edges:
        for here in self._nodes:
            if here.node.states:
                node = here.node
                own = self._labels[node.first : node.first + node.count]
                for k in range(here.continuous):
                    self._add(own, node.inputs[k], node.input_spans[k], node.count)
        while self._waiting:
            block, definition = self._waiting.pop()
            here = self._nodes[block]
            own = self._own(block, definition)
            for k in inputs_behind(here.node, definition):
                self._add(own, here.node.inputs[k], here.node.input_spans[k], here.node.count)
        none = np.zeros(0, np.int64)
        reads = np.concatenate([e[0] for e in self._edges]) if self._edges else none
        read = np.concatenate([e[1] for e in self._edges]) if self._edges else none
        at = np.concatenate([np.full(len(e[0]), e[2]) for e in self._edges]) if self._edges else none
        return Edges(self._count, self._vertices, reads, read, at, tuple(self._spans), self._definitions)

    def _add(self, own: Integers, source: Source, span: Span, count: int) -> None:
        self._edges.append((own, self._targets(source, count), len(self._spans)))
        self._spans.append(span)

    def _targets(self, source: Source, count: int) -> Integers:
        """The vertex that each of `count` elements reads."""
        elements = expanded(source.node, count)
        targets = self._labels[elements]
        blocks = self._elements.blocks(elements)
        stateless = np.flatnonzero(self._stateless[blocks])
        if len(stateless):
            targets = targets.copy()
            indices = expanded(source.index, count)
            for block, index in {(int(blocks[k]), int(indices[k])) for k in stateless.tolist()}:
                mask = (blocks == block) & (indices == index)
                self._add_definition(block, index)
                targets[mask] = self._own(block, index)[elements[mask] - self._nodes[block].node.first]
        return targets

    def _own(self, block: int, index: int) -> Integers:
        """The vertices of a definition of a block without states: its elements' labels, or vertices of its own."""
        node = self._nodes[block].node
        labels = self._labels[node.first : node.first + node.count]
        return np.where(labels >= 0, labels, self._definitions[block, index] + np.arange(node.count))

    def _add_definition(self, block: int, index: int) -> None:
        """Note that a definition of a block without states is read."""
        key = (block, index)
        if key not in self._definitions:
            self._definitions[key] = self._vertices
            self._vertices += self._nodes[block].node.count
            self._waiting.append(key)
