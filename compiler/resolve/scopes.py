"""Scopes of names: what a reference may name in a file, in a function and in an agent. Part of the phase `names.py`.

A scope checks expressions: every problem goes to the collector, and nothing is returned.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence

from hierc.compiler import unsupported
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.resolve.declarations import Agent, Library, Variable
from hierc.compiler.resolve.errors import (
    NestedTooDeeply,
    NotAConstant,
    NotAValue,
    NotVisible,
    Shadowed,
    TooDeep,
    UnknownFunction,
    UnknownName,
)  # fmt: skip
from hierc.compiler.shapes.functions import BUILT_IN_FUNCTIONS, LATER_FUNCTIONS
from hierc.compiler.units.units import literal_in_si
from hierc.compiler.walk import Visit, visit
from hierc.grammar import tree
from hierc.grammar.problems import Edit, closest
from hierc.grammar.source import Span

#: Deepest nesting of an expression; later phases recurse, and rely on it.
MAX_DEPTH = 100

#: What a derivative is called elsewhere.
DERIVATIVES = ("der", "d", "ddt")

#: Values that every scope has.
BUILT_IN_VALUES = ("pi",)


class FileScope:
    """Names of the file and built-in ones; checks expressions in it. `place` is what is being written, for messages."""

    def __init__(self, library: Library, problems: Collector, where: str, place: str) -> None:
        self.library = library
        self.problems = problems
        self.where = where
        self.place = place
        self.timeless = True

    def candidates(self) -> tuple[str, ...]:
        """Names that could have been meant."""
        return (*self.library.consts, *BUILT_IN_VALUES)

    def check_all(self, exprs: Iterable[tree.Expr], bound: frozenset[str] = frozenset()) -> None:
        for expr in exprs:
            self.check(expr, bound)

    def check(self, expr: tree.Expr, bound: frozenset[str] = frozenset()) -> None:
        """Report everything that is wrong with the names in `expr`."""
        for here in visit(expr, bound):
            if here.depth > MAX_DEPTH:
                self.problems.add(NestedTooDeeply(here.node.span, what="expression", limit=MAX_DEPTH))
                return
            self._node(here)

    def _node(self, here: Visit) -> None:
        match here.node:
            case tree.Ref():
                self._reference(here.node, here.bound)
            case tree.Call():
                self._call(here.node)
            case tree.Time() if self.timeless:
                self.problems.add(
                    NotAConstant(here.node.span, name="`time`", kind="the time", place=self.place)
                )
            case tree.Comprehension(over=over):
                self.check_shadowing(over.index)
            case tree.Number() if here.node.unit is not None:
                self._literal(here.node)
            case _:
                pass

    def _literal(self, number: tree.Number) -> None:
        try:
            literal_in_si(number)
        except Rejected as rejection:
            self.problems.rejected(rejection)

    def _call(self, call: tree.Call) -> None:
        name = call.function.text
        if name in LATER_FUNCTIONS:
            self.problems.add(unsupported.Function(call.function.span, use=f"`{name}`"))
        elif (outside := self.library.signature(name)) is not None:
            if self.place == "a constant":
                kind = "a table" if isinstance(outside, tree.Table) else "an external function"
                self.problems.add(NotAConstant(call.span, name=f"`{name}`", kind=kind, place=self.place))
        elif name not in self.library.funcs and name not in BUILT_IN_FUNCTIONS:
            names, module = (*self.library.functions(), *BUILT_IN_FUNCTIONS), self.library.elsewhere.get(name)
            self.problems.add(
                UnknownFunction(
                    call.function.span, name=name, candidates=names, module=module, instead=_derivative(call)
                )
            )

    def _reference(self, ref: tree.Ref, bound: frozenset[str]) -> None:
        name = ref.path.steps[0].name.text
        if name not in bound:
            self.resolve(ref, name)
        elif len(ref.path.steps) > 1:
            self.unknown(ref.path, name)

    def resolve(self, ref: tree.Ref, name: str) -> None:
        """Check that the path of `ref`, which starts with `name`, is visible here."""
        text = ref.path.text
        known = text in self.library.consts or text in BUILT_IN_VALUES
        if known and not any(step.subs for step in ref.path.steps[:-1]):
            return
        kinds: tuple[tuple[Container[str], str], ...] = (
            (self.library.functions(), "a function"), (self.library.agents, "an agent"),
            (self.library.experiments, "an experiment"), (self.library.modules, "an imported file"),
        )  # fmt: skip
        for names, kind in kinds:
            found = next((n for n in (text, name) if n in names), None)
            if found is not None and (found == text or kind != "an imported file"):
                self.problems.add(NotAValue(ref.span, name=found, kind=kind))
                return
        self.unknown(ref.path, name)

    def unknown(self, path: tree.Path, name: str) -> None:
        qualified = any(path.text.startswith(f"{module}.") for module in self.library.modules)
        wrong = path.text if qualified or name in self.candidates() else name
        self.misspelt(wrong)
        self.problems.add(UnknownName(path.span, name=wrong, where=self.where, candidates=self.candidates()))

    def misspelt(self, name: str) -> None:
        """Take note of an unknown name."""

    def check_shadowing(self, name: tree.Name, *, file_level: bool = False) -> None:
        if name.text in BUILT_IN_VALUES:
            self.problems.add(Shadowed(name.span, name=name.text, outer="the built-in constant"))
        elif not file_level and name.text in self.library.consts:
            self.problems.add(Shadowed(name.span, name=name.text, outer="the constant of the file"))


def _derivative(call: tree.Call) -> Edit | None:
    """`x'` for `der(x)` and its like."""
    match call:
        case tree.Call(args=(tree.Ref(prime=False) as ref,)) if call.function.text in DERIVATIVES:
            return Edit(call.span, f"{ref.span.text}'")
        case _:
            return None


class FunctionScope(FileScope):
    """A function's parameters and the sizes they bind, then the file."""

    def __init__(self, library: Library, problems: Collector, func: tree.Func, names: frozenset[str]) -> None:
        super().__init__(library, problems, f"function `{func.name.text}`", "a function")
        self._names = names

    def candidates(self) -> tuple[str, ...]:
        return (*sorted(self._names), *super().candidates())

    def resolve(self, ref: tree.Ref, name: str) -> None:
        if name not in self._names:
            super().resolve(ref, name)
        elif len(ref.path.steps) > 1:
            self.unknown(ref.path, name)


