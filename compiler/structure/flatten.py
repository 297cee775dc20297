"""Structure: agents, levels and couplings become nodes with scalar equations.

In: instances, parameters and an experiment's initial values. Out: a `Flat` model. Guaranteed: every variable's scalars are defined exactly once
and every state has an initial value; couplings are substituted down to the variables that are really read; what is used more than once is
a definition; no expression is deeper than `MAX_DEPTH`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Integers, column
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.equations.errors import DefinedTwice, NeverDefined, NoDerivative
from hierc.compiler.expression import Choose, Expr, Number
from hierc.compiler.resolve.declarations import Equation, Variable
from hierc.compiler.resolve.errors import GivenTwice
from hierc.compiler.shapes.environment import Environment, Scope, Values
from hierc.compiler.shapes.evaluate import evaluate, expected, selected, span_of
from hierc.compiler.shapes.operations import Sharing, condition
from hierc.compiler.shapes.values import Value, element_names, index_value, number
from hierc.compiler.structure.alike import Joiner
from hierc.compiler.structure.array_reads import View
from hierc.compiler.structure.each import given, indices_around
from hierc.compiler.structure.fan_in import FanIns
from hierc.compiler.structure.flat import Flat, FlatDefinition, FlatState
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.parameters import Brought, Parameters, index_of_elements
from hierc.compiler.structure.paths import Gift, elements, in_order
from hierc.compiler.structure.scope import InstanceScope
from hierc.compiler.structure.sharing import Definitions
from hierc.compiler.structure.storage import Storage, StoredGathering, allocate
from hierc.compiler.structure.variables import flat_variables
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Initial values that an experiment gives, by agent of the outline and name.
Initials = Mapping[tuple[int, str], tuple[Gift, ...]]


def flatten(
    context: Context,
    instances: Sequence[Instance],
    parameters: Parameters,
    experiment: tree.Experiment | None,
    initials: Initials,
) -> Flat:
    """Put the model together."""
    return _Flattener(context, tuple(instances), parameters, experiment, initials).result()


@dataclass(frozen=True, slots=True)
class _Defined:
    """A scalar's equation."""

    value: Expr
    span: Span


