"""Laying out the flat model: which scalars there are and which node each belongs to. Part of the phase `flatten.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Literal

import numpy as np

from hierc.compiler.arrays.columns import Index, Integers, column
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.expression import Expr, Gather, Local, Number, Rate, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.errors import AnalogNotReal
from hierc.compiler.shapes.evaluate import declared_shape
from hierc.compiler.shapes.values import Shape, Value, element_names
from hierc.compiler.structure.flat import FlatDefinition, FlatNode
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.parameters import Parameters, Tables
from hierc.grammar.source import Span

#: What of other elements an expression may name, as `Gather` has it.
Kind = Literal["state", "rate", "algebraic"]


@dataclass(frozen=True, slots=True)
class StateSlot:
    """A scalar state of a block without its equation; `first` is the number of its first element's."""

    node: int
    name: str
    span: Span
    first: int


@dataclass(frozen=True, slots=True)
class Storage:
    """The scalars of a model. `indices` gives those of a variable in `states` or `algebraic`, for each instance by name.

    Each stands for one scalar of all elements of a block. These are numbered through, for states and for algebraic variables, block by block.
    """

    nodes: tuple[FlatNode, ...]
    states: tuple[StateSlot, ...]
    algebraic: tuple[FlatDefinition, ...]  # still without values
    shapes: tuple[Mapping[str, Shape], ...]
    indices: tuple[Mapping[str, tuple[int, ...]], ...]

    def value(self, instance: Instance, name: str, span: Span) -> Value:
        """A `write` or `private` variable as a value, with `span` as its place. Raises Rejected if it was refused."""
        indices = self.indices[instance.id].get(name)
        if indices is None:
            raise Rejected
        is_state = instance.agent.variables[name].declarator.initial is not None
        elements: tuple[Expr, ...] = tuple(State(span, i) if is_state else Local(span, i) for i in indices)
        return Value("real", self.shapes[instance.id][name], elements)

    def gathered(self, leaf: Expr) -> Expr:
        """A variable of elements themselves, or of a single agent, by its numbers; any other expression as it is."""
        match leaf:
            case State(index=slot):
                state = self.states[slot]
                return Gather(leaf.span, "state", self._numbers(state.first, state.node))
            case Rate(index=slot):
                state = self.states[slot]
                return Gather(leaf.span, "rate", self._numbers(state.first, state.node))
            case Local(index=index) if index < len(self.algebraic):
                here = self.algebraic[index]
                return (
                    leaf
                    if here.owner is None
                    else Gather(leaf.span, "algebraic", self._numbers(here.first, here.owner))
                )
            case _:
                return leaf

    def _numbers(self, first: int, node: int) -> Index:
        return column(np.arange(first, first + self.nodes[node].instance.domain.count))

    def numbers(self, instance: Instance, name: str) -> list[Integers]:
        """For each scalar of a variable, the numbers of the elements' own. Raises Rejected if the variable was refused."""
        indices = self.indices[instance.id].get(name)
        if indices is None:
            raise Rejected
        is_state = instance.agent.variables[name].declarator.initial is not None
        firsts = [self.states[i].first if is_state else self.algebraic[i].first for i in indices]
        return [np.arange(first, first + instance.domain.count) for first in firsts]


@dataclass(frozen=True, slots=True)
class StoredGathering:
    """See `evaluate.Gathering`."""

    storage: Storage
    tables: Tables

    def leaf(self, expr: Expr) -> Expr:
        """See `evaluate.Gathering`."""
        return self.tables.leaf(self.storage.gathered(expr))

    def table(self, numbers: tuple[float, ...]) -> int:
        """See `evaluate.Gathering`."""
        return self.tables.table(numbers)


def allocate(
    file: Environment, instances: Sequence[Instance], parameters: Parameters, problems: Collector
) -> Storage:
    """Give every scalar of every variable its place, and every variable its node."""
    nodes = sorted(
        (node for instance in instances for node in _nodes_of(instance)), key=lambda node: node.place
    )
    places = {(node.instance.id, node.level): index for index, node in enumerate(nodes)}
    states: list[StateSlot] = []
    algebraic: list[FlatDefinition] = []
    numbers = {"state": 0, "algebraic": 0}
    shapes: list[dict[str, Shape]] = [{} for _ in instances]
    indices: list[dict[str, tuple[int, ...]]] = [{} for _ in instances]
    for instance in instances:
        env = replace(file, scope=parameters.by_instance[instance.id])
        for name, variable in instance.agent.variables.items():
            try:
                shape = _shape(variable, env)
            except Rejected as rejection:
                problems.rejected(rejection)
                continue
            shapes[instance.id][name] = shape
            if variable.decl.access == "read":
                continue
            node = places[instance.id, variable.level]
            names = element_names(name, shape)
            if variable.declarator.initial is not None:
                first, kind = len(states), "state"
                numbered = [numbers[kind] + k * instance.domain.count for k in range(len(names))]
                states += [StateSlot(node, n, variable.span, k) for n, k in zip(names, numbered, strict=True)]
            else:
                first, kind = len(algebraic), "algebraic"
                numbered = [numbers[kind] + k * instance.domain.count for k in range(len(names))]
                algebraic += [
                    _undefined(instance, n, variable, node, k) for n, k in zip(names, numbered, strict=True)
                ]
            numbers[kind] += len(names) * instance.domain.count
            indices[instance.id][name] = tuple(range(first, first + len(names)))
    return Storage(tuple(nodes), tuple(states), tuple(algebraic), tuple(shapes), tuple(indices))


def _undefined(instance: Instance, name: str, variable: Variable, node: int, first: int) -> FlatDefinition:
    path = instance.named(name)
    return FlatDefinition(
        name, path, Number(None, 0.0), variable.span, node, hidden=False, domain=instance.domain, first=first
    )


def _shape(variable: Variable, env: Environment) -> Shape:
    if variable.decl.type.scalar != "real":
        raise Rejected(AnalogNotReal(variable.span, name=variable.name, type=variable.decl.type.scalar))
    return declared_shape(variable.decl.type, env)


def _nodes_of(instance: Instance) -> list[FlatNode]:
    """The nodes of an agent: itself and each of its levels, where they have variables of their own."""
    used = {v.level for v in instance.agent.variables.values() if v.decl.access != "read"}
    return [_node(instance, level) for level in (None, *instance.agent.levels) if level in used]


def _node(instance: Instance, level: str | None) -> FlatNode:
    """The node of what stands in `level` of an agent. Where there are levels beside it, it observes them and comes last."""
    agent = instance.agent
    observer = level in agent.divided()
    last = (inf if observer else -inf, 0)
    if level is None:
        path, template, span, place = (
            instance.path,
            agent.name,
            agent.definition.name.span,
            (*instance.place, last),
        )
    else:
        around = agent.levels[level]
        path, template, span = instance.named(level), f"{agent.name}.{level}", around.span
        place = instance.place_in(level, around.level.span.start)
        place = (*place, last) if observer else place
    return FlatNode(instance, level, observer, path, template, span, instance.standing(level), place)
