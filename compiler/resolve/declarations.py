"""Declarations: what a file and each of its agents declare, by name.

In: the syntax tree of a file. Out: a `Library`: every definition under its name, with the level it stands in. Guaranteed: no name is
declared twice in one scope, and nothing stands in the library that the later phases do not support (each such use was reported).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from hierc.compiler import unsupported
from hierc.compiler.callees.callee import Callee
from hierc.compiler.collector import Collector
from hierc.compiler.resolve.errors import DeclaredTwice
from hierc.grammar import tree
from hierc.grammar.problems import Problem
from hierc.grammar.source import SourceFile, Span


@dataclass(frozen=True, slots=True)
class Variable:
    """A declared variable; `level` names the level it is declared in."""

    decl: tree.Decl
    declarator: tree.Declarator
    level: str | None

    @property
    def name(self) -> str:
        return self.declarator.name.text

    @property
    def span(self) -> Span:
        return self.declarator.name.span


@dataclass(frozen=True, slots=True)
class Level:
    """A level, the one around it, and its place among those that stand beside it."""

    level: tree.Level
    outer: str | None
    index: int

    @property
    def span(self) -> Span:
        return self.level.name.span


@dataclass(frozen=True, slots=True)
class Let:
    let: tree.Let
    level: str | None


@dataclass(frozen=True, slots=True)
class Sub:
    """A sub-agent and the level it stands in."""

    instance: tree.Instance
    level: str | None


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation of a `diff` or `alge` block; `over` where it stands in a `for`."""

    kind: Literal["diff", "alge"]
    equation: tree.Equation
    over: tree.Over | None
    level: str | None


@dataclass(frozen=True, slots=True)
class Agent:
    """An agent definition, sorted by kind. Mappings keep the order of the text."""

    definition: tree.Agent
    params: Mapping[str, tree.Param]
    consts: Mapping[str, tree.Const]
    variables: Mapping[str, Variable]
    lets: Mapping[str, Let]
    subs: Mapping[str, Sub]
    levels: Mapping[str, Level]  # at any depth, each after the one around it
    equations: tuple[Equation, ...]
    invariants: tuple[tree.Invariant, ...]
    groups: Mapping[str, tree.Group]
    each: Mapping[str, tree.GroupEach]  # arrays of which each agent is a group

    @property
    def name(self) -> str:
        return self.definition.name.text

    def names(self) -> tuple[str, ...]:
        """Everything that is declared in it by a name of its own."""
        return (*self.params, *self.consts, *self.variables, *self.lets, *self.subs)

    def reads(self) -> tuple[str, ...]:
        """Names of the `read` variables."""
        return tuple(v.name for v in self.variables.values() if v.decl.access == "read")

    def writes(self) -> tuple[str, ...]:
        """Names of the `write` variables."""
        return tuple(v.name for v in self.variables.values() if v.decl.access == "write")

    def around(self, level: str | None) -> tuple[str, ...]:
        """The levels around what stands in `level`, from the outside in; the last is `level` itself."""
        found: list[str] = []
        while level is not None:
            found.append(level)
            level = self.levels[level].outer
        return tuple(reversed(found))

    def inside(self, outer: str | None) -> tuple[str, ...]:
        """The levels directly in a level, or directly in the agent (None), slowest first."""
        return tuple(name for name, level in self.levels.items() if level.outer == outer)

    def divided(self) -> frozenset[str | None]:
        """What is divided into levels: the agent itself (None) if it has any, and each level that has some inside."""
        return frozenset(level.outer for level in self.levels.values())


@dataclass(frozen=True, slots=True)
class Library:
    """All definitions of a file, or of several linked files; `sources` are their texts, the main one first, then those of data. `callees` are the
    tables and external functions once they have been read.

    Of a file that imports others there is also the library of all that it sees, by the names that it uses: `modules` are those of imported files.
    `elsewhere` says of names that could be imported in which module they are, for advice.
    """

    file: tree.File
    consts: Mapping[str, tree.Const]
    funcs: Mapping[str, tree.Func]
    agents: Mapping[str, Agent]
    experiments: Mapping[str, tree.Experiment]
    sources: tuple[SourceFile, ...]
    modules: frozenset[str] = frozenset()
    elsewhere: Mapping[str, str] = field(default_factory=dict)
    tables: Mapping[str, tree.Table] = field(default_factory=dict)
    externs: Mapping[str, tree.Extern] = field(default_factory=dict)
    callees: Mapping[str, Callee] = field(default_factory=dict)

    def signature(self, name: str) -> tree.Table | tree.Extern | None:
        """The declaration of a table or external function."""
        return self.tables.get(name) or self.externs.get(name)

    def functions(self) -> tuple[str, ...]:
        """The names of all that can be called."""
        return (*self.funcs, *self.tables, *self.externs)

    def own_agents(self) -> tuple[str, ...]:
        """The agents that the main file defines."""
        return tuple(n for n, agent in self.agents.items() if agent.definition.span.file is self.file.source)


def owner_of(library: Library, top: Agent, path: tree.Path) -> Agent | None:
    """The agent that the last name of a path belongs to; None where there is none."""
    at: Agent | None = top
    for step in path.steps[:-1]:
        sub = at.subs.get(step.name.text) if at is not None else None
        at = library.agents.get(sub.instance.agent.text) if sub is not None else None
    return at


