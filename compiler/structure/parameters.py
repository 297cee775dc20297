"""Parameters: the parameter vector of a model, and what parameters, constants and `let`s of them are in each agent.

In: instances, the values an experiment gives and those given from outside. Out: `Parameters`. Guaranteed: every parameter stands after those its
value is made of; structural ones are literals; values have the declared types and shapes.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from hierc.compiler import expression, model
from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.resolve.constants import ByName, agent_constants, literal, measured
from hierc.compiler.resolve.outside import Given, outside_value
from hierc.compiler.resolve.structural import structural_parameters
from hierc.compiler.shapes.evaluate import Environment, Values, declared_shape, evaluate, expected
from hierc.compiler.shapes.values import Value, size_of
from hierc.compiler.structure.instances import Instance
from hierc.compiler.units.units import scale_of
from hierc.grammar import tree

#: Parameters that an experiment gives, by instance and name.
Arguments = Mapping[tuple[int, str], tree.Expr]


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameter vector, and for each instance the values of its parameters, constants and `let`s of parameters."""

    entries: tuple[model.Parameter, ...]
    count: int
    by_instance: tuple[Values, ...]


def make_parameters(
    context: Context, instances: Sequence[Instance], arguments: Arguments, given: Given
) -> Parameters:
    """Lay out the parameter vector. `given` holds values from outside by path; only those of structural parameters count here."""
    builder = _Builder(context, arguments, given)
    for instance in instances:
        builder.add(instance)
    return Parameters(tuple(builder.entries), builder.count, tuple(builder.by_instance))


class _Builder:
    """Adds instances one after the other, each after its parent."""

    def __init__(self, context: Context, arguments: Arguments, given: Given) -> None:
        self._context = context
        self._file = context.environment()
        self._names = context.names
        self._problems = context.problems
        self._structural = structural_parameters(context.library)
        self._arguments = arguments
        self._given = given
        self._consts: dict[str, ByName] = {}
        self.entries: list[model.Parameter] = []
        self.count = 0
        self.by_instance: list[Values] = []

    def add(self, instance: Instance) -> None:
        """Evaluate the parameters, then the `let`s made of them."""
        own: dict[str, Value] = {}
        consts = self._constants_of(instance)
        refused: dict[str, Rejected] = {}
        scope = Values(ChainMap(own, consts, self._context.constants), refused)
        env = replace(self._file, scope=scope)
        for name, param in instance.agent.params.items():
            try:
                own[name] = self._parameter(instance, param, env)
            except Rejected as rejection:
                self._problems.rejected(rejection)
        for name in self._names.lets[instance.agent.name]:
            if name in self._names.parameter_lets[instance.agent.name]:
                try:
                    value = evaluate(instance.agent.lets[name].let.value, env)
                    own[name] = replace(value, elements=tuple(measured(e) for e in value.elements))
                except Rejected as rejection:
                    refused[name] = rejection  # equations can share parts of it, and may still use it
        self.by_instance.append(scope)

    def _constants_of(self, instance: Instance) -> ByName:
        agent = instance.agent
        if agent.name not in self._consts:
            context = self._context
            self._consts[agent.name] = agent_constants(
                context.library,
                agent,
                self._names.agent_consts[agent.name],
                context.constants,
                context.budget,
                self._problems,
            )
        return self._consts[agent.name]

    def _parameter(self, instance: Instance, param: tree.Param, env: Environment) -> Value:
        name = param.name.text
        path = instance.named(name)
        unit = param.unit.text if param.unit else None
        scale = scale_of(param.unit)
        shape = declared_shape(param.type, env)
        structural = name in self._structural[instance.agent.name]
        if structural and path in self._given:
            value = outside_value(path, self._given[path], param.type.scalar, shape, scale)
        else:
            value = self._declared_value(instance, param, shape, env)
        if structural:
            value = literal(value, f"structural parameter `{name}`", param)
        first = self.count
        self.count += size_of(shape)
        self.entries.append(
            model.Parameter(
                path,
                param.type.scalar,
                shape,
                unit,
                "",
                first,
                value.elements,
                structural,
                param.name.span,
                scale,
            )
        )
        if structural:
            return value
        elements = tuple(expression.Parameter(None, first + i) for i in range(size_of(shape)))
        return Value(param.type.scalar, shape, elements)

    def _declared_value(
        self, instance: Instance, param: tree.Param, shape: tuple[int, ...], own: Environment
    ) -> Value:
        """What the experiment, the argument or the default says."""
        name = param.name.text
        expr, env = self._arguments.get((instance.id, name)), self._file
        if expr is None and instance.instance is not None and instance.parent is not None:
            expr = next((arg.value for arg in instance.instance.args if arg.name.text == name), None)
            env = replace(self._file, scope=self.by_instance[instance.parent])
        if expr is None:
            expr, env = param.default, own
        if expr is None:
            raise Rejected  # reported where the argument is missing
        value = expected(evaluate(expr, env), param.type.scalar, shape, f"parameter `{name}`", expr)
        return replace(value, elements=tuple(measured(e) for e in value.elements))
