"""The formatter on any valid text: nothing lost, nothing moved across a token, and the second time nothing to do."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from hierc.grammar.formatting import format_source
from hierc.grammar.parser import _lark, parse
from hierc.grammar.reading import read_source
from hierc.grammar.recovery import RecoveringParser
from hierc.grammar.source import SourceFile

EXAMPLES = sorted((Path(__file__).parent / "examples").glob("*.hier"))

GAPS = (" ", " ", " ", "\n", "\n\n\n", "\t \r\n")
COMMENTS = (
    " // {}\n",
    "\n// {}  \n",
    "\n\n// {}\n\n",
    " /* {} */ ",
    "\n/* {}\n  more */\n",
    "/*{}*/",
    " /// {}\n",
    "\n/// {}\n",
)


def tokens_of(text: str) -> list[str]:
    """The tokens of a text, units without blanks at their ends and without the word `analog`."""
    reading = RecoveringParser(_lark(), SourceFile("any", text))
    reading.run()
    assert not reading.problems
    return [re.sub(r"^\[\s*(\S.*?)\s*\]$", r"[\1]", str(t)) for t in reading.tokens if t != "analog"]


def comments_of(text: str) -> list[str]:
    return [
        re.sub(r"[ \t\r]+$", "", c.text, flags=re.MULTILINE) for c in parse(SourceFile("any", text)).comments
    ]


def scattered(tokens: Iterable[str], choice: random.Random, often: float) -> str:
    """The tokens with other gaps and numbered comments between them."""
    parts: list[str] = []
    for number, token in enumerate(tokens):
        while choice.random() < often:
            parts.append(choice.choice(COMMENTS).format(number))
        parts += [token, choice.choice(GAPS)]
    return "".join(parts)


def assert_well_formatted(text: str, width: int) -> None:
    once = format_source(SourceFile("any", text), width)
    assert format_source(SourceFile("any", once), width) == once
    assert tokens_of(once) == tokens_of(text)
    assert comments_of(once) == comments_of(text)
    assert parse(SourceFile("any", once)).items or not tokens_of(text)
    lines = once.replace("\r\n", "\n").split("\n")
    assert lines[-1] == ""
    assert all(line == line.rstrip() for line in lines)
    assert "\n\n\n" not in "\n".join(lines)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(EXAMPLES),
    st.integers(0, 2**64),
    st.sampled_from([0.0, 0.02, 0.2]),
    st.sampled_from([20, 60, 100, 1000]),
)
def test_examples_in_any_layout(path: Path, seed: int, often: float, width: int) -> None:
    tokens = tokens_of(read_source(path).text)
    assert_well_formatted(scattered(tokens, random.Random(seed), often), width)


# ---- models made at random ----------------------------------------------------------------------


class Writer:
    """Writes the tokens of random models by the rules of the grammar."""

    def __init__(self, choice: random.Random) -> None:
        self.choice = choice
        self.depth = 0

    def any(self, *rules: Callable[[], list[str]]) -> list[str]:
        """By one of the rules; the deeper, the more likely by the first, which ends it."""
        self.depth += 1
        made = (rules[0] if self.choice.random() < self.depth / 7 else self.choice.choice(rules))()
        self.depth -= 1
        return made

    def some(
        self, rule: Callable[[], list[str]], comma: str = "", least: int = 0, most: int = 3
    ) -> list[str]:
        made: list[str] = []
        for i in range(self.choice.randint(least, most)):
            made += [comma] * (i > 0 and comma != "") + rule()
        return made

    def maybe(self, rule: Callable[[], list[str]]) -> list[str]:
        return rule() if self.choice.random() < 0.4 else []

    def name(self) -> list[str]:
        return [self.choice.choice(["x", "level", "theta_dot", "q1", "a_rather_long_name_for_a_variable"])]

    def unit(self) -> list[str]:
        return [self.choice.choice(["[m]", "[ rad/s]", "[N*m/A ]", "[1]", "[%]"])]

    def number(self) -> list[str]:
        return [self.choice.choice(["0", "12", "0.5", "1e-3", "3.141592653589793"]), *self.maybe(self.unit)]

    def dotted(self) -> list[str]:
        return self.some(self.name, ".", 1, 3)

    def range(self) -> list[str]:
        return [*self.expr(), "..", *self.expr()]

    def subs(self) -> list[str]:
        return ["[", *self.some(lambda: self.any(self.index, self.expr, self.range), ",", 1, 2), "]"]

    def index(self) -> list[str]:
        return [self.choice.choice(["i", "1"])]

    def path(self) -> list[str]:
        return self.some(lambda: [*self.name(), *self.maybe(self.subs)], ".", 1, 3)

    def binary(self, *ops: str) -> Callable[[], list[str]]:
        def write() -> list[str]:
            made = self.operand()
            for _ in range(self.choice.choice([1, 1, 1, 2, 5])):
                made += [self.choice.choice(ops), *self.operand()]
            return made

        return write

    def operand(self) -> list[str]:
        return self.any(
            self.number, self.path, self.parenthesised, self.call, self.vector, lambda: ["-", *self.number()]
        )

    def parenthesised(self) -> list[str]:
        return ["(", *self.expr(), ")"]

    def call(self) -> list[str]:
        return [*self.dotted(), "(", *self.some(self.expr, ","), ")"]

    def vector(self) -> list[str]:
        return ["[", *self.some(self.expr, ",", 1), "]"]

    def over(self) -> list[str]:
        return ["i", "in", *self.range()]

    def cond(self) -> list[str]:
        return ["if", *self.expr(), "then", *self.expr(), "else", *self.expr()]

    def expr(self) -> list[str]:
        return self.any(
            self.number,
            self.operand,
            self.binary("+", "-"),
            self.binary("*", "/", ".*", "./"),
            self.binary("and"),
            self.binary("or"),
            self.binary("^"),
            self.cond,
            lambda: [*self.operand(), self.choice.choice(["==", "!=", "<=", ">="]), *self.operand()],
            lambda: [self.choice.choice(["-", "+", "not"]), *self.operand()],
            lambda: ["[", *self.expr(), "for", *self.over(), "]"],
            lambda: ["time"],
            lambda: [*self.path(), "'"],
        )

    def type(self) -> list[str]:
        sizes = self.maybe(lambda: ["[", *self.some(self.expr, ",", 1, 2), "]"])
        return [self.choice.choice(["real", "int", "bool"]), *sizes]

    def params(self) -> list[str]:
        return ["(", *self.some(self.param, ","), ")"]

    def param(self) -> list[str]:
        return [*self.type(), *self.name(), *self.maybe(self.unit), *self.maybe(lambda: ["=", *self.expr()])]

    def declarator(self) -> list[str]:
        value, nominal = (
            self.maybe(lambda: ["=", *self.expr()]),
            self.maybe(lambda: ["nominal", *self.number()]),
        )
        return [*self.name(), *self.maybe(self.unit), *value, *nominal]

    def decl(self) -> list[str]:
        access, kind = self.choice.choice(["read", "write", "private"]), self.maybe(lambda: ["analog"])
        return [access, *kind, *self.type(), *self.some(self.declarator, ",", 1), ";"]

    def target(self) -> list[str]:
        return [*self.name(), *self.maybe(self.subs)]

    def equations(self, *sign: str) -> list[str]:
        return self.some(lambda: [*self.target(), *sign, *self.expr(), ";"])

    def diff(self) -> list[str]:
        loop = self.maybe(lambda: ["for", *self.over(), "{", *self.equations("'", "="), "}"])
        return ["diff", "{", *self.equations("'", "="), *loop, "}"]

    def inv(self) -> list[str]:
        return ["inv", "{", *self.expr(), *self.maybe(lambda: [":", '"says // so"']), ";", "}"]

    def trans(self) -> list[str]:
        way = self.maybe(
            lambda: ["from", *self.dotted(), "to", *self.maybe(lambda: ["history"]), *self.dotted()]
        )
        return [
            "trans",
            *way,
            "when",
            *self.expr(),
            *self.any(lambda: [";"], lambda: ["do", "{", *self.equations(":="), "}"]),
        ]

    def mode(self) -> list[str]:
        return [*self.maybe(lambda: ["init"]), "mode", *self.name(), "{", *self.some(self.mode_item), "}"]

    def mode_item(self) -> list[str]:
        return self.any(self.let, self.diff, self.inv, self.mode, self.trans)

    def let(self) -> list[str]:
        return ["let", *self.name(), *self.maybe(self.unit), "=", *self.expr(), ";"]

    def coupling(self) -> list[str]:
        return ["[", *self.some(lambda: [*self.name(), ":=", *self.expr()], ",", 1), "]"]

    def instance(self) -> list[str]:
        args = self.some(lambda: [*self.name(), "=", *self.expr()], ",")
        index = self.maybe(lambda: ["[", *self.over(), "]"])
        return [
            "agent",
            *self.name(),
            *index,
            "=",
            *self.dotted(),
            "(",
            *args,
            ")",
            *self.maybe(self.coupling),
            ";",
        ]

    def level(self) -> list[str]:
        return ["level", *self.name(), "{", *self.some(self.agent_item), "}"]

    def sample(self) -> list[str]:
        offset = self.maybe(lambda: ["offset", *self.number()])
        return ["sample", "every", *self.expr(), *offset, "{", *self.equations(":="), "}"]

    def group(self) -> list[str]:
        return ["group", *self.name(), "=", *self.some(self.pattern, ",", 1), ";"]

    def pattern(self) -> list[str]:
        return [*self.path(), *self.maybe(lambda: [".*"])]

    def agent_item(self) -> list[str]:
        return self.any(
            self.let,
            self.decl,
            self.diff,
            self.inv,
            self.mode,
            self.trans,
            self.instance,
            self.level,
            self.sample,
            self.group,
        )

    def agent(self) -> list[str]:
        return ["agent", *self.name(), *self.params(), "{", *self.some(self.agent_item), "}"]

    def func(self) -> list[str]:
        return ["func", *self.type(), *self.name(), *self.params(), "=", *self.expr(), ";"]

    def setting(self) -> list[str]:
        return self.any(
            lambda: [*self.name(), "=", *self.expr(), ";"],
            lambda: ["record", *self.some(self.pattern, ",", 1), ";"],
            lambda: ["save", '"a.csv"', ",", '"b \\" c"', ";"],
            lambda: ["init", "{", *self.path(), "=", *self.expr(), ";", "}"],
            lambda: ["group", *self.path(), "{", *self.name(), "=", *self.expr(), ";", "}"],
        )

    def experiment(self) -> list[str]:
        args = self.some(lambda: [*self.path(), "=", *self.expr()], ",")
        head = ["experiment", *self.name(), "of", *self.dotted(), "(", *args, ")", *self.maybe(self.coupling)]
        return [*head, "{", *self.some(self.setting), "}"]

    def item(self) -> list[str]:
        return self.any(
            self.agent,
            self.func,
            self.experiment,
            lambda: ["import", *self.dotted(), "as", *self.name(), ";"],
        )


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 2**64),
    st.sampled_from([0.0, 0.02, 0.2]),
    st.sampled_from([20, 60, 100, 1000]),
)
def test_random_models_in_any_layout(seed: int, often: float, width: int) -> None:
    choice = random.Random(seed)
    tokens = Writer(choice).item()
    assert_well_formatted(scattered(tokens, choice, often), width)
