"""Units: everything that is added, compared, assigned, coupled or handed over is in units that agree.

In: a `Library` with right names, and the experiment that runs. Reported: E401 to E403, E405, E406, after `check_declared_units` has found every
declared unit to be one (E404). Each agent is checked once, by its text alone: what its reads, parameters and sub-agents are in stands in
their declarations, so neither instances nor shapes are needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.resolve.declarations import Agent, Equation, Library, owner_of
from hierc.compiler.resolve.names import Names, is_own
from hierc.compiler.units.agreement import Differ, Operand, Rules, named, operand
from hierc.compiler.units.errors import CouplingUnits, RateUnitsDiffer, Side, UnitsDiffer
from hierc.compiler.units.functions import ANY_NUMBER, needed
from hierc.compiler.units.inference import FileScope, Inference, Shared, function_inference
from hierc.compiler.units.quantity import TIME, UNKNOWN, Measured, Quantity, declared, rate
from hierc.compiler.units.spelling import Spellings
from hierc.compiler.units.units import Unit, parse_unit
from hierc.grammar import tree
from hierc.grammar.problems import Problem
from hierc.grammar.source import Span

#: Settings in s; the others are numbers.
TIMES = ("start", "stop", "interval", "max_step", "min_step")


def check_declared_units(library: Library, problems: Collector) -> None:
    """Report declared units that are unknown (E404)."""
    for unit in _declared_units(library):
        try:
            parse_unit(unit.text, unit.span)
        except Rejected as rejection:
            problems.rejected(rejection)


def check_units(library: Library, names: Names, problems: Collector, *, strict: bool) -> None:
    """Check all agents, constants and functions. `strict`: a plain number but 0 takes no unit."""
    file = _Checker(_inference(library, problems, strict))
    for const in library.consts.values():
        file.const(const)
    for func in library.funcs.values():
        given = {p.name.text: declared(p.unit, p.type.scalar) for p in func.params}
        function_inference(file.inference.shared, func, given).quantity(func.body)
        for param in func.params:
            file.param(param)
    for agent in library.agents.values():
        _check_agent(file.inference.shared, agent, names.lets[agent.name])


def check_experiment_units(
    library: Library, names: Names, experiment: tree.Experiment, problems: Collector, *, strict: bool
) -> None:
    """Check the arguments, couplings, initial values and settings of an experiment whose names are right."""
    file = _Checker(_inference(library, problems, strict))
    top = library.agents[experiment.agent.text]
    inside = _of_agent(file.inference.shared, top, names.lets[top.name])
    for arg in experiment.args:
        owner = owner_of(library, top, arg.path)
        if owner is not None and (param := owner.params.get(arg.path.steps[-1].name.text)) is not None:
            (file if is_own(arg) else inside).argument(param, arg.value, arg.span)
    for bind in experiment.bindings:
        inside.coupling(top, bind)
    for item in experiment.items:
        match item:
            case tree.InitBlock(values=values):
                for initial in values:
                    inside.initial(owner_of(library, top, initial.path), initial)
            case tree.Setting():
                inside.setting(item)
            case tree.GroupSettings(settings=settings):
                for setting in settings:
                    inside.setting(setting)
            case _:
                pass


def _inference(library: Library, problems: Collector, strict: bool) -> Inference:
    spellings = Spellings(_spelled(library))
    shared = Shared(library, Rules(strict, spellings, problems.add))
    return Inference(shared, FileScope(library, {}))


def _spelled(library: Library) -> Iterator[tuple[str, Unit]]:
    return ((unit.text, parse_unit(unit.text, unit.span)) for unit in _declared_units(library))


def _declared_units(library: Library) -> Iterator[tree.Unit]:
    """All units of declarations, in the order of the text within each kind."""
    found = [const.unit for const in library.consts.values()]
    found += [param.unit for func in library.funcs.values() for param in func.params]
    outsides: list[tree.Table | tree.Extern] = [*library.tables.values(), *library.externs.values()]
    for outside in outsides:
        found += [outside.unit, *(param.unit for param in outside.params)]
    for agent in library.agents.values():
        found += [param.unit for param in agent.params.values()]
        found += [const.unit for const in agent.consts.values()]
        found += [variable.declarator.unit for variable in agent.variables.values()]
        found += [let.let.unit for let in agent.lets.values()]
    return (unit for unit in found if unit is not None)


# ---- one agent ------------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class AgentScope:
    """The names of an agent, then the file's. `lets` are those inferred so far."""

    library: Library
    agent: Agent
    file: FileScope
    lets: dict[str, Quantity] = field(default_factory=dict)

    def quantity(self, name: str, ref: tree.Ref) -> Quantity:
        """What the name is in; see `inference.Scope`."""
        agent = self.agent
        if name in agent.subs:
            inner = self.library.agents.get(agent.subs[name].instance.agent.text)
            return UNKNOWN if inner is None else variable_unit(inner, ref.path.steps[-1].name.text)
        if name in agent.variables:
            return variable_unit(agent, name)
        if name in agent.lets:
            return self.lets.get(name, UNKNOWN)
        constant = agent.params.get(name) or agent.consts.get(name)
        if constant is not None:
            return declared(constant.unit, constant.type.scalar)
        return self.file.quantity(name, ref)

    def constant(self, name: str) -> tree.Const | None:
        """The constant of this name; see `inference.Scope`."""
        agent = self.agent
        if name in agent.consts:
            return agent.consts[name]
        own = (agent.params, agent.variables, agent.lets, agent.subs)
        return None if any(name in names for names in own) else self.file.constant(name)


