"""Problems of forms of CHARON and Modelica (E190 to E199). Wording only: `habits.py` decides which applies."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.grammar.problems import Edit, Problem, in_place_of


@dataclass(frozen=True)
class CharonDerivative(Problem):
    code = "E190"
    explanation = "CHARON writes `d(x) == v`; here a derivative is `x'`, equations use `=`, and they stand in `diff { … }`."

    variable: str

    def title(self) -> str:
        return f"`d({self.variable}) == …` is CHARON's form"

    def help(self) -> tuple[str, ...]:
        return (f"write `{self.variable}' = …;`",)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, f"{self.variable}' =")


@dataclass(frozen=True)
class CharonControlPoint(Problem):
    code = "E191"
    explanation = (
        "CHARON's modes have entry and exit points; here a mode is entered whole or at its `init` submode, and a `trans` from a mode "
        "leaves it from whatever submode it is in."
    )

    def title(self) -> str:
        return "`entry`/`exit` points are not part of hierc"

    def help(self) -> tuple[str, ...]:
        return ("use `init mode` and `trans from … to …`",)


@dataclass(frozen=True)
class ModelicaForm(Problem):
    code = "E192"
    explanation = (
        "Modelica's acausal connectors, classes and inheritance have no counterpart: data flow here has a direction, from `write` to `read` "
        "variables, and levels an order. Equations are solved for one variable, so that nothing has to be sorted or guessed."
    )

    word: str
    instead: str
    replacement: tuple[Edit, ...] = ()

    def title(self) -> str:
        return f"`{self.word}` is Modelica"

    def help(self) -> tuple[str, ...]:
        return (self.instead,)

    def edits(self) -> tuple[Edit, ...]:
        return self.replacement


@dataclass(frozen=True)
class CharonForm(Problem):
    code = "E193"
    explanation = "A variable is written by its own agent only, and agents are joined by couplings `[input := a.output]` where they are used."

    word: str
    instead: str

    def title(self) -> str:
        return f"`{self.word}` is CHARON's and not part of hierc"

    def help(self) -> tuple[str, ...]:
        return (self.instead,)
