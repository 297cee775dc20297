"""Problems with names, instances and their couplings (E2xx)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from hierc.compiler.suggest import (
    did_you_mean,
    did_you_mean_without,
    edits_of,
    import_edits,
    import_line,
    listed,
    respelt,
)
from hierc.grammar.problems import Edit, Label, Problem
from hierc.grammar.source import Span


@dataclass(frozen=True)
class UnknownName(Problem):
    code = "E201"
    explanation = (
        "A name must be declared in the agent that uses it (parameter, constant, variable, `let`, sub-agent, index), in the file, or be "
        "built in. Nothing of the surrounding agent is visible inside an agent: bring it in by a parameter or a `read` variable."
    )
    name: str
    where: str
    candidates: tuple[str, ...]
    shorter: str | None = None  # what the path is without the name of a level

    def title(self) -> str:
        return f"unknown name `{self.name}` in {self.where}"

    def help(self) -> tuple[str, ...]:
        if self.shorter is not None:
            return (did_you_mean_without(self.shorter),)
        time = ("the time is written `time`",) if self.name == "t" else ()
        return (*time, *did_you_mean(self.name, self.candidates))

    def edits(self) -> tuple[Edit, ...]:
        if self.shorter is not None:
            return respelt(self.span, self.name, self.shorter)
        return (
            respelt(self.span, "t", "time")
            if self.name == "t"
            else edits_of(self.span, self.name, self.candidates)
        )


@dataclass(frozen=True)
class DeclaredTwice(Problem):
    code = "E202"
    explanation = "In one scope every name stands for one thing. Levels open no scope of their own."
    name: str
    first: Span

    def title(self) -> str:
        return f"`{self.name}` is declared twice"

    def remark(self) -> str:
        return "declared again here"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.first, "first declared here"),)


@dataclass(frozen=True)
class MissingCoupling(Problem):
    code = "E203"
    explanation = "Every `read` variable of an agent is given exactly one value where the agent is used."
    agent: str
    read: str
    declared: Span
    by_experiment: bool

    def title(self) -> str:
        return f"agent `{self.agent}` needs a value for `{self.read}`"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.declared, f"`{self.read}` is declared here"),)

    def help(self) -> tuple[str, ...]:
        if self.by_experiment:
            return (f"bind it in an experiment: `experiment run of {self.agent}() [{self.read} := …] {{ }}`",)
        return (f"add `{self.read} := …`",)


@dataclass(frozen=True)
class NoSuchRead(Problem):
    code = "E204"
    explanation = "A coupling `[r := …]` gives a value to a `read` variable of the agent it follows."
    agent: str
    name: str
    reads: tuple[str, ...]
    kind: Literal["parameter", "write", "other"] = "other"  # what the name is in that agent

    def title(self) -> str:
        listing = f"; it reads: {listed(self.reads)}" if self.reads else "; it reads nothing"
        return f"`{self.agent}` has no read variable `{self.name}`{listing}"

    def help(self) -> tuple[str, ...]:
        if self.kind == "parameter":
            return (f"`{self.name}` is a parameter: `{self.agent}({self.name} = …)`",)
        if self.kind == "write":
            return (f"`{self.name}` is what `{self.agent}` computes; a coupling gives it what it reads",)
        return did_you_mean(self.name, self.reads)

    def edits(self) -> tuple[Edit, ...]:
        return edits_of(self.span, self.name, self.reads) if self.kind == "other" else ()


@dataclass(frozen=True)
class NotVisible(Problem):
    code = "E205"
    explanation = "From outside an agent only its `write` variables are visible."
    agent: str
    name: str
    kind: str  # `private`, `a read variable`, `a parameter`, …
    declared: Span

    def title(self) -> str:
        return (
            f"`{self.name}` is {self.kind} of `{self.agent}`" if self.kind != "private" else self._private()
        )

    def _private(self) -> str:
        return f"`{self.name}` is private to `{self.agent}`"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.declared, "declared here"),)

    def help(self) -> tuple[str, ...]:
        if self.kind == "a read variable":
            return (f"use what the coupling `{self.name} := …` gives it",)
        return ("declare it `write` to use it outside",) if self.kind == "private" else ()


@dataclass(frozen=True)
class UnknownParameter(Problem):
    code = "E206"
    explanation = "Arguments name parameters of the agent (or function) they are given to; a parameter without a default needs one."
    agent: str | None  # None for the model, whose parameters are given by path
    name: str
    candidates: tuple[str, ...]
    missing: bool = False
    advice: str | None = None  # instead of the usual one

    def title(self) -> str:
        if self.missing:
            return f"parameter `{self.name}` of `{self.agent}` has no default and no value"
        owner = "the model" if self.agent is None else f"`{self.agent}`"
        return f"{owner} has no parameter `{self.name}`"

    def help(self) -> tuple[str, ...]:
        if self.advice:
            return (self.advice,)
        return (f"add `{self.name} = …`",) if self.missing else did_you_mean(self.name, self.candidates)

    def edits(self) -> tuple[Edit, ...]:
        return () if self.advice or self.missing else edits_of(self.span, self.name, self.candidates)


@dataclass(frozen=True)
class UnknownAgent(Problem):
    code = "E207"
    explanation = "The agent named here is defined neither in this file nor imported."
    name: str
    candidates: tuple[str, ...]
    module: str | None = None  # that defines it and could be imported

    def title(self) -> str:
        return f"unknown agent `{self.name}`"

    def help(self) -> tuple[str, ...]:
        return import_line(self.name, self.module) or did_you_mean(self.name, self.candidates)

    def edits(self) -> tuple[Edit, ...]:
        return import_edits(self.span, self.name, self.module) or edits_of(
            self.span, self.name, self.candidates
        )


@dataclass(frozen=True)
class RecursiveDefinition(Problem):
    code = "E208"
    explanation = "An agent cannot contain itself, a function cannot call itself, and a constant cannot need its own value."
    kind: Literal["agent", "func", "const"]
    cycle: tuple[str, ...]  # first and last are the same

    def title(self) -> str:
        verb = {"agent": "contains itself", "func": "calls itself", "const": "needs its own value"}[self.kind]
        noun = {"agent": "agent", "func": "function", "const": "constant"}[self.kind]
        return f"{noun} `{self.cycle[0]}` {verb} ({' -> '.join(f'`{name}`' for name in self.cycle)})"


@dataclass(frozen=True)
class NotAConstant(Problem):
    """A name that changes during a run, or is not known yet, where only earlier fixed values may stand."""

    code = "E209"
    explanation = (
        "A `const` is made of constants. Arguments, defaults of parameters and sizes are made of constants and parameters; a default may "
        "use the parameters that stand before it."
    )
    name: str
    kind: str  # `a variable`, `the time`, `a parameter`, …
    place: str  # `a constant`, `an argument`, …

    def title(self) -> str:
        return f"{self.name} is {self.kind} and cannot be used in {self.place}"


@dataclass(frozen=True)
class TooDeep(Problem):
    """A path that looks into an agent inside an agent."""

    code = "E210"
    explanation = "Couplings reach one level deep: an agent may use `write` variables of its own sub-agents, not of what those contain."
    path: str
    owner: str
    advice: tuple[str, ...] = ()  # how to pass the variable on, where that is known

    def title(self) -> str:
        return f"`{self.path}` reaches into `{self.owner}`: only its own `write` variables are visible"

    def help(self) -> tuple[str, ...]:
        return self.advice or (f"give `{self.owner}` a `write` variable of its own for it",)


@dataclass(frozen=True)
class NotAValue(Problem):
    code = "E211"
    explanation = "An expression is made of values: an agent, a function or an experiment has none. Name a variable of the agent."
    name: str
    kind: str  # `an agent`, `a function`

    def title(self) -> str:
        return f"`{self.name}` is {self.kind}, not a value"


@dataclass(frozen=True)
class Shadowed(Problem):
    code = "W212"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    explanation = "A name of the agent hides one of the file or a built-in one. Inside the agent the nearer one is meant."
    name: str
    outer: str  # `the built-in constant`, `the constant of the file`, …

    def title(self) -> str:
        return f"`{self.name}` hides {self.outer} of the same name"


@dataclass(frozen=True)
class UnknownFunction(Problem):
    code = "E213"
    explanation = "The function is neither defined in this file, nor imported, nor built in."
    name: str
    candidates: tuple[str, ...]
    module: str | None = None  # that defines it and could be imported
    instead: Edit | None = None  # what the call is in this language

    def title(self) -> str:
        return f"unknown function `{self.name}`"

    def help(self) -> tuple[str, ...]:
        if self.instead is not None:
            return (f"write `{self.instead.text}`",)
        return import_line(self.name, self.module) or did_you_mean(self.name, self.candidates)

    def edits(self) -> tuple[Edit, ...]:
        if self.instead is not None:
            return (self.instead,)
        return import_edits(self.span, self.name, self.module) or edits_of(
            self.span, self.name, self.candidates
        )


@dataclass(frozen=True)
class GivenTwice(Problem):
    code = "E214"
    explanation = "An argument, a coupling, a setting or an initial value is given once."
    name: str
    first: Span

    def title(self) -> str:
        return f"`{self.name}` is given twice"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.first, "first given here"),)


@dataclass(frozen=True)
class TooManyInstances(Problem):
    code = "E215"
    explanation = "Agents inside agents multiply. They are counted before the model is built, so that a slip cannot fill the memory."
    agent: str
    count: int
    limit: int
    product: str | None = None  # how many elements an array has, where it is one

    def title(self) -> str:
        if self.product is not None:
            return f"array `{self.agent}` of {self.product} agents brings the model to {self.count}; the limit is {self.limit}"
        return f"`{self.agent}` would contain {self.count} agents; the limit is {self.limit}"


@dataclass(frozen=True)
class NestedTooDeeply(Problem):
    code = "E216"
    explanation = "Nesting of expressions and of agents is limited, so that no model can exhaust the stack. Name parts with `let`."
    what: str
    limit: int

    def title(self) -> str:
        return f"{self.what} nested more than {self.limit} deep"


@dataclass(frozen=True)
class ModelTooLarge(Problem):
    code = "E217"
    explanation = (
        "Sizes and expressions are counted while the model is built, so that a slip cannot fill the memory."
    )
    what: str
    limit: int

    def title(self) -> str:
        return f"{self.what}: the limit is {self.limit}"


@dataclass(frozen=True)
class Unused(Problem):
    code = "W511"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    explanation = (
        "A `let` or a private variable that nothing in its agent uses has no effect; often a name is misspelt elsewhere. A private variable that is "
        "there for the results alone is recorded by an experiment."
    )
    name: str
    private: bool  # a variable, not a `let`

    def title(self) -> str:
        return f"`{self.name}` is never used"

    def help(self) -> tuple[str, ...]:
        return ("if it is for the results alone, `record` it in an experiment",) if self.private else ()