class _Flattener:
    """Fills the tables of the flat model, agent by agent."""

    def __init__(
        self,
        context: Context,
        instances: tuple[Instance, ...],
        parameters: Parameters,
        experiment: tree.Experiment | None,
        initials: Initials,
    ) -> None:
        self._file = context.environment()
        self._names = context.names
        self._problems = context.problems
        self._instances = instances
        self._parameters = parameters
        self._experiment = experiment
        self._initials = initials
        self.storage: Storage = allocate(self._file, instances, parameters, self._problems)
        self._definitions = Definitions(self.storage)
        self._equations: dict[tuple[str, int], _Defined] = {}  # by "diff" or "alge" and index
        self._initial_values: dict[int, Expr] = {}
        self._nominals: dict[int, Expr] = {}
        #: Variables with an equation that was refused, by instance and name.
        self._refused: set[tuple[int, str]] = set()
        #: Values of the `read` variables and `let`s of each instance; what is missing was reported.
        self.named: list[dict[str, Value]] = [{} for _ in instances]
        self.fan_ins = FanIns(self.storage)

    def result(self) -> Flat:
        for instance in self._instances:
            self._reads(instance)
            self._lets(instance)
        for instance in self._instances:
            self._instance_equations(instance)
            self._states(instance)
        self._problems.stop_on_errors()
        return Flat(
            self._instances,
            (*self.storage.nodes, *self.fan_ins.nodes),
            tuple(self._state(index) for index in range(len(self.storage.states))),
            (
                *(self._finished(index) for index in range(len(self._definitions.made))),
                *self.fan_ins.definitions,
            ),
            tuple(flat_variables(self._instances, self.storage, self.named)),
        )

    # ---- sharing ------------------------------------------------------------------------------------------------------------------

    def _environment(self, at: Instance, around: Instance | None = None) -> Environment:
        """The scope of an agent for its own equations, or that of the agent `around` it for its couplings."""

        scope = InstanceScope(self, at if around is None else around)
        env = self._used_by(at, scope, self._file)
        if around is None or at.instance is None or at.instance.index is None:
            return env
        index = at.instance.index.index.text
        view = View(at.domain, at.domain.places, index)
        return replace(env, scope=replace(scope, view=view)).bind(index, index_of_elements(at.domain))

    def _used_by(self, at: Instance, scope: InstanceScope, env: Environment) -> Environment:
        """`env` with the names of a scope, for expressions that the elements of `at` use."""

        def define(name: str, expr: Expr) -> Expr:
            return self._definitions.define(
                name, at, expr, expr.span or at.agent.definition.span, hidden=True
            )

        gathering = StoredGathering(self.storage, self._parameters.tables)
        joiner = Joiner(self._definitions, self.fan_ins, gathering, scope.instance, at.domain)
        return replace(
            env,
            scope=scope,
            sharing=Sharing(define, joiner.joined),
            gathering=gathering if at.domain.count > 1 else None,
        )

    def brought(self, value: Value, view: View) -> Value:
        """See `array_reads.Owner`."""
        return self._definitions.brought(value, view)

    def spread(self, instance: Instance, view: View, env: Environment) -> Environment:
        """See `array_reads.Owner`."""
        return self._used_by(replace(instance, domain=view.domain), InstanceScope(self, instance, view), env)

    def deciding(self, instance: Instance, domain: Domain, env: Environment) -> Environment:
        """See `array_reads.Owner`."""
        scope: Scope = self.parameters_of(instance)
        if instance.domain.count > 1:
            scope = Brought(scope, domain.places)
        gathering = self._parameters.tables if domain.count > 1 else None
        return replace(self._file, scope=scope, gathering=gathering, indices=env.indices)

    def computed(self, expr: Expr, around: Instance, domain: Domain, span: Span) -> Integers:
        """See `array_reads.Owner`."""
        at = replace(around, domain=domain)
        return self.fan_ins.computed(self._definitions.shallow(expr, "term", at), at, span)

    def placed(self, value: Value, span: Span) -> Value:
        """See `array_reads.Owner`."""
        return self._definitions.placed(value, span)

    def instance(self, index: int) -> Instance:
        """See `array_reads.Owner`."""
        return self._instances[index]

    def parameters_of(self, instance: Instance) -> Values:
        """See `array_reads.Owner`."""
        return self._parameters.by_instance[instance.id]

    def named_of(self, instance: Instance, name: str) -> Value | None:
        """See `array_reads.Owner`."""
        return self.named[instance.id].get(name)

    # ---- names --------------------------------------------------------------------------------------------------------------------

    def _reads(self, instance: Instance) -> None:
        """Evaluate the couplings of an agent among the names of the one around it."""
        if instance.parent is None:
            bindings = self._experiment.bindings if self._experiment else ()
            env = replace(self._outside, sharing=self._environment(instance).sharing)
        else:
            bindings = instance.instance.bindings if instance.instance else ()
            env = self._environment(instance, self._instances[instance.parent])
        for bind in bindings:
            name = bind.name.text
            shape = self.storage.shapes[instance.id].get(name)
            if shape is None:
                continue
            try:
                value = expected(evaluate(bind.value, env), "real", shape, f"`{name}`", bind.value)
            except Rejected as rejection:
                self._problems.rejected(rejection)
            else:
                self._name(instance, name, value, bind.value.span)

    def _lets(self, instance: Instance) -> None:
        env = self._environment(instance)
        for name in self._names.lets[instance.agent.name]:
            let = instance.agent.lets[name].let
            try:
                self._name(instance, name, evaluate(let.value, env), let.name.span)
            except Rejected as rejection:
                self._problems.rejected(rejection)

    def _name(self, instance: Instance, name: str, value: Value, span: Span) -> None:
        """Make a definition of each scalar of a `let` or coupling."""
        names = element_names(name, value.shape)
        elements = tuple(
            self._definitions.define(n, instance, e, span) for n, e in zip(names, value.elements, strict=True)
        )
        self.named[instance.id][name] = replace(value, elements=elements)

    # ---- equations ----------------------------------------------------------------------------------------------------------------

    def _instance_equations(self, instance: Instance) -> None:
        env = self._environment(instance)
        for equation in instance.agent.equations:
            try:
                for inner in _iterations(equation.over, env):
                    self._equation(instance, equation, inner)
            except Rejected as rejection:
                self._problems.rejected(rejection)
                self._refused.add((instance.id, equation.equation.target.name.text))
        for invariant in instance.agent.invariants:
            try:
                condition(evaluate(invariant.condition, env), invariant.condition)
            except Rejected as rejection:
                self._problems.rejected(rejection)

    def _equation(self, instance: Instance, equation: Equation, env: Environment) -> None:
        target, value = equation.equation.target, equation.equation.value
        name = target.name.text
        shape = self.storage.shapes[instance.id].get(name)
        indices = self.storage.indices[instance.id].get(name)
        if shape is None or indices is None:
            return
        places: Sequence[int] = range(len(indices))
        names = element_names(name, shape)
        if target.subs:
            shape, places = selected(name, f"real{list(shape) or ''}", shape, target.subs, target, env)
        subject = f"`{target.span.text}{chr(39) if equation.kind == 'diff' else ''}`"
        right = expected(evaluate(value, env), "real", shape, subject, value)
        for place, element in zip(places, right.elements, strict=True):
            key = (equation.kind, indices[place])
            if key in self._equations:
                self._problems.add(
                    DefinedTwice(target.span, name=names[place], first=self._equations[key].span)
                )
                continue
            self._equations[key] = _Defined(
                self._definitions.shallow(element, names[place], instance), equation.equation.span
            )

    def _states(self, instance: Instance) -> None:
        """Initial and nominal values; every scalar must have its equation."""
        for name, variable in instance.agent.variables.items():
            indices = self.storage.indices[instance.id].get(name)
            if variable.decl.access == "read" or indices is None:
                continue
            self._complete(instance, variable, indices)
            if variable.declarator.initial is not None:
                try:
                    self._initial(instance, variable, indices)
                    self._nominal(instance, variable, indices)
                except Rejected as rejection:
                    self._problems.rejected(rejection)

    def _complete(self, instance: Instance, variable: Variable, indices: Sequence[int]) -> None:
        """Report a vector of which some elements, but not all, have an equation; not where one is there and wrong."""
        if (instance.id, variable.name) in self._refused:
            return
        kind = "diff" if variable.declarator.initial is not None else "alge"
        there = [(kind, index) in self._equations for index in indices]
        if any(there) and not all(there):
            name = element_names(variable.name, self.storage.shapes[instance.id][variable.name])[
                there.index(False)
            ]
            self._problems.add((NoDerivative if kind == "diff" else NeverDefined)(variable.span, name=name))

    def _initial(self, instance: Instance, variable: Variable, indices: Sequence[int]) -> None:
        """What the declaration says, and over it what the experiment gives: to all or some elements, of a vector or of an array."""
        name, own = variable.name, self._environment(instance)
        outside = replace(self._outside, sharing=own.sharing, gathering=self._parameters.tables)
        shape = self.storage.shapes[instance.id][name]
        first: dict[int, tree.Path] = {}
        gifts = self._initials.get((instance.outline, name), ())
        values: list[Expr | None] = [None] * len(indices)
        if variable.declarator.initial is not None and not any(
            g.whole and not g.path.steps[-1].subs for g in gifts
        ):
            initial = variable.declarator.initial
            values = list(expected(evaluate(initial, own), "real", shape, f"`{name}`", initial).elements)
        around = indices_around(instance, self._instances, self._parameters_seen) if gifts else []
        for gift, mask in in_order(gifts, instance.domain, around, outside):
            path = gift.path
            part, places = elements(path.steps[-1].subs, path.text, shape, path, outside)
            gift_value = given(gift, len(part), instance, around, outside)
            start = expected(gift_value, "real", part, f"`{name}`", gift.value).elements
            for place, value in zip(places, start, strict=True):
                before = values[place]
                values[place] = value if before is None or mask.all() else _over(mask, value, before, path)
            twice = next((first[p] for p in places if p in first and gift.whole), None)
            if twice is not None:
                self._problems.add(GivenTwice(path.span, name=path.span.text, first=twice.span))
            first.update(dict.fromkeys(places, path) if gift.whole else {})
        for index, start_value in zip(indices, values, strict=True):
            if start_value is not None:
                self._initial_values[index] = self._definitions.shallow(start_value, name, instance)

    @property
    def _outside(self) -> Environment:
        """What the experiment sees: the parameters of the agent that runs."""
        return self._parameters_seen(self._instances[0])

    def _parameters_seen(self, instance: Instance) -> Environment:
        return replace(self._file, scope=self.parameters_of(instance))

    def _nominal(self, instance: Instance, variable: Variable, indices: Sequence[int]) -> None:
        expr = variable.declarator.nominal
        if expr is None:
            return
        value = evaluate(expr, self._parameters_seen(instance))
        if value.shape != ():
            value = expected(
                value, "real", self.storage.shapes[instance.id][variable.name], "the nominal value", expr
            )
        elements = value.elements if value.shape else value.elements * len(indices)
        self._nominals.update(zip(indices, elements, strict=True))

    # ---- results ------------------------------------------------------------------------------------------------------------------

    def _state(self, index: int) -> FlatState:
        slot = self.storage.states[index]
        equation = self._equations["diff", index]
        nominal = self._nominals.get(index, Number(None, 1.0))
        return FlatState(
            slot.node,
            slot.name,
            equation.value,
            self._initial_values[index],
            nominal,
            slot.span,
            equation.span,
            slot.first,
        )

    def _finished(self, index: int) -> FlatDefinition:
        definition = self._definitions.made[index]
        if definition.owner is None:
            return definition
        return replace(definition, value=self._equations["alge", index].value)


def _over(mask: NDArray[np.bool_], value: Expr, before: Expr, node: tree.Node) -> Expr:
    """`value` for the elements that `mask` marks, `before` for the others."""
    if not mask.any():
        return before
    return Choose(node.span, index_value(column(mask.astype(np.int64)), node.span), value, before)


def _iterations(over: tree.Over | None, env: Environment) -> Iterator[Environment]:
    if over is None:
        yield env
    else:
        for i in span_of(over.range, env):
            yield env.bind(over.index.text, number(i, "int"))