def variable_unit(agent: Agent, name: str) -> Quantity:
    """What a variable of an agent is declared in."""
    variable = agent.variables.get(name)
    return UNKNOWN if variable is None else declared(variable.declarator.unit, variable.decl.type.scalar)


def _of_agent(shared: Shared, agent: Agent, lets: tuple[str, ...]) -> _Checker:
    """A checker in the scope of an agent, whose `let`s it has checked."""
    scope = AgentScope(shared.library, agent, FileScope(shared.library, {}))
    checker = _Checker(Inference(shared, scope))
    for name in lets:
        scope.lets[name] = checker.let(agent.lets[name].let)
    return checker


def _check_agent(shared: Shared, agent: Agent, lets: tuple[str, ...]) -> None:
    """Check all expressions of one agent."""
    checker = _of_agent(shared, agent, lets)
    for param in agent.params.values():
        checker.param(param)
    for const in agent.consts.values():
        checker.const(const)
    for variable in agent.variables.values():
        checker.variable(variable.decl, variable.declarator)
    for equation in agent.equations:
        checker.equation(agent, equation)
    for invariant in agent.invariants:
        checker.inference.quantity(invariant.condition)
    for sub in agent.subs.values():
        checker.instance(shared.library.agents.get(sub.instance.agent.text), sub.instance)


