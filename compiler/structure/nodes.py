"""Nodes: the flat model as nodes whose expressions use their own indices.

In: a `Flat` model without loops. Out: a `LocalNode` for each flat node, in text order. Guaranteed: inputs are only scalars of other nodes that are
really used, numbered by first use, those of continuous equations first; parameters likewise; definitions that are not used are gone.
Nodes that say the same thing are equal but for path, sources, parameter indices and spans.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, added, column
from hierc.compiler.arrays.elements import Elements, slots_of
from hierc.compiler.expression import Expr, Gather, Input, Local, Parameter, Rate, State
from hierc.compiler.model import Definition, Node, Source, StateEquation, Variable
from hierc.compiler.shapes.terms import rewritten
from hierc.compiler.structure.flat import Flat, FlatVariable, leaves
from hierc.compiler.structure.instances import level_name
from hierc.compiler.structure.parameters import Tables
from hierc.grammar.source import Span

Kind = Literal["state", "rate", "local"]


@dataclass(frozen=True, slots=True)
class Scalar:
    """A scalar of a node, whichever of its elements it belongs to; `index` as in `Source`."""

    node: int  # id
    kind: Kind
    index: int


@dataclass(frozen=True, slots=True)
class LocalNode:
    """A node; its first `continuous` inputs are used by equations, the others by initial values only.

    `touched`: for each input the scalars that it is, several where the elements of an array read different ones.
    """

    node: Node
    continuous: int
    touched: tuple[tuple[Scalar, ...], ...]


@dataclass(frozen=True, slots=True)
class _Layout:
    """The flat indices of a node's states and definitions, in the node's own order; `shared` definitions serve its equations."""

    states: tuple[int, ...]
    definitions: tuple[int, ...]
    shared: int


class _Places:
    """Where scalars that others may read are: the elements that have them, and the index in their nodes."""

    def __init__(self, flat: Flat, layouts: Sequence[_Layout]) -> None:
        self._flat = flat
        counts = [node.instance.domain.count for node in flat.nodes]
        self.first = np.cumsum([0, *counts]).tolist()
        self._numbers = Elements(self.first[:-1])
        self._states = {g: (n, i) for n, layout in enumerate(layouts) for i, g in enumerate(layout.states)}
        self._definitions = {
            g: (n, i)
            for n, layout in enumerate(layouts)
            for i, g in enumerate(layout.definitions)
            if flat.definitions[g].owner == n
        }
        owned = [i for i, d in enumerate(flat.definitions) if d.owner is not None]
        self._state_table = _Table(
            [s.first for s in flat.states], [self._states[i] for i in range(len(flat.states))]
        )
        self._algebraic_table = _Table(
            [flat.definitions[i].first for i in owned], [self._definitions[i] for i in owned]
        )

    def source(self, leaf: State | Rate | Local | Gather) -> Source:
        """A scalar of the flat model as a source."""
        match leaf:
            case Gather(kind="state" | "rate" as kind, at=at):
                return Source(*self._found(self._state_table, at, kind))
            case Gather(at=at):
                return Source(*self._found(self._algebraic_table, at, "local"))
            case Local(index=index):
                node, place = self._definitions[index]
                return Source(self._elements(node), "local", place)
            case State(index=index) | Rate(index=index):
                node, place = self._states[index]
                return Source(self._elements(node), "state" if isinstance(leaf, State) else "rate", place)

    def touched(self, source: Source, count: int) -> tuple[Scalar, ...]:
        """The scalars that a source of `count` elements is."""
        pairs = self._numbers.touched(source, count)
        return tuple(Scalar(block, source.kind, index) for block, index in pairs)

    def _elements(self, node: int) -> Index:
        """All elements of a node."""
        first, count = self.first[node], self._flat.nodes[node].instance.domain.count
        return column(np.arange(first, first + count))

    def _found(self, table: _Table, at: Index, kind: Kind) -> tuple[Index, Kind, Index]:
        numbers = at.values if isinstance(at, Column) else np.array([at])
        slots = slots_of(table.firsts, numbers)
        if (slots == slots[0]).all():
            slot = int(slots[0])
            shift = self.first[int(table.nodes[slot])] - int(table.firsts[slot])
            return added(at, shift), kind, int(table.places[slot])
        elements = np.array(self.first)[table.nodes[slots]] + numbers - table.firsts[slots]
        return column(elements), kind, column(table.places[slots])


class _Table:
    """For numbered scalars: the number of each block's first, and the block and the index in it."""

    def __init__(self, firsts: Sequence[int], places: Sequence[tuple[int, int]]) -> None:
        self.firsts = np.array(firsts, np.int64)
        self.nodes = np.array([node for node, _ in places], np.int64)
        self.places = np.array([place for _, place in places], np.int64)