class AgentScope(FileScope):
    """The names of an agent, then the file. `values`: parameters and constants that may be used; `all_names`: variables and sub-agents too."""

    def __init__(
        self, library: Library, problems: Collector, agent: Agent, place: str, params: Iterable[str],
        lets: Iterable[str], *, all_names: bool,
    ) -> None:  # fmt: skip
        super().__init__(library, problems, f"agent `{agent.name}`", place)
        self._agent = agent
        self._params = frozenset(params)
        self._lets = frozenset(lets)
        self._all_names = all_names
        self.timeless = not all_names
        self.used: set[str] = set()

    def candidates(self) -> tuple[str, ...]:
        agent = self._agent
        own = (
            (*agent.consts, *agent.lets, *agent.variables, *agent.subs)
            if self._all_names
            else (*agent.consts, *agent.lets)
        )
        return (*sorted(self._params), *own, *super().candidates())

    def misspelt(self, name: str) -> None:
        """What is meant is used, so that no warning says otherwise."""
        if meant := closest(name, self.candidates()):
            self.used.add(meant)

    def resolve(self, ref: tree.Ref, name: str) -> None:
        agent = self._agent
        steps = ref.path.steps
        self.used.add(name)
        if name in agent.subs:
            self._sub_agent(ref, name)
        elif len(steps) > 1:
            self._qualified(ref, name)
        elif name in agent.params:
            if name not in self._params:
                self._not_constant(ref, "a parameter" if self.place == "a constant" else "a later parameter")
        elif name in agent.variables:
            if not self._all_names:
                self._not_constant(ref, "a variable")
        elif name in agent.lets:
            if name not in self._lets:
                self._not_constant(ref, "a `let` of variables" if self._params else "a `let`")
        elif name not in agent.consts:
            super().resolve(ref, name)

    def _qualified(self, ref: tree.Ref, name: str) -> None:
        """A path that starts with no sub-agent: something of an imported file, unless the agent has that name for something else."""
        if name in self._agent.levels and ref.path.text not in self.library.consts:
            where, shorter = self.where, without_step(ref.path, name)
            self.problems.add(
                UnknownName(ref.path.span, name=ref.path.text, where=where, candidates=(), shorter=shorter)
            )
        elif name in self._agent.names():
            self.unknown(ref.path, name)
        else:
            super().resolve(ref, name)

    def _not_constant(self, ref: tree.Ref, kind: str) -> None:
        self.problems.add(NotAConstant(ref.span, name=f"`{ref.path.text}`", kind=kind, place=self.place))

    def _sub_agent(self, ref: tree.Ref, name: str) -> None:
        """A path `sub.variable`: it must be a `write` variable."""
        steps = ref.path.steps
        inner = self.library.agents.get(self._agent.subs[name].instance.agent.text)
        if len(steps) == 1:
            self.problems.add(NotAValue(ref.span, name=name, kind="an agent"))
        elif not self._all_names:
            self._not_constant(ref, "a variable")
        elif inner is None:
            pass  # the instance is reported
        elif len(steps) == 2 and steps[1].name.text not in inner.subs:
            self._visible(ref, steps[1].name.text, inner)
        else:
            self._beyond(ref, inner)

    def _beyond(self, ref: tree.Ref, inner: Agent) -> None:
        """A path through the sub-agent `inner` into what that contains. What would be wrong with it even from nearby comes first."""
        names = [step.name.text for step in ref.path.steps]
        through = [inner]
        for name in names[1:-1]:
            if name not in through[-1].subs:
                self._visible(ref, name, through[-1])
                return
            next_ = self._contained(through[-1], name)
            if next_ is None:
                self.problems.add(TooDeep(ref.path.span, path=ref.path.text, owner=names[0]))
                return
            through.append(next_)
        owner, last = through[-1], names[-1]
        variable = owner.variables.get(last)
        if last in owner.subs:
            self.problems.add(NotAValue(ref.span, name=ref.path.text, kind="an agent"))
        elif variable is None or variable.decl.access != "write":
            self._visible(ref, last, owner)
        else:
            advice = _passed_on(names, through[:-1], variable, rate=ref.prime)
            self.problems.add(TooDeep(ref.path.span, path=ref.path.text, owner=names[0], advice=advice))

    def _contained(self, agent: Agent, name: str) -> Agent | None:
        """A sub-agent's definition, where it can be seen from here: other files have names of their own."""
        if agent.definition.span.file is not self._agent.definition.span.file:
            return None
        return self.library.agents.get(agent.subs[name].instance.agent.text)

    def _visible(self, ref: tree.Ref, name: str, inner: Agent) -> None:
        variable = inner.variables.get(name)
        if variable is not None and variable.decl.access == "write":
            return
        found = _declared(inner, name)
        if found is None:
            where, candidates = f"agent `{inner.name}`", (*inner.writes(), *inner.subs)
            shorter = without_step(ref.path, name) if name in inner.levels else None
            self.problems.add(
                UnknownName(ref.path.span, name=name, where=where, candidates=candidates, shorter=shorter)
            )
        else:
            kind, span = found
            self.problems.add(
                NotVisible(ref.path.span, agent=inner.name, name=name, kind=kind, declared=span)
            )


