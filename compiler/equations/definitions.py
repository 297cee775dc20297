"""Equations: every variable has exactly one kind of definition, in the level it is declared in.

In: a `Library` with right names. Checked for every agent by the text alone (E501 to E505, E605, E607); single elements of vectors are checked
where sizes are known, in `flatten.py`.
"""

from __future__ import annotations

from collections.abc import Iterator

from hierc.compiler.arrays.errors import IndexAssigned
from hierc.compiler.cascade.errors import OutsideLevels, TwoLevels
from hierc.compiler.collector import Collector
from hierc.compiler.equations.errors import (
    CannotBeDefined,
    DefinedTwice,
    NeverDefined,
    NoDerivative,
    NoInitialValue,
)
from hierc.compiler.resolve.declarations import Agent, Equation, Library, Variable
from hierc.compiler.resolve.errors import UnknownName
from hierc.grammar.source import Span


def check_equations(library: Library, problems: Collector) -> None:
    """Check the equations of every agent."""
    for agent in library.agents.values():
        _AgentEquations(agent, problems).check()


class _AgentEquations:
    """Checks one agent."""

    def __init__(self, agent: Agent, problems: Collector) -> None:
        self._agent = agent
        self._problems = problems

    def check(self) -> None:
        by_target: dict[str, list[Equation]] = {}
        for equation in self._agent.equations:
            name = equation.equation.target.name.text
            if self._is_variable(equation, name):
                by_target.setdefault(name, []).append(equation)
        for variable in self._agent.variables.values():
            if variable.decl.access == "read":
                self._read(variable)
            else:
                self._defined(variable, by_target.get(variable.name, []))
        if self._agent.levels:
            self._levels()

    def _is_variable(self, equation: Equation, name: str) -> bool:
        """Whether the target can be defined here; reports it if not."""
        agent, target = self._agent, equation.equation.target
        variable = agent.variables.get(name)
        if variable is not None and variable.decl.access != "read":
            return True
        kinds = (
            (agent.params, "a parameter"),
            (agent.consts, "a constant"),
            (agent.lets, "a `let`"),
            (agent.subs, "an agent"),
            (agent.variables, "a `read` variable"),
        )
        kind = next((kind for names, kind in kinds if name in names), None)
        if kind is None and equation.over is not None and equation.over.index.text == name:
            self._problems.add(IndexAssigned(target.name.span, name=name))
        elif kind is None:
            candidates = tuple(v for v in agent.variables if v not in agent.reads())
            where = f"agent `{agent.name}`"
            self._problems.add(UnknownName(target.name.span, name=name, where=where, candidates=candidates))
        else:
            self._problems.add(CannotBeDefined(target.span, name=name, kind=kind))
        return False

    def _read(self, variable: Variable) -> None:
        if variable.declarator.initial is not None:
            self._problems.add(CannotBeDefined(variable.span, name=variable.name, kind="a `read` variable"))

    def _defined(self, variable: Variable, equations: list[Equation]) -> None:
        """A variable with an initial value has derivatives only, one without has `alge` equations only."""
        state = variable.declarator.initial is not None
        name = variable.name
        whole = [e for e in equations if not e.equation.target.subs and e.over is None]
        kinds = {e.kind for e in equations}
        if len(kinds) == 2 or len(whole) > 1 or (whole and len(equations) > 1):
            first, second = equations[0].equation.target.span, equations[1].equation.target.span
            self._problems.add(DefinedTwice(second, name=name, first=first))
        elif state and "diff" not in kinds:
            self._problems.add(NoDerivative(variable.span, name=name, algebraic=bool(equations)))
        elif not state and "diff" in kinds:
            unit = variable.declarator.unit.text if variable.declarator.unit else None
            where = equations[0].equation.target.span
            sizes = tuple(size.span.text for size in variable.decl.type.sizes)
            self._problems.add(
                NoInitialValue(where, name=name, declared=variable.span, unit=unit, sizes=sizes)
            )
        elif not state and not equations:
            self._problems.add(NeverDefined(variable.span, name=name))
        for equation in equations:
            self._same_level(variable, equation)

    def _same_level(self, variable: Variable, equation: Equation) -> None:
        if variable.level != equation.level and not self._is_outside(equation):
            span = equation.equation.target.span
            declared, defined = _place(variable.level), _place(equation.level)
            self._problems.add(
                TwoLevels(
                    span, name=variable.name, declared=declared, defined=defined, declared_span=variable.span
                )
            )

    def _is_outside(self, equation: Equation) -> bool:
        """Whether E605 is reported for it already."""
        return equation.kind == "diff" and equation.level in self._agent.divided()

    def _levels(self) -> None:
        """What is divided into levels, an agent or a level of it, keeps everything but observers in them."""
        for span, what, level in _outside(self._agent):
            self._problems.add(OutsideLevels(span, agent=self._agent.name, level=level, what=what))


def _outside(agent: Agent) -> Iterator[tuple[Span, str, str | None]]:
    """What stands beside levels and may not, and the level it stands in."""
    divided = agent.divided()
    for variable in agent.variables.values():
        state = variable.decl.access != "read" and variable.declarator.initial is not None
        if state and variable.level in divided:
            yield variable.span, "a state of its own", variable.level
    for equation in agent.equations:
        if equation.kind == "diff" and equation.level in divided:
            yield equation.equation.target.span, "a `diff` of its own", equation.level
    for sub in agent.subs.values():
        if sub.level in divided:
            yield sub.instance.name.span, "an agent", sub.level


def _place(level: str | None) -> str:
    return f"level `{level}`" if level is not None else "no level"
