"""Laying out the flat model: which scalars there are and which node each belongs to. Part of the phase `flatten.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.expression import Expr, Local, Number, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.errors import AnalogNotReal
from hierc.compiler.shapes.evaluate import Environment, declared_shape
from hierc.compiler.shapes.values import Shape, Value, element_names
from hierc.compiler.structure.flat import FlatDefinition, FlatNode
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.parameters import Parameters
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class StateSlot:
    """A scalar state without its equation."""

    node: int
    name: str
    span: Span


@dataclass(frozen=True, slots=True)
class Storage:
    """The scalars of a model. `indices` gives those of a variable in `states` or `algebraic`, for each instance by name."""

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
                first = len(states)
                states += [StateSlot(node, n, variable.span) for n in names]
            else:
                first = len(algebraic)
                algebraic += [_undefined(instance, n, variable, node) for n in names]
            indices[instance.id][name] = tuple(range(first, first + len(names)))
    return Storage(tuple(nodes), tuple(states), tuple(algebraic), tuple(shapes), tuple(indices))


def _undefined(instance: Instance, name: str, variable: Variable, node: int) -> FlatDefinition:
    return FlatDefinition(name, instance.named(name), Number(None, 0.0), variable.span, node, hidden=False)


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
