"""Structure: agents, levels and couplings become nodes with scalar equations.

In: instances, parameters and an experiment's initial values. Out: a `Flat` model. Guaranteed: every variable's scalars are defined exactly once
and every state has an initial value; couplings are substituted down to the variables that are really read; what is used more than once is
a definition; no expression is deeper than `MAX_DEPTH`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.equations.errors import (
    DefinedTwice,
    DerivativeOfRead,
    NeverDefined,
    NoDerivative,
    NotAState,
)
from hierc.compiler.expression import Expr, Local, Number, Rate, State
from hierc.compiler.resolve.declarations import Equation, Variable
from hierc.compiler.resolve.errors import GivenTwice
from hierc.compiler.shapes.evaluate import Environment, Values, evaluate, expected, selected, span_of
from hierc.compiler.shapes.operations import Sharing, condition
from hierc.compiler.shapes.terms import cut
from hierc.compiler.shapes.values import Shape, Value, element_names, is_leaf, number
from hierc.compiler.structure.flat import Flat, FlatDefinition, FlatState, FlatVariable
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.parameters import Parameters
from hierc.compiler.structure.paths import elements
from hierc.compiler.structure.storage import Storage, allocate
from hierc.compiler.units.units import scale_of
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Initial values that an experiment gives, by instance and name.
Initials = Mapping[tuple[int, str], tuple[tree.Initial, ...]]


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
        self._definitions: list[FlatDefinition] = list(self.storage.algebraic)
        self._equations: dict[tuple[str, int], _Defined] = {}  # by "diff" or "alge" and index
        self._initial_values: dict[int, Expr] = {}
        self._nominals: dict[int, Expr] = {}
        #: Values of the `read` variables and `let`s of each instance; what is missing was reported.
        self.named: list[dict[str, Value]] = [{} for _ in instances]

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
            self.storage.nodes,
            tuple(self._state(index) for index in range(len(self.storage.states))),
            tuple(self._finished(index) for index in range(len(self._definitions))),
            tuple(self._variables()),
        )

    # ---- sharing ------------------------------------------------------------------------------------------------------------------

    def _define(self, name: str, path: str, expr: Expr, span: Span, *, hidden: bool = False) -> Expr:
        """A leaf that stands for `expr`."""
        if is_leaf(expr):
            return expr
        value = self._shallow(expr, name, path)
        self._definitions.append(FlatDefinition(name, path, value, span, None, hidden))
        return Local(span, len(self._definitions) - 1)

    def _shallow(self, expr: Expr, name: str, path: str) -> Expr:
        """`expr` with its deep parts cut out into definitions of their own."""

        def part(deep: Expr) -> Expr:
            self._definitions.append(
                FlatDefinition(f"part of {name}", path, deep, deep.span or self._span, None, True)
            )
            return Local(deep.span, len(self._definitions) - 1)

        return cut(expr, part)

    @property
    def _span(self) -> Span:
        return self._instances[0].agent.definition.name.span

    def _environment(self, instance: Instance) -> Environment:
        def define(name: str, expr: Expr) -> Expr:
            return self._define(
                name, instance.named(name), expr, expr.span or instance.agent.definition.span, hidden=True
            )

        return replace(self._file, scope=_InstanceScope(self, instance), sharing=Sharing(define))

    def placed(self, value: Value, span: Span) -> Value:
        """A `let` or coupling used at `span`. Variables in it stay where the text names them: that is what a problem points at."""
        elements = (
            replace(e, span=span) if isinstance(e, Local) and not self._is_variable(e) else e
            for e in value.elements
        )
        return replace(value, elements=tuple(elements))

    def instance(self, index: int) -> Instance:
        """The instance with this id."""
        return self._instances[index]

    def parameters_of(self, instance: Instance) -> Values:
        """Parameters, constants and `let`s of them."""
        return self._parameters.by_instance[instance.id]

    # ---- names --------------------------------------------------------------------------------------------------------------------

    def _reads(self, instance: Instance) -> None:
        """Evaluate the couplings of an agent among the names of the one around it."""
        if instance.parent is None:
            bindings = self._experiment.bindings if self._experiment else ()
            env = replace(self._file, sharing=self._environment(instance).sharing)
        else:
            bindings = instance.instance.bindings if instance.instance else ()
            env = self._environment(self._instances[instance.parent])
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
            self._define(n, instance.named(n), e, span) for n, e in zip(names, value.elements, strict=True)
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
            path = instance.named(names[place])
            self._equations[key] = _Defined(
                self._shallow(element, names[place], path), equation.equation.span
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
        """Report a vector of which some elements, but not all, have an equation."""
        kind = "diff" if variable.declarator.initial is not None else "alge"
        there = [(kind, index) in self._equations for index in indices]
        if any(there) and not all(there):
            name = element_names(variable.name, self.storage.shapes[instance.id][variable.name])[
                there.index(False)
            ]
            self._problems.add((NoDerivative if kind == "diff" else NeverDefined)(variable.span, name=name))

    def _initial(self, instance: Instance, variable: Variable, indices: Sequence[int]) -> None:
        """What the experiment gives, all or some elements, and for the others what the declaration says."""
        name, own = variable.name, self._environment(instance)
        outside = replace(self._file, sharing=own.sharing)
        shape = self.storage.shapes[instance.id][name]
        first: dict[int, tree.Path] = {}
        for given in self._initials.get((instance.id, name), ()):
            path = given.path
            part, places = elements(path.steps[-1].subs, path.text, shape, path, outside)
            self._start(instance, name, given.value, part, [indices[p] for p in places], outside)
            twice = next((first[p] for p in places if p in first), None)
            if twice is not None:
                self._problems.add(GivenTwice(path.span, name=path.span.text, first=twice.span))
            first.update(dict.fromkeys(places, path))
        if variable.declarator.initial is not None and len(first) < len(indices):
            self._start(instance, name, variable.declarator.initial, shape, indices, own)

    def _start(
        self,
        instance: Instance,
        name: str,
        expr: tree.Expr,
        shape: Shape,
        indices: Sequence[int],
        env: Environment,
    ) -> None:
        """Initial values of some scalars of a state; what has one already keeps it."""
        value = expected(evaluate(expr, env), "real", shape, f"`{name}`", expr)
        for index, element in zip(indices, value.elements, strict=True):
            if index not in self._initial_values:
                self._initial_values[index] = self._shallow(element, name, instance.named(name))

    def _nominal(self, instance: Instance, variable: Variable, indices: Sequence[int]) -> None:
        expr = variable.declarator.nominal
        if expr is None:
            return
        env = replace(self._file, scope=self.parameters_of(instance))
        value = evaluate(expr, env)
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
        )

    def _finished(self, index: int) -> FlatDefinition:
        definition = self._definitions[index]
        if definition.owner is None:
            return definition
        return replace(definition, value=self._equations["alge", index].value)

    def _variables(self) -> Iterator[FlatVariable]:
        for instance in self._instances:
            for name, variable in instance.agent.variables.items():
                shape = self.storage.shapes[instance.id][name]
                unit = variable.declarator.unit
                yield FlatVariable(
                    instance.named(name), shape, unit.text if unit else None, variable.decl.doc,
                    variable.decl.access, self._elements(instance, variable), variable.span, scale_of(unit),
                )  # fmt: skip

    def _elements(self, instance: Instance, variable: Variable) -> tuple[State | Local, ...] | None:
        """The leaves of a variable; those of a `read` only when it is bound to one variable."""
        if variable.decl.access != "read":
            return tuple(
                e
                for e in self.storage.value(instance, variable.name, variable.span).elements
                if isinstance(e, State | Local)
            )
        value = self.named[instance.id][variable.name]
        found = [
            e
            for e in value.elements
            if isinstance(e, State) or (isinstance(e, Local) and self._is_variable(e))
        ]
        return tuple(found) if len(found) == len(value.elements) else None

    def _is_variable(self, leaf: Local) -> bool:
        return self._definitions[leaf.index].owner is not None


def _iterations(over: tree.Over | None, env: Environment) -> Iterator[Environment]:
    if over is None:
        yield env
    else:
        for i in span_of(over.range, env):
            yield env.bind(over.index.text, number(i, "int"))


def _is_matrix(owner: Instance, name: str) -> bool:
    """Whether a variable, parameter or constant is declared as a matrix."""
    agent = owner.agent
    declared = (
        agent.variables[name].decl
        if name in agent.variables
        else agent.params.get(name) or agent.consts.get(name)
    )
    return declared is not None and len(declared.type.sizes) == 2


@dataclass(frozen=True, slots=True)
class _InstanceScope:
    """The names of one agent: its parameters and constants, its variables and `let`s, the `write` variables of its sub-agents."""

    flattener: _Flattener
    instance: Instance

    def lookup(self, ref: tree.Ref) -> Value:
        """The value of a reference, without its subscripts. Raises Rejected for a derivative of what has none."""
        steps = ref.path.steps
        owner, name = self.instance, steps[0].name.text
        if len(steps) > 1:
            owner, name = self.flattener.instance(owner.children[name]), steps[1].name.text
        variable = owner.agent.variables.get(name)
        if ref.prime:
            return self._rate(ref, owner, name, variable)
        if variable is not None and variable.decl.access != "read":
            return self.flattener.storage.value(owner, name, ref.span)
        named = self.flattener.named[owner.id].get(name)
        if named is not None:
            return self.flattener.placed(named, ref.span)
        value = (
            self.flattener.parameters_of(owner).by_name.get(name)
            if name not in owner.agent.lets and variable is None
            else None
        )
        if value is None:
            raise Rejected
        return value.at(ref.span)

    def _rate(self, ref: tree.Ref, owner: Instance, name: str, variable: Variable | None) -> Value:
        if variable is not None and variable.decl.access == "read":
            raise Rejected(DerivativeOfRead(ref.span, name=name, example=self._bound_to(name)))
        if variable is None or variable.declarator.initial is None:
            raise Rejected(NotAState(ref.span, name=ref.path.text, matrix=_is_matrix(owner, name)))
        value = self.flattener.storage.value(owner, name, ref.span)
        elements = tuple(Rate(ref.span, e.index) for e in value.elements if isinstance(e, State))
        return replace(value, elements=elements)

    def _bound_to(self, name: str) -> str | None:
        """What the user's coupling gives for a read variable, if it is a single name."""
        if self.instance.instance is None:
            return None
        bound = (bind.value for bind in self.instance.instance.bindings if bind.name.text == name)
        value = next(bound, None)
        return value.path.text if isinstance(value, tree.Ref) and not value.prime else None
