"""Problems with units (E4xx)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.grammar.problems import Edit, Label, Problem, in_place_of
from hierc.grammar.source import Span

#: Longest text that a title quotes.
QUOTED = 60


@dataclass(frozen=True, slots=True)
class Side:
    """One of two things compared: the user's text, and the unit it is in (None: a plain number)."""

    span: Span
    text: str
    unit: str | None

    @property
    def state(self) -> str:
        """What it is: `in m/s`, `dimensionless`."""
        if self.unit is None:
            return "a plain number"
        return "dimensionless" if self.unit == "1" else f"in {self.unit}"

    def sentence(self) -> str:
        return f"{quoted(self.text)} is {self.state}"

    def label(self) -> Label:
        return Label(self.span, self.state)


def quoted(text: str) -> str:
    """The user's text on one line, shortened."""
    line = " ".join(text.split())
    return f"`{line if len(line) <= QUOTED else line[: QUOTED - 3] + '...'}`"


def _strictly(*sides: Side) -> tuple[str, ...]:
    """Advice where a plain number stands beside a unit."""
    units = [side.unit for side in sides if side.unit is not None]
    return tuple(
        f"with `--units=strict` only 0 goes without a unit: {with_unit(side.text, units[0])}"
        for side in sides
        if side.unit is None and units
    )


def with_unit(text: str, unit: str, *, literal: bool | None = None) -> str:
    """How to write a plain number in a unit."""
    plain = text.removeprefix("-").strip()
    simple = plain.replace(".", "", 1).isalnum() and plain[:1].isdigit() if literal is None else literal
    return f"write `{text} [{unit}]`" if simple else f"multiply by `1 [{unit}]`"


def _called(call: Span | None) -> tuple[Label, ...]:
    return () if call is None else (Label(call, "in this call"),)


@dataclass(frozen=True)
class UnitsDiffer(Problem):
    code = "E401"
    explanation = (
        "What is added, compared, chosen between or assigned is in the same unit. A number without a unit takes that of its neighbour, and "
        "a name declared without a unit fits everything. Different units of one dimension (mm and m) are converted and never differ."
    )
    text: str
    left: Side
    right: Side
    call: Span | None = None

    def title(self) -> str:
        return f"units differ in {quoted(self.text)}: {self.left.sentence()}, {self.right.sentence()}"

    def remark(self) -> str:
        return self.right.state if self.span == self.right.span else ""

    def labels(self) -> tuple[Label, ...]:
        right = () if self.span == self.right.span else (self.right.label(),)
        return (self.left.label(), *right, *_called(self.call))

    def help(self) -> tuple[str, ...]:
        return _strictly(self.left, self.right)


@dataclass(frozen=True)
class RateUnitsDiffer(Problem):
    code = "E402"
    explanation = "The derivative of a variable in m is in m/s: both sides of a differential equation are in the unit of the variable per second."
    text: str
    name: str
    declared: str
    rate: Side  # of the declared variable
    right: Side

    def title(self) -> str:
        return (
            f"{quoted(self.text)}: the derivative of `{self.name}` [{self.declared}] is {self.rate.state}, "
            f"but {self.right.sentence()}"
        )

    def remark(self) -> str:
        return self.right.state

    def labels(self) -> tuple[Label, ...]:
        return (self.rate.label(),)

    def help(self) -> tuple[str, ...]:
        return _strictly(self.rate, self.right)


@dataclass(frozen=True)
class ArgumentUnit(Problem):
    code = "E403"
    explanation = (
        "`sin`, `cos` and `tan` take an angle (rad is 1, deg is converted); `exp`, `log`, `floor`, the exponent of `^` and the like take a plain "
        "number or one in the unit 1; a function of yours takes what its parameters declare."
    )
    function: str  # with its backquotes
    wanted: str
    given: Side
    declared: Span | None = None
    call: Span | None = None

    def title(self) -> str:
        given = "a plain number" if self.given.unit is None else self.given.unit
        return f"{self.function} needs {self.wanted}, got {given}"

    def remark(self) -> str:
        return self.given.state

    def labels(self) -> tuple[Label, ...]:
        declared = () if self.declared is None else (Label(self.declared, "declared here"),)
        return (*declared, *_called(self.call))

    def help(self) -> tuple[str, ...]:
        if self.function in ("`sin`", "`cos`", "`tan`") and self.given.unit == "s":
            return ("multiply the time by a rate with its unit, as in `3 [rad/s]*time`",)
        return ()


@dataclass(frozen=True)
class CouplingUnits(Problem):
    code = "E405"
    explanation = "A coupling gives a `read` variable a value in its declared unit."
    text: str
    read: Side
    given: Side

    def title(self) -> str:
        return f"coupling {quoted(self.text)}: {self.read.sentence()}, {self.given.sentence()}"

    def remark(self) -> str:
        return self.given.state

    def labels(self) -> tuple[Label, ...]:
        return (self.read.label(),)

    def help(self) -> tuple[str, ...]:
        return _strictly(self.read, self.given)


@dataclass(frozen=True)
class PlainBesideUnit(Problem):
    code = "E406"
    explanation = (
        "Equations compute in SI, so a plain number beside a unit that is not SI's own could mean either: beside `te [ms]`, 0.5 may be meant "
        "in ms or in s. Give the number its unit."
    )
    text: str
    literal: bool
    name: str
    unit: str
    si: str
    neighbour: Span

    def title(self) -> str:
        number = quoted(self.text)
        inside = number.strip("`")
        other = inside if self.si == "1" else f"{inside} {self.si}"
        return f"{number} beside {quoted(self.name)} [{self.unit}]: {inside} {self.unit} or {other}?"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.neighbour, f"in {self.unit}"),)

    def help(self) -> tuple[str, ...]:
        return (with_unit(self.text, self.unit, literal=self.literal),)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, f"{self.text} [{self.unit}]") if self.literal else ()


@dataclass(frozen=True)
class UnknownUnit(Problem):
    code = "E404"
    explanation = (
        "Units are SI names with prefixes, joined by `*`, `/` and `^`: `N*m`, `kg*m^2`, `m/s^2`, `1/s`; also `1`, `%`, `deg`, `rpm`, "
        "`min`, `h`. There are no units with an offset, such as degC."
    )
    unit: str
    meant: str | None
    offset: bool = False

    def title(self) -> str:
        return f"unknown unit `{self.unit}`"

    def help(self) -> tuple[str, ...]:
        if self.offset:
            return ("there are no units with an offset: convert to K, as in `293.15 [K]` for 20 degC",)
        return (f"did you mean `{self.meant}`?",) if self.meant else ()

    def edits(self) -> tuple[Edit, ...]:
        in_brackets = self.span is not None and self.span.text.startswith("[")
        return in_place_of(self.span, f"[{self.meant}]") if self.meant and in_brackets else ()


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
