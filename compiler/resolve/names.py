"""Names: every name in every expression stands for something, of the right kind.

In: a file's own `Library`, and that of all it sees. Guaranteed: every reference, call, instance, argument and coupling names something that
exists and is visible; nothing contains or calls itself; expressions are not too deeply nested. Agents and experiments are checked whether or not they are
chosen to run. For the linked library there are `Names`: the orders in which constants and `let`s can be evaluated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, fields
from typing import Literal

from hierc.compiler.collector import Collector
from hierc.compiler.model import Settings
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import (
    GivenTwice,
    MissingCoupling,
    NoSuchRead,
    UnknownAgent,
    UnknownParameter,
    Unused,
)  # fmt: skip
from hierc.compiler.resolve.ordering import (
    check_calls_end,
    check_containment,
    order_of_consts,
    order_of_lets,
    parameter_lets,
)
from hierc.compiler.resolve.scopes import AgentScope, FileScope, FunctionScope
from hierc.compiler.units.errors import NewtonTrap
from hierc.compiler.walk import subscripts
from hierc.grammar import tree
from hierc.grammar.problems import closest
from hierc.grammar.source import Span

#: Settings whose value is an expression.
_NUMBERS = frozenset(field.name for field in fields(Settings)) - {"method"}

#: Places that may use `let`s of parameters.
WITH_LETS = ("an argument", "a range", "a size or nominal value")


@dataclass(frozen=True, slots=True)
class Names:
    """What is known once all names are right."""

    consts: tuple[str, ...]  # the file's constants, each after those it uses
    agent_consts: Mapping[str, tuple[str, ...]]  # the same for each agent
    lets: Mapping[str, tuple[str, ...]]  # for each agent
    parameter_lets: Mapping[str, frozenset[str]]  # for each agent, those made of parameters only


def check_names(library: Library, scope: Library, problems: Collector) -> None:
    """Check every name in `library`, a file's own definitions, which sees what is in `scope`."""
    check_containment(library, problems)
    check_calls_end(library, problems)
    order_of_consts(library.consts, problems)
    for const in library.consts.values():
        names = FileScope(scope, problems, f"constant `{const.name.text}`", "a constant")
        names.check_all((const.value, *const.type.sizes))
        names.check_shadowing(const.name, file_level=True)
    for func in library.funcs.values():
        _check_function(scope, func, problems)
    recorded = set(_recorded(library))
    for experiment in library.experiments.values():
        recorded |= _check_experiment(scope, experiment, problems)
    for agent in library.agents.values():
        used = _AgentChecker(scope, agent, parameter_lets(agent, scope.consts), problems).check()
        order_of_lets(agent, problems)
        order_of_consts(agent.consts, problems)
        _warn_of_unused(agent, used | recorded, problems)


def _warn_of_unused(agent: Agent, used: Set[str], problems: Collector) -> None:
    """A warning for each `let` and each private variable that nothing uses."""
    for name, let in agent.lets.items():
        if name not in used:
            problems.add(Unused(let.let.name.span, name=name, private=False))
    for name, variable in agent.variables.items():
        if variable.decl.access == "private" and name not in used:
            problems.add(Unused(variable.span, name=name, private=True))


def _recorded(library: Library) -> Iterator[str]:
    """The names of variables, of whatever agent, that experiments record."""
    for experiment in library.experiments.values():
        for item in experiment.items:
            if isinstance(item, tree.Record):
                yield from (pattern.path.steps[-1].name.text for pattern in item.patterns)


def names_of(library: Library, problems: Collector) -> Names:
    """What is known of the names of a linked library, all of which are right."""
    agents = library.agents.items()
    return Names(
        order_of_consts(library.consts, problems),
        {name: order_of_consts(agent.consts, problems) for name, agent in agents},
        {name: order_of_lets(agent, problems) for name, agent in agents},
        {name: parameter_lets(agent, library.consts) for name, agent in agents},
    )


def size_names(func: tree.Func, consts: Mapping[str, tree.Const]) -> frozenset[str]:
    """Names in the parameters' types that are defined nowhere else: the argument binds them."""
    sizes = (size for param in func.params for size in param.type.sizes)
    bare = (
        s.path
        for s in sizes
        if isinstance(s, tree.Ref) and len(s.path.steps) == 1 and not s.path.steps[0].subs
    )
    return (
        frozenset(path.text for path in bare)
        - frozenset(consts)
        - frozenset(p.name.text for p in func.params)
    )


def _check_function(library: Library, func: tree.Func, problems: Collector) -> None:
    sizes = size_names(func, library.consts)
    scope = FunctionScope(library, problems, func, sizes | {p.name.text for p in func.params})
    scope.check(func.body)
    scope.check_all(func.type.sizes)
    type_scope = FunctionScope(library, problems, func, sizes)
    type_scope.check_all(size for param in func.params for size in param.type.sizes)
    for param in func.params:
        scope.check_shadowing(param.name)


