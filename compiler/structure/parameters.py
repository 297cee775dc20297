"""Parameters: the parameter vector of a model, and what parameters, constants and `let`s of them are in each agent.

In: instances, the values an experiment gives and those given from outside. Out: `Parameters`. Guaranteed: every parameter stands after those its
value is made of, those of single agents before those of arrays; structural ones are literals; values have the declared types and shapes.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hierc.compiler import expression, model
from hierc.compiler.arrays.columns import Column, Integers, column, taken
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.arrays.elements import plain
from hierc.compiler.arrays.errors import StructuralElement
from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.expression import Choose, Expr, Gather
from hierc.compiler.resolve.constants import ByName, agent_constants, literal, measured
from hierc.compiler.resolve.outside import Given, outside_value
from hierc.compiler.resolve.structural import structural_parameters
from hierc.compiler.shapes.environment import Chosen, Environment, NoAgents, Scope, Values
from hierc.compiler.shapes.evaluate import declared_shape, evaluate, expected
from hierc.compiler.shapes.terms import rewritten
from hierc.compiler.shapes.values import Shape, Value, index_value, scalar_of, size_of
from hierc.compiler.structure.each import given, indices_around, is_for_each
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.paths import Gift, in_order
from hierc.compiler.units.units import scale_of
from hierc.grammar import tree

#: Parameters that an experiment gives, by agent of the outline and name.
Arguments = Mapping[tuple[int, str], tuple[Gift, ...]]


class Tables:
    """The parameter vector while it grows: the first entry that is free, and numbers that differ from element to element and never change."""

    def __init__(self) -> None:
        self.count = 0
        self._constants: dict[Column | tuple[float, ...], int] = {}

    def reserve(self, count: int) -> int:
        """The first of `count` new entries."""
        first = self.count
        self.count += count
        return first

    def entries(self, integers: Column) -> Column:
        """The entries that hold some integers."""
        first = self._first(integers)
        return Column(np.arange(first, first + len(integers)))

    def table(self, numbers: tuple[float, ...]) -> int:
        """The first of the entries that hold some numbers."""
        return self._first(numbers)

    def _first(self, numbers: Column | tuple[float, ...]) -> int:
        if numbers not in self._constants:
            self._constants[numbers] = self.reserve(len(numbers))
        return self._constants[numbers]

    def constants(self) -> tuple[model.Constants, ...]:
        """All such numbers."""
        return tuple(model.Constants(first, numbers) for numbers, first in self._constants.items())

    def leaf(self, expr: Expr) -> Expr:
        """A parameter as what an element gathers; see `evaluate.Gathering`."""
        return Gather(expr.span, "parameter", expr.index) if isinstance(expr, expression.Parameter) else expr


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameter vector, and for each instance the values of its parameters, constants and `let`s of parameters."""

    entries: tuple[model.Parameter, ...]
    tables: Tables
    by_instance: tuple[Values, ...]


@dataclass(frozen=True, slots=True)
class Brought(NoAgents):
    """The parameters of an agent, as the elements of an array inside it use them; `places`: where these stand in the agent's own domain."""

    scope: Scope
    places: Integers

    def lookup(self, ref: tree.Ref, chosen: Chosen | None = None) -> Value:
        """See `evaluate.Scope`."""
        value = self.scope.lookup(ref, chosen)
        return replace(value, elements=tuple(brought(e, self.places) for e in value.elements))


def brought(expr: Expr, places: Integers) -> Expr:
    """An expression of parameters and indices, as elements at some places have it."""
    return rewritten(expr, lambda leaf: moved(leaf, places) if isinstance(leaf, Gather) else leaf)


def moved(leaf: Gather, places: Integers) -> Expr:
    """What elements gather, as others at some places among them have it."""
    at = taken(leaf.at, places)
    return index_value(at, leaf.span) if leaf.kind == "index" else replace(leaf, at=at)


