"""Problems for what the language has and this version of the compiler does not: one code a construct, at its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from hierc.grammar.problems import Problem


@dataclass(frozen=True)
class NotSupported(Problem):
    """Base: `construct` is the subject of the sentence."""

    construct: ClassVar[str]

    def title(self) -> str:
        return f"{self.construct} not supported yet"


@dataclass(frozen=True)
class Modes(NotSupported):
    code = "E001"
    construct = "modes are"
    explanation = (
        "A model is compiled only if all of it can be run as written. Modes are part of the language but not of this version. What depends on time, "
        "parameters or indices can be chosen with `if … then … else …`; a contact can be a stiff spring."
    )


@dataclass(frozen=True)
class Transitions(NotSupported):
    code = "E002"
    construct = "transitions (`trans`) are"
    explanation = (
        "Guards, resets and changes of mode are part of the language but not of this version. A contact can be a stiff spring and damper, which the "
        "implicit methods integrate well: `force = if depth > 0 then k*depth else 0`."
    )


@dataclass(frozen=True)
class Sampling(NotSupported):
    code = "E003"
    construct = "`sample` blocks are"
    explanation = (
        "Sampled behaviour is part of the language but not of this version. Write the controller as a continuous one, in one level with its plant; "
        "where the delay of sampling matters, `std.blocks.PadeDelay` approximates it."
    )


@dataclass(frozen=True)
class DiscreteVariable(NotSupported):
    code = "E004"
    construct = "discrete variables are"
    explanation = (
        "Variables that change only at instants are part of the language but not of this version. What never changes during a run is a parameter "
        "or a constant."
    )


@dataclass(frozen=True)
class Invariants(NotSupported):
    """A warning: the block is checked for names and types, and has no effect."""

    code = "W010"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    construct = "invariants are checked for names and types only: watching them during a run is"
    explanation = "The conditions of an `inv` block must be correct expressions, but a run does not stop where one is violated yet."


@dataclass(frozen=True)
class Function(NotSupported):
    """A built-in function that needs what is not there yet."""

    code = "E011"
    explanation = "This setting, or this use of a function, is part of the language but not of this version."
    use: str

    def title(self) -> str:
        return f"{self.use} is not supported yet"


@dataclass(frozen=True)
class Jump(NotSupported):
    """A warning: the model runs, but a change shorter than a step may be missed."""

    code = "W013"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    construct = "locating jumps is"
    explanation = (
        "Where a right-hand side jumps, a run should stop exactly there and go on with the new side. This version integrates through the jump with small "
        "steps, which costs work, and may step over a change that is shorter than a step."
    )
    first: bool = True  # of its file: the others are said in short

    def title(self) -> str:
        return "this jumps during a run, and its moments are not located yet"

    def notes(self) -> tuple[str, ...]:
        return (
            ("the run steps through the jump where it meets it; one shorter than a step can be missed",)
            if self.first
            else ()
        )

    def help(self) -> tuple[str, ...]:
        return ("give the experiment a `max_step` shorter than the shortest piece",) if self.first else ()