# ---- agents -------------------------------------------------------------------------------------------------------------------------


class _AgentChecker:
    """Checks all expressions of one agent."""

    def __init__(
        self, library: Library, agent: Agent, fixed_lets: frozenset[str], problems: Collector
    ) -> None:
        self._fixed_lets = fixed_lets
        self._library = library
        self._agent = agent
        self._problems = problems
        self._used: set[str] = set()

    def _scope(self, place: str, params: Iterable[str], *, all_names: bool = False) -> AgentScope:
        lets = self._agent.lets if all_names else self._fixed_lets if place in WITH_LETS else ()
        scope = AgentScope(
            self._library, self._problems, self._agent, place, params, lets, all_names=all_names
        )
        scope.used = self._used
        return scope

    def check(self) -> set[str]:
        """The names that the agent's expressions use."""
        agent = self._agent
        equations = self._scope("an equation", agent.params, all_names=True)
        fixed = self._scope("a size or nominal value", agent.params)
        self._parameters()
        constants = self._scope("a constant", ())
        for const in agent.consts.values():
            constants.check_all((const.value, *const.type.sizes))
            equations.check_shadowing(const.name)
        for variable in agent.variables.values():
            fixed.check_all(variable.decl.type.sizes)
            equations.check_all(e for e in (variable.declarator.initial,) if e is not None)
            fixed.check_all(e for e in (variable.declarator.nominal,) if e is not None)
            equations.check_shadowing(variable.declarator.name)
            self._newton_trap(variable.declarator)
        for let in agent.lets.values():
            equations.check(let.let.value)
            equations.check_shadowing(let.let.name)
        self._equations(equations)
        for sub in agent.subs.values():
            equations.check_shadowing(sub.instance.name)
            self._instance(sub.instance, equations)
        return self._used

    def _parameters(self) -> None:
        """A default may use the parameters before it."""
        before: list[str] = []
        for name, param in self._agent.params.items():
            scope = self._scope("the default of a parameter", before)
            scope.check_all(param.type.sizes)
            scope.check_all(e for e in (param.default,) if e is not None)
            scope.check_shadowing(param.name)
            before.append(name)

    def _newton_trap(self, declarator: tree.Declarator) -> None:
        """`real x[N]` with an integer `N` is meant to be an array."""
        if declarator.unit is None:
            return
        text = declarator.unit.text
        agent = self._agent
        found = agent.params.get(text) or agent.consts.get(text) or self._library.consts.get(text)
        if found is not None and found.type.scalar == "int":
            self._problems.add(NewtonTrap(declarator.unit.span, name=declarator.name.text, unit=text))

    def _equations(self, scope: AgentScope) -> None:
        for equation in self._agent.equations:
            bound: frozenset[str] = frozenset()
            if equation.over is not None:
                scope.check_all((equation.over.range.first, equation.over.range.last))
                scope.check_shadowing(equation.over.index)
                bound = frozenset({equation.over.index.text})
            scope.check(equation.equation.value, bound)
            scope.check_all(subscripts(equation.equation.target.subs), bound)
        for invariant in self._agent.invariants:
            scope.check(invariant.condition)

    def _instance(self, instance: tree.Instance, scope: AgentScope) -> None:
        arguments = self._scope("an argument", self._agent.params)
        bound: frozenset[str] = frozenset()
        if instance.index is not None:
            range_ = instance.index.range
            self._scope("a range", self._agent.params).check_all((range_.first, range_.last))
            scope.check_shadowing(instance.index.index)
            bound = frozenset({instance.index.index.text})
        arguments.check_all((arg.value for arg in instance.args), bound)
        scope.check_all((bind.value for bind in instance.bindings), bound)
        inner = self._library.agents.get(instance.agent.text)
        if inner is None:
            self._problems.add(unknown_agent(instance.agent, self._library))
            return
        check_arguments(inner, instance.args, instance.agent.span, self._problems)
        arguments_given = {arg.name.text for arg in instance.args}
        check_bindings(inner, instance.bindings, instance.name, self._problems, elsewhere=arguments_given)


def check_arguments(
    agent: Agent, args: tuple[tree.Arg, ...], span: Span, problems: Collector, *, alone: bool = False
) -> None:
    """Arguments name parameters, each once, and every parameter without a default has one. `alone`: nothing can give any."""
    given = _once(tuple(arg.name for arg in args), problems)
    wrong = [name for name in given.values() if name.text not in agent.params]
    for name in wrong:
        read = name.text in agent.reads()
        advice = f"`{name.text}` is a `read` variable: couple it, `[{name.text} := …]`" if read else None
        candidates = tuple(agent.params)
        problems.add(
            UnknownParameter(
                name.span, agent=agent.name, name=name.text, candidates=candidates, advice=advice
            )
        )
    meant = {closest(name.text, agent.params) for name in wrong}
    for text, param in agent.params.items():
        if param.default is None and text not in given and text not in meant:
            experiment = f"experiment run of {agent.name}({text} = …) {{ }}"
            advice = f"give it a default, or a value in an experiment: `{experiment}`" if alone else None
            problems.add(
                UnknownParameter(
                    span, agent=agent.name, name=text, candidates=(), missing=True, advice=advice
                )
            )