@dataclass(frozen=True, slots=True)
class Nodes:
    """The nodes in text order, and what results know by name, with the nodes' ids."""

    nodes: tuple[LocalNode, ...]
    variables: tuple[Variable, ...]


def make_nodes(flat: Flat, tables: Tables) -> Nodes:
    """The nodes of a flat model, with ids that are their places in it. What differs between elements goes to `tables`."""
    states, own = _by_node(flat)
    layouts = [_layout(flat, node, states[node], own[node]) for node in range(len(flat.nodes))]
    places = _Places(flat, layouts)
    nodes = tuple(_NodeMaker(flat, n, layout, places, tables).result() for n, layout in enumerate(layouts))
    return Nodes(nodes, tuple(_variable(v, places) for v in flat.variables if v.elements is not None))


def _variable(variable: FlatVariable, places: _Places) -> Variable:
    elements = tuple(places.source(leaf) for leaf in variable.elements or ())
    return Variable(
        variable.path, variable.shape, variable.unit, variable.doc, variable.access, elements, variable.span,
        variable.scale, variable.count, variable.indices,
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

    def __init__(self, flat: Flat, node: int, layout: _Layout, places: _Places, tables: Tables) -> None:
        self._flat = flat
        self._tables = tables
        self._node = node
        self._layout = layout
        self._places = places
        self._locals = {index: place for place, index in enumerate(layout.definitions)}
        self._inputs: dict[Source, int] = {}
        self._input_spans: list[Span] = []
        self._parameters: dict[Index, int] = {}

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
        domain = here.instance.domain
        node = Node(
            self._node, here.path, here.template, tuple(states), tuple(definitions),
            tuple(self._inputs), tuple(self._input_spans), tuple(self._parameters), here.span,
            self._places.first[self._node],
            levels=tuple(level_name(flat.instances, level) for level in here.levels),
            count=domain.count, indices=tuple(column(c) for c in domain.indices),
        )  # fmt: skip
        return LocalNode(node, continuous, tuple(self._places.touched(s, domain.count) for s in self._inputs))

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
                own = self._flat.states[leaf.index].node == self._node
                if own and isinstance(source.index, int):
                    return replace(leaf, index=source.index)
                return self._input(source, leaf.span)
            case Local(index=index):
                if index in self._locals:
                    return replace(leaf, index=self._locals[index])
                return self._input(self._places.source(leaf), leaf.span)
            case Gather(kind="parameter", at=at, span=span):
                return self._parameter(at, span)
            case Gather(kind="index", at=at, span=span):
                assert isinstance(at, Column)
                return self._parameter(self._tables.entries(at), span)
            case Gather():
                return self._input(self._places.source(leaf), leaf.span)
            case Parameter(span=span, index=index):
                return self._parameter(index, span)
            case _:
                return leaf

    def _parameter(self, at: Index, span: Span | None) -> Parameter:
        return Parameter(span, self._parameters.setdefault(at, len(self._parameters)))

    def _input(self, source: Source, span: Span | None) -> Input:
        place = self._inputs.setdefault(source, len(self._inputs))
        if place == len(self._input_spans):
            self._input_spans.append(span or self._flat.nodes[self._node].span)
        return Input(span, place)