class ParameterBuilder:
    """Adds instances one after the other, each after its parent. `given` holds values from outside by path; only those of structural
    parameters count here.
    """

    def __init__(self, context: Context, arguments: Arguments, given: Given) -> None:
        self._context = context
        self._file = context.environment()
        self._names = context.names
        self._problems = context.problems
        self._structural = structural_parameters(context.library)
        self._arguments = arguments
        self._given = given
        self._consts: dict[str, ByName] = {}
        self._entries: list[model.Parameter] = []
        self._by_instance: list[Values] = []
        self._tables = Tables()
        self._instances: list[Instance] = []

    def result(self) -> Parameters:
        """The parameters of all instances added."""
        entries = sorted(self._entries, key=lambda entry: bool(entry.indices))
        return Parameters(tuple(entries), self._tables, tuple(self._by_instance))

    def structural(self, agent: str) -> frozenset[str]:
        """The structural parameters of an agent definition."""
        return self._structural.get(agent, frozenset())

    def environment(self, instance: int, domain: Domain, over: tree.Over | None = None) -> Environment:
        """What an agent's elements see of its parameters; with `over`, what those of an array inside it see of them and of their index."""
        scope: Scope = self._by_instance[instance]
        if over is not None and domain.outer is not None and domain.outer.count > 1:
            scope = Brought(scope, domain.places)
        env = replace(self._file, scope=scope, gathering=self._tables if domain.count > 1 else None)
        return env if over is None else env.bind(over.index.text, index_of_elements(domain))

    def add(self, instance: Instance) -> None:
        """Evaluate the parameters, then the `let`s made of them."""
        self._instances.append(instance)
        own: dict[str, Value] = {}
        consts = self._constants_of(instance)
        refused: dict[str, Rejected] = {}
        scope = Values(ChainMap(own, consts, self._context.constants), refused)
        gathering = self._tables if instance.domain.count > 1 else None
        env = replace(self._file, scope=scope, gathering=gathering)
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
        self._by_instance.append(scope)

    def _own(self, instance: Instance) -> Environment:
        """What the agents in an agent see of its parameters where these are the same for all elements: sizes."""
        return replace(self._file, scope=self._by_instance[instance.id])

    def _outside(self) -> Environment:
        """What an experiment sees: the parameters of the agent that runs. It gives different things to elements of arrays."""
        return replace(self._own(self._instances[0]), gathering=self._tables)

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
        whole = plain(path)
        if structural and whole in self._given:
            value = outside_value(whole, self._given[whole], param.type.scalar, shape, scale)
        else:
            value = self._declared_value(instance, param, shape, env)
        if structural:
            value = literal(value, f"structural parameter `{name}`", param)
        domain, size = instance.domain, size_of(shape)
        first = self._tables.reserve(size * domain.count)
        values = tuple(rewritten(e, self._entry) for e in value.elements)
        indices = tuple(column(c) for c in domain.indices)
        self._entries.append(
            model.Parameter(
                path, param.type.scalar, shape, unit, "", first, values, structural, param.name.span, scale,
                domain.count, indices,
            )
        )  # fmt: skip
        if structural:
            return value
        return Value(
            param.type.scalar, shape, tuple(_own(first + i, size, domain.count) for i in range(size))
        )

    def _entry(self, leaf: Expr) -> Expr:
        """An index as the entry of the parameter vector that holds it."""
        if isinstance(leaf, Gather) and leaf.kind == "index" and isinstance(leaf.at, Column):
            return Gather(leaf.span, "parameter", self._tables.entries(leaf.at))
        return leaf

    def _declared_value(self, instance: Instance, param: tree.Param, shape: Shape, own: Environment) -> Value:
        """What the experiment, the argument or the default says; the experiment perhaps for some elements of an array only."""
        gifts = self._arguments.get((instance.outline, param.name.text), ())
        value: Value | None = None
        if not any(gift.whole for gift in gifts):
            value = self._written(instance, param, shape, own)
        env = self._file if instance.parent is None else self._outside()
        around = indices_around(instance, self._instances, self._own) if gifts else []
        for gift, mask in in_order(gifts, instance.domain, around, env):
            if param.name.text in self._structural[instance.agent.name]:
                self._check_alike(gift, instance, param, len(shape), env)
            gift_value = given(gift, len(shape), instance, around, env)
            typed = self._typed(gift_value, param, shape, gift.value)
            value = typed if value is None or mask.all() else overlaid(mask, typed, value, gift.path)
        if value is None:
            raise Rejected  # reported where the argument is missing
        return value

    def _written(self, instance: Instance, param: tree.Param, shape: Shape, own: Environment) -> Value:
        """The argument or the default."""
        sub = instance.instance
        if sub is not None and instance.parent is not None:
            expr = next((arg.value for arg in sub.args if arg.name.text == param.name.text), None)
            if expr is not None:
                env = self.environment(instance.parent, instance.domain, sub.index)
                return self._typed(evaluate(expr, env), param, shape, expr)
        if param.default is None:
            raise Rejected  # reported where the argument is missing
        return self._typed(evaluate(param.default, own), param, shape, param.default)

    def _check_alike(self, gift: Gift, to: Instance, param: tree.Param, rank: int, env: Environment) -> None:
        """A structural parameter is given to all agents of an array alike."""
        if not gift.whole or is_for_each(gift, rank, env):
            name = param.name.text
            raise Rejected(StructuralElement(gift.path.span, name=name, path=plain(to.named(name))))

    def _typed(self, value: Value, param: tree.Param, shape: Shape, expr: tree.Expr) -> Value:
        value = expected(value, param.type.scalar, shape, f"parameter `{param.name.text}`", expr)
        return replace(value, elements=tuple(measured(e) for e in value.elements))


def index_of_elements(domain: Domain) -> Value:
    """The index of each element in the innermost array around it."""
    return scalar_of("int", index_value(column(domain.indices[-1])))


def overlaid(mask: NDArray[np.bool_], given: Value, value: Value, node: tree.Node) -> Value:
    """`given` for the elements that `mask` marks, `value` for the others."""
    test = index_value(column(mask.astype(np.int64)), node.span)
    pairs = zip(given.elements, value.elements, strict=True)
    return replace(value, elements=tuple(Choose(node.span, test, a, b) for a, b in pairs))


def _own(first: int, size: int, count: int) -> Expr:
    """The entries of one scalar of a parameter, element by element."""
    if count == 1:
        return expression.Parameter(None, first)
    return Gather(None, "parameter", Column(first + size * np.arange(count)))
