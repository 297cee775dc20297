"""Problems of the text and its syntax (E1xx), and of reading files (E907). Wording only: `repairs.py` decides which applies."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hierc.grammar.problems import Edit, Label, Problem, in_place_of
from hierc.grammar.source import Span

# ---- characters and literals --------------------------------------------------------------------


@dataclass(frozen=True)
class UnexpectedCharacter(Problem):
    code = "E101"
    explanation = (
        "Signs that the language does not use stand only in comments, strings and units. Operators are `+ - * / ^ .* ./`, comparisons "
        "`< <= > >= == !=`, logic `and or not`, choices `if … then … else …`; comments begin with `//` or stand between `/*` and `*/`."
    )

    text: str
    advice: tuple[str, ...] = ()
    replacement: tuple[Edit, ...] = ()

    def title(self) -> str:
        if len(self.text) == 1:
            return f"unexpected character {quoted(self.text)}"
        return f"unexpected characters {quoted(self.text)}"

    def help(self) -> tuple[str, ...]:
        return self.advice

    def edits(self) -> tuple[Edit, ...]:
        return self.replacement


@dataclass(frozen=True)
class StrangeName(Problem):
    code = "E106"
    explanation = (
        "Names are made of the letters A to Z and a to z, digits and `_`. Letters beyond ASCII are easily confused, and some tools silently "
        "change them. Units may have `µ`, `Ω` and `°`, comments and strings everything."
    )

    #: The same in ASCII letters, where that can be told.
    instead: str = ""

    def title(self) -> str:
        return "names are made of ASCII letters, digits and `_`"

    def help(self) -> tuple[str, ...]:
        return (f"write `{self.instead}`",) if self.instead else ()

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, self.instead) if self.instead else ()


@dataclass(frozen=True)
class ReservedWord(Problem):
    code = "E102"
    explanation = (
        "The words of the language are reserved everywhere, so that a model reads the same in every place. "
        "Only `level`, `offset`, `table`, `record`, `save`, `history` and `each` may also be names."
    )

    word: str

    def title(self) -> str:
        return f"`{self.word}` is a reserved word and cannot be used as a name here"

    def help(self) -> tuple[str, ...]:
        return (f"rename it, for example `{self.word}_`",)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, f"{self.word}_")


@dataclass(frozen=True)
class UnclosedString(Problem):
    code = "E103"
    explanation = 'A string stands between two `"` on one line: the name of a file, or the message of an `inv`. A `"` inside is written `\\"`.'

    def title(self) -> str:
        return "string is not closed on this line"


@dataclass(frozen=True)
class NumberWithoutDigit(Problem):
    code = "E104"
    explanation = (
        "A digit stands on both sides of a decimal point, so that the range `1..N` is never misread."
    )

    written: str
    digit_is_missing_before: bool

    def title(self) -> str:
        return f"a number needs a digit {'before' if self.digit_is_missing_before else 'after'} the decimal point"

    def help(self) -> tuple[str, ...]:
        return (f"write `{self._mended}`",)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, self._mended)

    @property
    def _mended(self) -> str:
        return f"0{self.written}" if self.digit_is_missing_before else self.written.replace(".", ".0", 1)


@dataclass(frozen=True)
class UnclosedComment(Problem):
    code = "E105"
    explanation = "A comment `/*` ends at the next `*/`; comments do not nest."

    def title(self) -> str:
        return "comment opened here is never closed"

    def help(self) -> tuple[str, ...]:
        return ("add `*/`",)


@dataclass(frozen=True)
class NumberOutOfRange(Problem):
    code = "E117"
    explanation = (
        "Numbers are IEEE doubles: a literal must not overflow, vanish or, as an integer, lose digits."
    )

    text: str
    value: float

    def title(self) -> str:
        if math.isinf(self.value):
            return f"the number {quoted(self.text)} is too large"
        if self.value == 0:
            return f"the number {quoted(self.text)} is too small to tell from zero"
        return f"the integer {quoted(self.text)} is too large to be kept exactly"

    def help(self) -> tuple[str, ...]:
        if 0 < self.value < math.inf:
            return (f"write `{self.value!r}` for a real number",)
        return ()


# ---- syntax -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UnexpectedText(Problem):
    """The general form. `expected` is in words and empty where the token is only in the way; so is `after` at the start."""

    code = "E110"
    explanation = (
        "The text does not follow the grammar at this place: the message says what could stand there, and shows the form of the statement. "
        "What comes before it could be read, so the slip is there or shortly before."
    )

    expected: str
    after: str
    found: str
    advice: tuple[str, ...] = ()
    opener: Span | None = None
    replacement: tuple[Edit, ...] = ()
    form: str = ""

    def title(self) -> str:
        expected = f"expected {self.expected}" if self.expected else f"unexpected {self.found}"
        after = f" after {quoted(self.after)}" if self.after else ""
        found = f", found {self.found}" if self.expected else ""
        return expected + after + found

    def labels(self) -> tuple[Label, ...]:
        return () if self.opener is None else (Label(self.opener, "opened here"),)

    def help(self) -> tuple[str, ...]:
        return self.advice

    def notes(self) -> tuple[str, ...]:
        return (self.form,) if self.form else ()

    def edits(self) -> tuple[Edit, ...]:
        return self.replacement


@dataclass(frozen=True)
class MissingSemicolon(Problem):
    code = "E111"
    explanation = "Every statement ends with `;`. Line breaks mean nothing, so that a long equation may go on over several lines."

    def title(self) -> str:
        return "missing `;`"

    def remark(self) -> str:
        return "add `;` here"

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, ";")


@dataclass(frozen=True)
class UnclosedBrace(Problem):
    code = "E112"
    explanation = "Every `{` needs a `}` of its own. Which one lacks it is guessed from the indentation, and from what cannot stand inside."

    seen: Span
    seen_as: str

    def title(self) -> str:
        return "`{` opened here is never closed"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.seen, self.seen_as),)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(Span(self.seen.file, self.seen.start, self.seen.start), "}\n")


@dataclass(frozen=True)
class AssignmentSign(Problem):
    code = "E113"
    explanation = (
        "`=` states what holds always; `:=` is done once or joins an input, so the two never look alike."
    )

    subject: str
    sign: str

    def title(self) -> str:
        match self.sign:
            case "==":
                return f"{self.subject} use `=`; `==` compares"
            case ":=":
                return f"{self.subject} use `=`; `:=` is for `do` and `sample` assignments and couplings"
            case other:
                return f"{self.subject} use `=`, not `{other}`"

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.span, " =" if self.sign == ":" else "=")


@dataclass(frozen=True)
class EquationSign(Problem):
    code = "E114"
    explanation = (
        "`:=` gives a value where it stands: to an input in a coupling `[input := a.output]`, or once, in a `do` or `sample` block. `=` states what "
        "holds always: equations, `let`, declarations, arguments and settings."
    )

    def title(self) -> str:
        return "assignments and couplings use `:=`"

    def edits(self) -> tuple[Edit, ...]:
        colon = self.span is not None and self.span.text == ":"
        return in_place_of(self.span, " :=" if colon else ":=")


@dataclass(frozen=True)
class MisplacedUnit(Problem):
    code = "E115"
    explanation = (
        "A unit says what a number or a declared variable is measured in. That of an expression follows from its parts, so there is no place for "
        "another; multiply by `1 [m]` to give one to a plain number."
    )

    #: What it follows, as far as that can be told.
    operand: Span | None = None

    def title(self) -> str:
        return "a unit may follow only a number or a declared name"

    def help(self) -> tuple[str, ...]:
        operand = "(a + b)" if self.operand is None else " ".join(self.operand.text.split())
        unit = "[1/s]" if self.span is None else self.span.text
        return (f"multiply: `{operand}*1 {unit}`, or give the numbers their own units",)

    def edits(self) -> tuple[Edit, ...]:
        if self.operand is None or self.span is None:
            return ()
        return in_place_of(Span(self.span.file, self.operand.stop, self.span.stop), f"*1 {self.span.text}")


@dataclass(frozen=True)
class OnlyNamesIndexed(Problem):
    code = "E120"
    explanation = "An index stands after a name. What an expression or a call gives has its elements once it has a name."

    index: str

    def title(self) -> str:
        return "only names can be indexed"

    def help(self) -> tuple[str, ...]:
        return (f"name the value first: `let y = …;`, then `y[{self.index}]`",)


@dataclass(frozen=True)
class SecondDerivative(Problem):
    code = "E121"
    explanation = (
        "Equations are of first order: `x'` is the derivative of a state, and the derivative of `x'` is that of another state, the one "
        "that `x'` equals."
    )

    name: str
    right: str | None  # of the equation whose left side this is

    def title(self) -> str:
        return "there are no second derivatives"

    def help(self) -> tuple[str, ...]:
        rate = "v" if self.name == "x" else f"{self.name}_rate"
        if self.right is None:
            return (f"write `{rate}'`, where `{rate}` is a state and `{self.name}' = {rate};`",)
        return (f"write `{self.name}' = {rate}; {rate}' = {self.right};`, with a second state `{rate}`",)


@dataclass(frozen=True)
class ChainedComparison(Problem):
    code = "E116"
    explanation = (
        "A comparison is true or false, and truth is not compared with a number: `0 < x < 1` would ask whether `true < 1`. Join two "
        "comparisons by `and`."
    )

    instead: str
    #: All of the chain that `instead` replaces.
    chain: Span | None = None

    def title(self) -> str:
        return "comparisons do not chain"

    def help(self) -> tuple[str, ...]:
        return (f"write `{self.instead}`",)

    def edits(self) -> tuple[Edit, ...]:
        return in_place_of(self.chain, self.instead)


@dataclass(frozen=True)
class NestedTooDeeply(Problem):
    code = "E118"
    explanation = "A limit keeps every tool that reads the model safe from texts made to exhaust it."

    limit: int

    def title(self) -> str:
        return f"this is nested more than {self.limit} deep"

    def help(self) -> tuple[str, ...]:
        return ("name inner parts with `let`",)


@dataclass(frozen=True)
class HalfAUnit(Problem):
    code = "E119"
    explanation = "A unit stands in brackets after a declared name or a number, `write real v [m/s] = 2 [km/h];`, so that it is never taken for a variable."

    unit: str
    #: What to write, where more than the unit is shown, with its edits.
    instead: str = ""
    replacement: tuple[Edit, ...] = ()

    def title(self) -> str:
        return "a unit stands between `[` and `]`"

    def help(self) -> tuple[str, ...]:
        return (f"write `{self.instead or f'[{self.unit}]'}`",)

    def edits(self) -> tuple[Edit, ...]:
        return self.replacement or in_place_of(self.span, f"[{self.unit}]")


@dataclass(frozen=True)
class MisplacedStatement(Problem):
    code = "E122"
    explanation = (
        "Definitions stand at the top of a file, declarations and blocks in an agent, equations under `diff` and `alge`, assignments in "
        "`do` and `sample` blocks, settings in an experiment: so each statement is found where it is looked for."
    )

    what: str
    here: str
    advice: str
    replacement: tuple[Edit, ...] = ()

    def title(self) -> str:
        return f"{self.what} cannot stand {self.here}"

    def help(self) -> tuple[str, ...]:
        return (self.advice,)

    def edits(self) -> tuple[Edit, ...]:
        return self.replacement


# ---- files --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UnreadableFile(Problem):
    code = "E907"
    explanation = "A model is a regular file of UTF-8 text of at most 8 MB."

    name: str
    reason: str
    advice: tuple[str, ...] = ()

    def title(self) -> str:
        return f"cannot read `{self.name}`: {self.reason}"

    def help(self) -> tuple[str, ...]:
        return self.advice


def quoted(text: str, limit: int = 40) -> str:
    """`text` between backquotes, its middle left out where it is too long for a message."""
    return f"`{text}`" if len(text) <= limit else f"`{text[: limit // 2]}…{text[-limit // 4 :]}`"
