"""Problems with types and shapes (E3xx)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.grammar.problems import Label, Problem
from hierc.grammar.source import Span


@dataclass(frozen=True)
class OperandsDiffer(Problem):
    code = "E301"
    explanation = (
        "`+` and `-` want equal shapes; `*` takes a scalar and anything, or a matrix and a matrix or vector that fits; `/` divides by a "
        "scalar; `.*` and `./` work element by element on equal shapes; `^` takes scalars. Nothing is transposed silently: a vector is a column."
    )
    verb: str
    left: str
    right: str
    text: str
    left_span: Span
    right_span: Span
    advice: str | None = None

    def title(self) -> str:
        return f"cannot {self.verb} `{self.left}` and `{self.right}` in `{self.text}`"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.left_span, f"`{self.left}`"), Label(self.right_span, f"`{self.right}`"))

    def help(self) -> tuple[str, ...]:
        return (self.advice,) if self.advice else ()


@dataclass(frozen=True)
class TypeDiffers(Problem):
    code = "E302"
    explanation = "Both sides of an equation, coupling or declaration have the same shape; an `int` may be given where a `real` is wanted."
    subject: str  # `p'`, `argument l`
    wanted: str
    given: str
    instead: tuple[str, ...] = ()  # texts of the wanted type
    other: str = "the right-hand side"

    def title(self) -> str:
        return f"{self.subject} is `{self.wanted}` but {self.other} is `{self.given}`"

    def help(self) -> tuple[str, ...]:
        return (f"write {' or '.join(f'`{text}`' for text in self.instead)}",) if self.instead else ()


@dataclass(frozen=True)
class IndexOutside(Problem):
    code = "E303"
    explanation = "Indices start at 1 and end at the size that was declared. Every dimension of a variable has its own index."
    name: str
    sizes: tuple[int, ...]
    index: str
    axis: int

    def title(self) -> str:
        if len(self.sizes) == 1:
            return f"index {self.index} is outside `{self.name}`, which has {self.sizes[0]} elements"
        return f"index {self.index} is outside dimension {self.axis} of `{self.name}`, which has {self.sizes[self.axis - 1]} elements"


@dataclass(frozen=True)
class NotACondition(Problem):
    code = "E304"
    explanation = "Conditions are comparisons, boolean variables and parameters, and what `and`, `or` and `not` make of them."
    text: str
    type: str

    def title(self) -> str:
        return f"a condition must be `bool`; `{self.text}` is `{self.type}`"


@dataclass(frozen=True)
class NotAKnownInteger(Problem):
    code = "E305"
    explanation = (
        "Sizes, indices and ranges are integers known when compiling: made of literals, index names, constants and `int` parameters. "
        "`/` gives a real; `div` divides integers."
    )
    what: str  # `array size`, `index`, `end of a range`
    text: str
    positive: bool = False
    negative: bool = False  # it is known, and below zero

    def title(self) -> str:
        if self.negative:
            return f"{self.what} `{self.text}` is below 0"
        wanted = "a positive integer" if self.positive else "an integer known when compiling"
        return f"{self.what} `{self.text}` is not {wanted}"


@dataclass(frozen=True)
class WrongArguments(Problem):
    code = "E306"
    explanation = (
        "Every function takes arguments of certain types and shapes; the language reference lists them."
    )
    function: str
    wanted: str
    given: tuple[str, ...]
    advice: str | None = None

    def title(self) -> str:
        given = ", ".join(f"`{g}`" for g in self.given) or "nothing"
        return f"`{self.function}` takes {self.wanted}, got {given}"

    def help(self) -> tuple[str, ...]:
        return (self.advice,) if self.advice else ()


@dataclass(frozen=True)
class WrongIndexCount(Problem):
    code = "E307"
    explanation = "A vector takes one index, a matrix two, a scalar or an agent none."
    name: str
    type: str
    wanted: int
    given: int

    def title(self) -> str:
        return f"`{self.name}` is `{self.type}` and takes {_count(self.wanted)}, not {self.given}"


@dataclass(frozen=True)
class RaggedList(Problem):
    code = "E308"
    explanation = "The items of a list are all scalars (a vector) or all vectors of one length (a matrix); there are no deeper lists."
    first: str
    other: str

    def title(self) -> str:
        if self.first == self.other:
            return f"a list of `{self.first}` is neither a vector nor a matrix"
        return f"the items of a list differ: `{self.first}` and `{self.other}`"


@dataclass(frozen=True)
class OperandNotNumeric(Problem):
    code = "E309"
    explanation = "A sign stands before numbers, `not` before conditions."
    op: str
    type: str

    def title(self) -> str:
        return f"`{self.op}` cannot stand before `{self.type}`"


@dataclass(frozen=True)
class AnalogNotReal(Problem):
    code = "E310"
    explanation = "An analog variable changes continuously, so it is `real`. Whole numbers that never change are `int` parameters or constants."
    name: str
    type: str

    def title(self) -> str:
        return f"`{self.name}` changes continuously, so it must be `real`, not `{self.type}`"


def _count(number: int) -> str:
    return {0: "no index", 1: "1 index"}.get(number, f"{number} indices")


@dataclass(frozen=True)
class NoFiniteValue(Problem):
    code = "E311"
    explanation = "Constants and structural parameters are computed when compiling and must be finite numbers: no 1/0, no sqrt(-1)."
    subject: str
    text: str

    def title(self) -> str:
        return f"{self.subject}: `{self.text}` has no finite value"


@dataclass(frozen=True)
class MatrixTooLarge(Problem):
    code = "E312"
    explanation = (
        "`det`, `inverse` and `solve` are for the small dense matrices of mechanisms and filters. The work grows with the cube of the size, and every "
        "step does all of it. A larger system usually has zeros that are known: write its blocks, or use states that are not coupled through a matrix."
    )
    function: str
    size: int
    limit: int

    def title(self) -> str:
        return (
            f"`{self.function}` takes matrices up to {self.limit}x{self.limit}, not {self.size}x{self.size}"
        )

    def help(self) -> tuple[str, ...]:
        return ("split the system into blocks, or solve for fewer unknowns at once",)