def check_bindings(
    agent: Agent,
    bindings: tuple[tree.Bind, ...],
    name: tree.Name,
    problems: Collector,
    *,
    top: bool = False,
    elsewhere: Set[str] = frozenset(),
) -> None:
    """Couplings bind every `read` variable exactly once and nothing else. `name` is what lacks them.

    `elsewhere` are names given as arguments, by mistake or not. What a misspelt name stands for is not said to be missing.
    """
    given = _once(tuple(bind.name for bind in bindings), problems)
    wrong = [bound for bound in given.values() if bound.text not in agent.reads()]
    for bound in wrong:
        kind: Literal["parameter", "write", "other"] = "other"
        if bound.text in agent.params:
            kind = "parameter"
        elif bound.text in agent.variables:
            kind = "write"
        problems.add(
            NoSuchRead(bound.span, agent=agent.name, name=bound.text, reads=agent.reads(), kind=kind)
        )
    meant = {closest(bound.text, agent.reads()) for bound in wrong} | elsewhere
    for read in agent.reads():
        if read not in given and read not in meant:
            declared = agent.variables[read].span
            problems.add(
                MissingCoupling(name.span, agent=name.text, read=read, declared=declared, by_experiment=top)
            )


def unknown_agent(agent: tree.Dotted, scope: Library) -> UnknownAgent:
    """The problem of an agent that a file does not see."""
    module = scope.elsewhere.get(agent.text)
    return UnknownAgent(agent.span, name=agent.text, candidates=tuple(scope.agents), module=module)


def _check_experiment(library: Library, experiment: tree.Experiment, problems: Collector) -> set[str]:
    """The agent is there. What its own parameters are given uses the file's constants; all other expressions also what the agent has that is known
    before a run, and those of couplings the time. Returns the names of the agent that are used.
    """
    agent = library.agents.get(experiment.agent.text)
    if agent is None:
        problems.add(unknown_agent(experiment.agent, library))
    where = f"experiment `{experiment.name.text}`"

    used: set[str] = set()

    def inside(place: str) -> FileScope:
        if agent is None:
            return FileScope(library, problems, where, place)
        lets = parameter_lets(agent, library.consts)
        made = AgentScope(library, problems, agent, place, agent.params, lets, all_names=False)
        made.where, made.used = where, used
        return made

    outside = FileScope(library, problems, where, "an argument of an experiment")
    scope = inside("an argument or setting of an experiment")
    for arg in experiment.args:
        (outside if is_own(arg) else scope).check(arg.value)
        scope.check_all(_subscripts((arg.path,)))
    for item in experiment.items:
        scope.check_all(_subscripts(paths_of(item)))
        if isinstance(item, tree.InitBlock):
            scope.check_all(initial.value for initial in item.values)
        elif isinstance(item, tree.Setting | tree.GroupSettings):
            settings = item.settings if isinstance(item, tree.GroupSettings) else (item,)
            scope.check_all(s.value for s in settings if s.name.text in _NUMBERS)
    timed = inside("a coupling")
    timed.timeless = False
    timed.check_all(bind.value for bind in experiment.bindings)
    return used


def is_own(arg: tree.ExpArg) -> bool:
    """Whether an experiment's argument gives a parameter of the agent that runs, not of one in it."""
    return len(arg.path.steps) == 1


def paths_of(item: tree.ExpItem) -> tuple[tree.Path, ...]:
    """The paths in an experiment's item."""
    match item:
        case tree.InitBlock(values=values):
            return tuple(initial.path for initial in values)
        case tree.Record(patterns=patterns):
            return tuple(pattern.path for pattern in patterns)
        case tree.GroupSettings(path=path):
            return (path,)
        case _:
            return ()


def _subscripts(paths: Iterable[tree.Path]) -> Iterator[tree.Expr]:
    """The subscripts in some paths."""
    for path in paths:
        for step in path.steps:
            yield from subscripts(step.subs)


def _once(names: tuple[tree.Name, ...], problems: Collector) -> dict[str, tree.Name]:
    first: dict[str, tree.Name] = {}
    for name in names:
        if first.setdefault(name.text, name) is not name:
            problems.add(GivenTwice(name.span, name=name.text, first=first[name.text].span))
    return first
