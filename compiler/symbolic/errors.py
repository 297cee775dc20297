"""Problems that are found only when a model's expressions are worked on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hierc.grammar.problems import Problem


@dataclass(frozen=True)
class OutOfRange(Problem):
    """Arithmetic on literals without a finite result."""

    code: ClassVar[str] = "E581"
    explanation: ClassVar[str] = (
        "Arithmetic on numbers is done when compiling, in double precision. Here it has no finite result: the value is above about 1.8e308,"
        " or the operation is not defined for these numbers (a division by zero, the root of a negative number)."
    )

    operation: str

    def title(self) -> str:
        """Quotes the operation."""
        return f"`{self.span.text}` has no finite value" if self.span else "a number has no finite value"

    def remark(self) -> str:
        """Names the operation."""
        return f"operation `{self.operation}` on these numbers"


@dataclass(frozen=True)
class TooLarge(Problem):
    """A phase made more of a model than a sensible computation needs."""

    code: ClassVar[str] = "E582"
    explanation: ClassVar[str] = (
        "Derivatives and branches can grow faster than the model. A phase stops at a limit rather than run for hours."
        " Name common parts with `let`, use fewer conditions inside conditions, or split the agent."
    )

    phase: str
    limit: int

    def title(self) -> str:
        """Names the phase and its limit."""
        return f"the {self.phase} phase needs more than {self.limit} operations here"

    def help(self) -> tuple[str, ...]:
        """How to make the model smaller."""
        return ("split this agent, or use fewer conditions inside conditions",)


@dataclass(frozen=True)
class TooDeep(Problem):
    """Conditions inside conditions inside conditions."""

    code: ClassVar[str] = "E583"
    explanation: ClassVar[str] = (
        "A value is chosen by an `if` inside an `if`, and so on, deeper than the generated code may nest."
        " Conditions count through `let`s: what is used in one branch only is evaluated in that branch only."
    )

    limit: int

    def title(self) -> str:
        """Names the limit."""
        return f"conditions are nested more than {self.limit} deep"
