"""Problems with equations (E5xx)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from hierc.compiler.suggest import abbreviated
from hierc.grammar.problems import Edit, Label, Problem
from hierc.grammar.source import Span


@dataclass(frozen=True)
class DefinedTwice(Problem):
    code = "E501"
    explanation = "A variable, and each element of a vector, has exactly one definition: one equation under `diff` or `alge`."
    name: str
    first: Span

    def title(self) -> str:
        return f"`{self.name}` is defined twice"

    def remark(self) -> str:
        return "defined again here"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.first, "first defined here"),)


@dataclass(frozen=True)
class NoDerivative(Problem):
    code = "E502"
    explanation = (
        "A variable with an initial value is a state: its derivative must be given under `diff`. A variable without an initial value is "
        "algebraic and is defined under `alge`."
    )
    name: str
    algebraic: bool = False  # whether it has an equation under `alge`

    def title(self) -> str:
        return f"`{self.name}` has an initial value but no derivative"

    def help(self) -> tuple[str, ...]:
        if self.algebraic:
            return ("drop the initial value: the equation under `alge` defines it at every moment",)
        return (
            f"add `{self.name}' = …;` under `diff`, or drop the initial value and define it under `alge`",
        )


@dataclass(frozen=True)
class NoInitialValue(Problem):
    code = "E503"
    explanation = "A variable with a derivative is a state and needs an initial value where it is declared."
    name: str
    declared: Span
    unit: str | None
    sizes: tuple[str, ...] = ()  # of a vector or matrix

    def title(self) -> str:
        return f"`{self.name}` has a derivative but no initial value"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.declared, "declared here"),)

    def help(self) -> tuple[str, ...]:
        return (f"add `{self._zero}` to the declaration of `{self.name}`",)

    def edits(self) -> tuple[Edit, ...]:
        file, end = self.declared.file, self.declared.stop
        unit = re.compile(r"\s*\[[^\[\]]*\]").match(file.text, end)
        place = Span(file, unit.end(), unit.end()) if unit else Span(file, end, end)
        return (Edit(place, f" {self._zero}"),)

    @property
    def _zero(self) -> str:
        if self.sizes:
            return f"= zeros({', '.join(self.sizes)})"
        return f"= 0 [{self.unit}]" if self.unit else "= 0"


@dataclass(frozen=True)
class NeverDefined(Problem):
    code = "E504"
    explanation = "A `write` or `private` variable without an initial value is algebraic: it needs an equation under `alge`."
    name: str

    def title(self) -> str:
        return f"`{self.name}` is never defined"

    def help(self) -> tuple[str, ...]:
        return (f"add `{self.name} = …;` under `alge`",)


@dataclass(frozen=True)
class CannotBeDefined(Problem):
    code = "E505"
    explanation = (
        "An agent defines its own `write` and `private` variables. A `read` variable is given by whoever uses the agent, so it has "
        "neither an equation nor an initial value here."
    )
    name: str
    kind: str  # `a `read` variable`, `a parameter`

    def title(self) -> str:
        return f"`{self.name}` is {self.kind} and cannot be defined here"


@dataclass(frozen=True)
class LoopStep:
    """`user` uses `used` at `span`."""

    user: str
    used: str
    span: Span


@dataclass(frozen=True)
class AlgebraicLoop(Problem):
    code = "E506"
    explanation = (
        "Algebraic variables, `let`s and derivatives are computed one after the other, so none may need its own value. Break the loop by "
        "solving for the variable by hand, or by making one of them a state with a (fast) derivative."
    )
    steps: tuple[LoopStep, ...]

    def title(self) -> str:
        parts = [f"`{s.user}` uses `{s.used}` (l. {s.span.line})" for s in self.steps]
        return f"algebraic loop: {', '.join(abbreviated(parts))}"

    def labels(self) -> tuple[Label, ...]:
        return _labels(self, self.steps, "uses")


@dataclass(frozen=True)
class InitialLoop(Problem):
    code = "E507"
    explanation = "Initial values are computed one after the other, so none may need its own value."
    steps: tuple[LoopStep, ...]

    def title(self) -> str:
        if len(self.steps) == 1:
            return f"the initial value of `{self.steps[0].user}` needs itself"
        names = [f"`{s.user}`" for s in self.steps]
        listing = f"{', '.join(names[:-1])} and {names[-1]}"
        path = " -> ".join([*abbreviated(names), names[0]])
        listing = (
            listing if len(names) == len(abbreviated(names)) else f"{names[0]} and {len(names) - 1} more"
        )
        return f"the initial values of {listing} need each other ({path})"

    def labels(self) -> tuple[Label, ...]:
        return _labels(self, self.steps, "starts from")


def _labels(problem: Problem, steps: Sequence[LoopStep], verb: str) -> tuple[Label, ...]:
    """A label at every place of a closed path; elements of an array share theirs."""
    by_place = {s.span: f"`{s.user}` {verb} `{s.used}`" for s in reversed(steps)}
    return tuple(Label(span, text) for span, text in reversed(by_place.items()) if span != problem.span)


@dataclass(frozen=True)
class NotAState(Problem):
    code = "E508"
    explanation = "`x'` is the right-hand side of the differential equation of `x`, so `x` must be a state: a variable under `diff`."
    name: str
    matrix: bool = False

    def title(self) -> str:
        return f"`{self.name}'` is used but `{self.name}` is not a state"

    def help(self) -> tuple[str, ...]:
        return (f"the transpose is written `transpose({self.name})`",) if self.matrix else ()


@dataclass(frozen=True)
class DerivativeOfRead(Problem):
    code = "E509"
    explanation = (
        "An agent does not know where its `read` variables come from, so it cannot take their derivatives. Whoever uses the agent can: "
        "read the derivative as a variable of its own."
    )
    name: str
    example: str | None  # what the read variable is bound to, where that is known

    def title(self) -> str:
        return f"`{self.name}'` is used but `{self.name}` is a `read` variable"

    def help(self) -> tuple[str, ...]:
        bound = f"{self.example}'" if self.example else "…'"
        return (
            f"add a `read` variable for the derivative, such as `{self.name}_rate`, and bind it: `{self.name}_rate := {bound}`",
        )


@dataclass(frozen=True)
class DerivativeInInitialValue(Problem):
    code = "E510"
    explanation = "Initial values may use parameters and other initial values, but no derivatives: these are not defined before the start."
    name: str
    used: str

    def title(self) -> str:
        return f"the initial value of `{self.name}` uses the derivative `{self.used}'`"