@dataclass(frozen=True, slots=True)
class _Checker:
    """Checks one thing after the other, in one scope."""

    inference: Inference

    # ---- declarations -----------------------------------------------------------------------------------------------------------------

    def const(self, const: tree.Const) -> None:
        self._declared(const.name, const.unit, const.type.scalar, const.value)

    def param(self, param: tree.Param) -> None:
        if param.default is not None:
            self._declared(param.name, param.unit, param.type.scalar, param.default)

    def variable(self, decl: tree.Decl, declarator: tree.Declarator) -> None:
        if declarator.initial is not None:
            self._declared(declarator.name, declarator.unit, decl.type.scalar, declarator.initial)
        if declarator.nominal is not None:
            wanted = declared(declarator.unit, decl.type.scalar)
            text = f"{declarator.name.text} nominal {declarator.nominal.span.text}"
            self._assigned(named(declarator.name, wanted), declarator.nominal, text)

    def let(self, let: tree.Let) -> Quantity:
        """The unit of a `let`: the declared one, or that of its value."""
        if let.unit is None:
            return self.inference.quantity(let.value)
        return self._declared(let.name, let.unit, "real", let.value)

    def _declared(self, name: tree.Name, unit: tree.Unit | None, scalar: str, value: tree.Expr) -> Quantity:
        wanted = declared(unit, scalar)
        self._assigned(named(name, wanted), value, name.span.to(value.span).text)
        return wanted

    # ---- equations and instances ------------------------------------------------------------------------------------------------------

    def equation(self, agent: Agent, equation: Equation) -> None:
        target, value = equation.equation.target, equation.equation.value
        bound = frozenset({equation.over.index.text}) if equation.over is not None else frozenset[str]()
        unit = variable_unit(agent, target.name.text)
        if equation.kind == "alge":
            left = Operand(target.span, unit, name=target.span.text)
            self._assigned(left, value, target.span.to(value.span).text, bound)
            return

        def differ(left: Side, right: Side) -> Problem:
            variable = agent.variables[target.name.text].declarator
            unit_text = variable.unit.text if variable.unit is not None else ""
            return RateUnitsDiffer(
                right.span,
                text=f"{target.span.text}' = {value.span.text}",
                name=target.span.text,
                declared=unit_text,
                rate=left,
                right=right,
            )

        left = Operand(target.span, rate(unit), name=f"{target.span.text}'")
        self._agreed(left, value, differ, bound)

    def instance(self, inner: Agent | None, instance: tree.Instance) -> None:
        if inner is None:
            return
        index = instance.index
        bound = frozenset({index.index.text}) if index is not None else frozenset[str]()
        for arg in instance.args:
            if (param := inner.params.get(arg.name.text)) is not None:
                self.argument(param, arg.value, arg.span, bound)
        for bind in instance.bindings:
            self.coupling(inner, bind, bound)

    def argument(
        self, param: tree.Param, value: tree.Expr, span: Span, bound: frozenset[str] = frozenset()
    ) -> None:
        """The argument at `span` gives a parameter of an agent its value. The names `bound` are indices."""
        self._assigned(named(param.name, declared(param.unit, param.type.scalar)), value, span.text, bound)

    def coupling(self, inner: Agent, bind: tree.Bind, bound: frozenset[str] = frozenset()) -> None:
        """A coupling gives a `read` variable of `inner` its value. The names `bound` are indices."""

        def differ(left: Side, right: Side) -> Problem:
            return CouplingUnits(right.span, text=bind.span.text, read=left, given=right)

        variable = inner.variables.get(bind.name.text)
        if variable is not None:
            wanted = variable_unit(inner, variable.name)
            self._agreed(named(variable.declarator.name, wanted), bind.value, differ, bound)

    # ---- experiments ------------------------------------------------------------------------------------------------------------------

    def initial(self, owner: Agent | None, initial: tree.Initial) -> None:
        name = initial.path.steps[-1].name
        if owner is not None and name.text in owner.variables:
            read = Operand(initial.path.span, variable_unit(owner, name.text), name=initial.path.text)
            self._assigned(read, initial.value, initial.path.span.to(initial.value.span).text)

    def setting(self, setting: tree.Setting) -> None:
        name = setting.name.text
        if name in TIMES:
            self._assigned(
                named(setting.name, TIME), setting.value, setting.name.span.to(setting.value.span).text
            )
        elif name in ("rtol", "atol"):
            given = operand(setting.value, self.inference.quantity(setting.value))
            needed(given, f"`{name}`", ANY_NUMBER, self.inference.shared.rules, None)

    # ---- agreement --------------------------------------------------------------------------------------------------------------------

    def _assigned(
        self, wanted: Operand, value: tree.Expr, text: str, bound: frozenset[str] = frozenset()
    ) -> None:
        """`value` is given to what is `wanted`; `text` is how the user says so."""

        def differ(left: Side, right: Side) -> Problem:
            return UnitsDiffer(right.span, text=text, left=left, right=right)

        self._agreed(wanted, value, differ, bound)

    def _agreed(
        self, wanted: Operand, value: tree.Expr, differ: Differ, bound: frozenset[str] = frozenset()
    ) -> None:
        given = operand(value, self.inference.quantity(value, bound))
        if isinstance(wanted.quantity, Measured):
            self.inference.shared.rules.agreed(wanted, given, differ)
