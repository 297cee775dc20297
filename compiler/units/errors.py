"""Problems with units (E4xx)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.grammar.problems import Problem


@dataclass(frozen=True)
class UnknownUnit(Problem):
    code = "E404"
    explanation = (
        "Units are SI names with prefixes, joined by `*`, `/` and `^`: `N*m`, `kg*m^2`, `m/s^2`, `1/s`; also `1`, `%`, `deg`, `rpm`, "
        "`min`, `h`. There are no units with an offset, such as degC."
    )
    unit: str
    meant: str | None

    def title(self) -> str:
        return f"unknown unit `{self.unit}`"

    def help(self) -> tuple[str, ...]:
        return (f"did you mean `{self.meant}`?",) if self.meant else ()


@dataclass(frozen=True)
class NewtonTrap(Problem):
    code = "E407"
    explanation = (
        "Brackets after a name hold a unit, so `real x[N]` declares one number in newtons. The size of an array stands after the type: "
        "`real[N] x`."
    )
    name: str
    unit: str

    def title(self) -> str:
        return f"`real {self.name}[{self.unit}]` declares one number in the unit {self.unit}, but `{self.unit}` is also an integer here"

    def help(self) -> tuple[str, ...]:
        return (f"an array is written `real[{self.unit}] {self.name}`",)


@dataclass(frozen=True)
class LiteralOutOfRange(Problem):
    code = "E408"
    explanation = "Values are doubles in SI units: their magnitude must be below about 1.8e308."
    text: str

    def title(self) -> str:
        return f"`{self.text}` is too large a number in SI units"