def _passed_on(
    names: Sequence[str], through: Sequence[Agent], variable: Variable, *, rate: bool
) -> tuple[str, ...]:
    """What to write so that `variable`, by the path `names`, can be read: a variable of its own in each agent on the way, innermost first."""
    unit = f" [{variable.declarator.unit.text}]" if variable.declarator.unit and not rate else ""
    name, below = names[-1] + "_rate" * rate, ".".join(names[-2:]) + "'" * rate
    advice: list[str] = []
    for agent, holder, inner in zip(
        reversed(through), reversed(names[:-2]), reversed(names[1:-1]), strict=True
    ):
        name = f"{inner}_{name}" if name in agent.names() else name
        declared = f"write {variable.decl.type.span.text} {name}{unit}; alge {{ {name} = {below}; }}"
        advice.append(f"add to `{agent.name}`: `{declared}`")
        below = f"{holder}.{name}"
    return (*advice, f"and write `{below}` here")


def without_step(path: tree.Path, name: str) -> str:
    """The text of a path without the first step of this name."""
    names = [step.name.text for step in path.steps]
    names.remove(name)
    return ".".join(names)


def _declared(agent: Agent, name: str) -> tuple[str, Span] | None:
    """What `name` is in `agent`, and where."""
    if name in agent.variables:
        variable = agent.variables[name]
        return ("private" if variable.decl.access == "private" else "a read variable"), variable.span
    if name in agent.lets:
        return "private", agent.lets[name].let.name.span
    if name in agent.params:
        return "a parameter", agent.params[name].name.span
    if name in agent.consts:
        return "a constant", agent.consts[name].name.span
    return None
