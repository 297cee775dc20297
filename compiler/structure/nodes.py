"""Nodes: the flat model as nodes whose expressions use their own indices.

In: a `Flat` model without loops. Out: a `LocalNode` for each flat node, in text order. Guaranteed: inputs are only scalars of other nodes that are
really used, numbered by first use, those of continuous equations first; parameters likewise; definitions that are not used are gone.
Nodes that say the same thing are equal but for path, sources, parameter indices and spans.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from hierc.compiler.expression import Expr, Input, Local, Parameter, Rate, State
from hierc.compiler.model import Definition, Node, Source, StateEquation, Variable
from hierc.compiler.shapes.terms import rewritten
from hierc.compiler.structure.flat import Flat, FlatVariable, leaves
from hierc.compiler.structure.instances import level_name
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class LocalNode:
    """A node; its first `continuous` inputs are used by equations, the others by initial values only."""

    node: Node
    continuous: int


@dataclass(frozen=True, slots=True)
class _Layout:
    """The flat indices of a node's states and definitions, in the node's own order; `shared` definitions serve its equations."""

    states: tuple[int, ...]
    definitions: tuple[int, ...]
    shared: int


@dataclass(frozen=True, slots=True)
class _Places:
    """Where scalars that others may read are: (node, index in it)."""

    states: Mapping[int, tuple[int, int]]
    definitions: Mapping[int, tuple[int, int]]

    def source(self, leaf: State | Rate | Local) -> Source:
        """A scalar of the flat model as a source."""
        if isinstance(leaf, Local):
            node, index = self.definitions[leaf.index]
            return Source(node, "local", index)
        node, index = self.states[leaf.index]
        return Source(node, "state" if isinstance(leaf, State) else "rate", index)


@dataclass(frozen=True, slots=True)
class Nodes:
    """The nodes in text order, and what results know by name, with the nodes' ids."""

    nodes: tuple[LocalNode, ...]
    variables: tuple[Variable, ...]


def make_nodes(flat: Flat) -> Nodes:
    """The nodes of a flat model, with ids that are their places in it."""
    states, own = _by_node(flat)
    layouts = [_layout(flat, node, states[node], own[node]) for node in range(len(flat.nodes))]
    state_places = {g: (n, i) for n, layout in enumerate(layouts) for i, g in enumerate(layout.states)}
    definition_places = {
        g: (n, i)
        for n, layout in enumerate(layouts)
        for i, g in enumerate(layout.definitions)
        if flat.definitions[g].owner == n
    }
    places = _Places(state_places, definition_places)
    nodes = tuple(_NodeMaker(flat, n, layout, places).result() for n, layout in enumerate(layouts))
    return Nodes(nodes, tuple(_variable(v, places) for v in flat.variables if v.elements is not None))


def _variable(variable: FlatVariable, places: _Places) -> Variable:
    elements = tuple(places.source(leaf) for leaf in variable.elements or ())
    return Variable(
        variable.path, variable.shape, variable.unit, variable.doc, variable.access, elements, variable.span,
        variable.scale,
    )  # fmt: skip


def _by_node(flat: Flat) -> tuple[list[list[int]], list[list[int]]]:
    """The states and the algebraic variables of each node."""
    states: list[list[int]] = [[] for _ in flat.nodes]
    own: list[list[int]] = [[] for _ in flat.nodes]
    for index, state in enumerate(flat.states):
        states[state.node].append(index)
    for index, definition in enumerate(flat.definitions):
        if definition.owner is not None:
            own[definition.owner].append(index)
    return states, own


def _layout(flat: Flat, node: int, states: Sequence[int], own: Sequence[int]) -> _Layout:
    order: dict[int, None] = {}
    _require(flat, node, own, order)
    _require(flat, node, _locals(flat.states[s].rate for s in states), order)
    shared = len(order)
    _require(flat, node, _locals(flat.states[s].initial for s in states), order)
    return _Layout(tuple(states), tuple(order), shared)


def _locals(exprs: Iterable[Expr]) -> list[int]:
    return [leaf.index for expr in exprs for leaf in leaves(expr) if isinstance(leaf, Local)]


def _require(flat: Flat, node: int, wanted: Iterable[int], order: dict[int, None]) -> None:
    """Add definitions to `order`, each after those of the node that it uses."""
    stack = [(index, False) for index in reversed(list(wanted))]
    while stack:
        index, ready = stack.pop()
        definition = flat.definitions[index]
        if index in order or (definition.owner != node and not flat.copied(definition)):
            continue
        if ready:
            order[index] = None
        else:
            stack.append((index, True))
            stack.extend((used, False) for used in reversed(_locals([definition.value])) if used not in order)


class _NodeMaker:
    """Rewrites the expressions of one node, numbering inputs and parameters as they turn up."""

    def __init__(self, flat: Flat, node: int, layout: _Layout, places: _Places) -> None:
        self._flat = flat
        self._node = node
        self._layout = layout
        self._places = places
        self._locals = {index: place for place, index in enumerate(layout.definitions)}
        self._inputs: dict[Source, int] = {}
        self._input_spans: list[Span] = []
        self._parameters: dict[int, int] = {}

    def result(self) -> LocalNode:
        flat, layout = self._flat, self._layout
        here = flat.nodes[self._node]
        definitions = self._definitions(layout.definitions[: layout.shared])
        rates = [self._own(flat.states[s].rate) for s in layout.states]
        continuous = len(self._inputs)
        definitions += self._definitions(layout.definitions[layout.shared :])
        states: list[StateEquation] = []
        for index, rate in zip(layout.states, rates, strict=True):
            s = flat.states[index]
            states.append(
                StateEquation(s.name, rate, self._own(s.initial), self._own(s.nominal), s.span, s.rate_span)
            )
        node = Node(
            self._node, here.path, here.template, tuple(states), tuple(definitions),
            tuple(self._inputs), tuple(self._input_spans), tuple(self._parameters), here.span, self._node,
            levels=tuple(level_name(flat.instances, level) for level in here.levels),
        )  # fmt: skip
        return LocalNode(node, continuous)

    def _definitions(self, indices: Sequence[int]) -> list[Definition]:
        made: list[Definition] = []
        for index in indices:
            definition = self._flat.definitions[index]
            name = f"{definition.name} #{self._locals[index] + 1}" if definition.hidden else definition.name
            made.append(Definition(name, self._own(definition.value), definition.span))
        return made

    def _own(self, expr: Expr) -> Expr:
        return rewritten(expr, self._leaf)

    def _leaf(self, leaf: Expr) -> Expr:
        match leaf:
            case State() | Rate():
                source = self._places.source(leaf)
                if source.node == self._node:
                    return replace(leaf, index=source.index)
                return self._input(source, leaf.span)
            case Local(index=index):
                if index in self._locals:
                    return replace(leaf, index=self._locals[index])
                return self._input(self._places.source(leaf), leaf.span)
            case Parameter(span=span, index=index):
                return Parameter(span, self._parameters.setdefault(index, len(self._parameters)))
            case _:
                return leaf

    def _input(self, source: Source, span: Span | None) -> Input:
        place = self._inputs.setdefault(source, len(self._inputs))
        if place == len(self._input_spans):
            self._input_spans.append(span or self._flat.nodes[self._node].span)
        return Input(span, place)