def declare(file: tree.File, problems: Collector) -> Library:
    """Sort the definitions of `file`; report what is declared twice or not supported."""
    values = _Names(problems)
    experiment_names = _Names(problems)
    consts: dict[str, tree.Const] = {}
    funcs: dict[str, tree.Func] = {}
    agents: dict[str, Agent] = {}
    experiments: dict[str, tree.Experiment] = {}
    tables: dict[str, tree.Table] = {}
    externs: dict[str, tree.Extern] = {}
    for item in file.items:
        match item:
            case tree.Const(name=name) if values.new(name):
                consts[name.text] = item
            case tree.Func(name=name) if values.new(name):
                _check_params(item.params, problems)
                funcs[name.text] = item
            case tree.Agent(name=name) if values.new(name):
                agents[name.text] = _AgentSorter(item, problems).result()
            case tree.Experiment(name=name) if experiment_names.new(name):
                experiments[name.text] = item
            case tree.Import(module=module, alias=alias):
                values.new(alias or tree.Name(module.span, module.text))
            case tree.FromImport(names=names):
                for name in names:
                    values.new(name)
            case tree.Extern(name=name) if values.new(name):
                _check_params(item.params, problems)
                externs[name.text] = item
            case tree.Table(name=name) if values.new(name):
                _check_params(item.params, problems)
                tables[name.text] = item
            case _:
                pass  # declared twice: reported
    return Library(file, consts, funcs, agents, experiments, (file.source,), tables=tables, externs=externs)


class _Names:
    """One name space: reports a name that is there already."""

    def __init__(self, problems: Collector) -> None:
        self._problems = problems
        self._first: dict[str, tree.Name] = {}

    def new(self, name: tree.Name) -> bool:
        first = self._first.setdefault(name.text, name)
        if first is not name:
            self._problems.add(DeclaredTwice(name.span, name=name.text, first=first.span))
        return first is name


def _check_params(params: tuple[tree.Param, ...], problems: Collector) -> None:
    names = _Names(problems)
    for param in params:
        names.new(param.name)


class _AgentSorter:
    """Sorts the items of one agent by kind."""

    def __init__(self, agent: tree.Agent, problems: Collector) -> None:
        self._agent = agent
        self._problems = problems
        self._names = _Names(problems)
        self._level_names = _Names(problems)
        self._group_names = _Names(problems)
        self._consts: dict[str, tree.Const] = {}
        self._variables: dict[str, Variable] = {}
        self._lets: dict[str, Let] = {}
        self._subs: dict[str, Sub] = {}
        self._levels: dict[str, Level] = {}
        self._equations: list[Equation] = []
        self._invariants: list[tree.Invariant] = []
        self._groups: dict[str, tree.Group] = {}
        self._each: dict[str, tree.GroupEach] = {}

    def result(self) -> Agent:
        params = {p.name.text: p for p in self._agent.params if self._names.new(p.name)}
        for item in self._agent.items:
            self._item(item, None)
        return Agent(
            self._agent, params, self._consts, self._variables, self._lets, self._subs, self._levels,
            tuple(self._equations), tuple(self._invariants), self._groups, self._each,
        )  # fmt: skip

    def _item(self, item: tree.AgentItem, level: str | None) -> None:
        match item:
            case tree.Decl():
                self._variable(item, level)
            case tree.Const(name=name) if self._names.new(name):
                self._consts[name.text] = item
            case tree.Let(name=name) if self._names.new(name):
                self._lets[name.text] = Let(item, level)
            case tree.Diff(equations=equations):
                self._equation_block("diff", equations, level)
            case tree.Alge(equations=equations):
                self._equation_block("alge", equations, level)
            case tree.Inv(invariants=invariants):
                self._problems.add(unsupported.Invariants(item.span))
                self._invariants.extend(invariants)
            case tree.Instance(name=name) if self._names.new(name):
                self._subs[name.text] = Sub(item, level)
            case tree.Level():
                self._level(item, level)
            case tree.Group(name=name) if self._group_names.new(name):
                self._groups[name.text] = item
            case tree.GroupEach(name=name):
                first = self._each.setdefault(name.text, item)
                if first is not item:
                    text = f"group each {name.text}"
                    self._problems.add(DeclaredTwice(name.span, name=text, first=first.name.span))
            case tree.Mode() | tree.Trans() | tree.Sample():
                self._problems.add(_unsupported_item(item))
            case _:
                pass  # declared twice: reported

    def _variable(self, decl: tree.Decl, level: str | None) -> None:
        if decl.kind == "discrete":
            self._problems.add(unsupported.DiscreteVariable(decl.span))
        for declarator in decl.declarators:
            if self._names.new(declarator.name):
                self._variables[declarator.name.text] = Variable(decl, declarator, level)

    def _equation_block(
        self,
        kind: Literal["diff", "alge"],
        items: tuple[tree.Equation | tree.ForBlock, ...],
        level: str | None,
    ) -> None:
        for item in items:
            if isinstance(item, tree.ForBlock):
                self._equations += [Equation(kind, e, item.over, level) for e in item.equations]
            else:
                self._equations.append(Equation(kind, item, None, level))

    def _level(self, item: tree.Level, outer: str | None) -> None:
        if self._level_names.new(item.name):
            index = sum(level.outer == outer for level in self._levels.values())
            self._levels[item.name.text] = Level(item, outer, index)
            for inner in item.items:
                self._item(inner, item.name.text)


def _unsupported_item(item: tree.Mode | tree.Trans | tree.Sample) -> Problem:
    match item:
        case tree.Mode():
            return unsupported.Modes(item.name.span)
        case tree.Trans():
            return unsupported.Transitions(item.span)
        case tree.Sample():
            return unsupported.Sampling(item.span)
