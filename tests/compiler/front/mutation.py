"""Models with mistakes: every model of the project, changed a little as people and editors do, or as nobody would."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random

from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

ROOT = Path(__file__).parents[3]

_TOKEN = re.compile(
    r"""//[^\n]* | /\*.*?\*/ | "[^"\n]*" | \[\s*[A-Za-zµΩ%1][^\]\[\n=]*\] | [A-Za-z_]\w* | \d+(?:\.\d+)?(?:[eE][+-]?\d+)?
    | := | == | != | <= | >= | \.\. | \.[*/] | \s+ | .""",
    re.VERBOSE | re.DOTALL,
)
_WORDS = re.compile(
    "agent|alge|analog|and|as|at|bool|const|diff|discrete|do|each|else|every|experiment|extern|false|for|from|func|group|history|if|"
    "import|in|init|int|inv|let|level|mode|nominal|not|of|offset|or|private|read|real|record|sample|save|table|then|time|to|trans|"
    "true|when|write"
)
_NUMBERS = ("0", "1", "2", "3", "7", "0.5", "1e-300", "1e300", "1e308", "4096", "100000", "9007199254740991")
_OPERATORS = (
    "+",
    "-",
    "*",
    "/",
    "^",
    ".*",
    "./",
    "<",
    "<=",
    "==",
    "!=",
    "and",
    "or",
    ":=",
    "=",
    "..",
    ",",
    "'",
)
_UNITS = (
    "[m]",
    "[s]",
    "[1/s]",
    "[kg*m^2]",
    "[N/m^1.5]",
    "[%]",
    "[deg]",
    "[Nm]",
    "[m/s/s]",
    "[1]",
    "[]",
    "[x",
)
_CHARACTERS = (
    "\0",
    "\r",
    "\t",
    "\x1b[31m",
    "µ",
    "Ω",
    "π",
    "車",
    "\u202e",
    "\ufeff",
    "😀",
    "é",
    "\\",
    '"',
    "/*",
    "//",
)
_PHRASES = (
    "true", "time", "pi", "zeros(2)", "eye(3)", "[1, 2]", "[[1, 2], [3, 4]]", "x'", "der(x)", "d(x) == v", "extends A;",
    "connect(a, b);", "if a then b else c", "let q = 1;", "read real q;", "write real q [m] = 0;", "level more { }",
    "agent inner = A();", "group each car;", "const real c = c;", "func real f(real x) = f(x);", "for i in 1..3 { }",
    "experiment e of A() { }", "init { x = 1; }", "inv { x > 0; }", "solve(x, x)", "inverse(x)", "sum(x)", "x[0]", "x[1..2]",
    "exp(exp(exp(1000)))", "1/0", "sqrt(-1)", "0^0", "clamp(1, 2, 1)", "mod(1, 0)", "floor(x)",
)  # fmt: skip


def sources() -> list[str]:
    """The texts of all models: packaged, in tests, on the pages of problems, and in the documents."""
    texts = [
        path.read_text(encoding="utf-8") for path in sorted(ROOT.rglob("*.hier")) if "build" not in path.parts
    ]
    for document in sorted((ROOT / "docs").glob("*.md")):
        text = document.read_text(encoding="utf-8")
        texts += re.findall(r"^```hier(?:-\w+)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return sorted({text for text in texts if len(text) < 12_000 and _parses(text)})


def _parses(text: str) -> bool:
    try:
        parse(SourceFile("model.hier", text))
    except ModelError:
        return False
    return True


@cache
def _tokens(text: str) -> tuple[str, ...]:
    return tuple(_TOKEN.findall(text))


def mutant(texts: list[str], chance: Random) -> str:
    """One of the texts with a few mutations; most keep to the grammar, so that later phases have work."""
    mutations = chance.choice((_GENTLE, _GENTLE, _ANY))
    text = chance.choice(texts)
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 4))):
        text = chance.choice(mutations)(text, texts, chance)
    return text


# ---- mutations of tokens ------------------------------------------------------------------------


def _delete(text: str, texts: list[str], chance: Random) -> str:
    return _edited(text, chance, lambda token: "")


def _duplicate(text: str, texts: list[str], chance: Random) -> str:
    return _edited(text, chance, lambda token: f"{token} {token}")


def _swap(text: str, texts: list[str], chance: Random) -> str:
    tokens = list(_tokens(text))
    places = _places(tokens)
    if len(places) > 1:
        at = chance.randrange(len(places) - 1)
        one, other = places[at], chance.choice((places[at + 1], chance.choice(places)))
        tokens[one], tokens[other] = tokens[other], tokens[one]
    return "".join(tokens)


def _replace(text: str, texts: list[str], chance: Random) -> str:
    """A token by another of its kind."""
    return _edited(text, chance, lambda token: chance.choice(_like(token, text, texts, chance)))


def _insert(text: str, texts: list[str], chance: Random) -> str:
    return _edited(text, chance, lambda token: f"{token} {chance.choice(_PHRASES)} ")


def _exchange(text: str, texts: list[str], chance: Random) -> str:
    """A name, number, unit or operator by another that can stand there."""
    tokens = list(_tokens(text))
    places = [
        i for i in _places(tokens) if tokens[i][0].isdigit() or tokens[i][0] == "[" or tokens[i] in "+-*/^<"
    ]
    names = [i for i in _places(tokens) if _is_name(tokens[i])]
    if places or names:
        place = chance.choice(chance.choice([kind for kind in (places, names) if kind]))
        others = _OPERATORS[:10] if tokens[place] in "+-*/^<" else _like(tokens[place], text, texts, chance)
        tokens[place] = chance.choice(others)
    return "".join(tokens)


def _statement(text: str, texts: list[str], chance: Random) -> str:
    """A line that is a statement, gone, doubled or moved to where another stands."""
    lines = text.splitlines(keepends=True)
    places = [
        i for i, line in enumerate(lines) if line.strip().endswith(";") and line.count("{") == line.count("}")
    ]
    if not places:
        return text
    at, to = chance.choice(places), chance.choice(places)
    line = lines[at]
    if chance.random() < 0.7:
        del lines[at]
    if chance.random() < 0.6:
        lines.insert(to, line)
    return "".join(lines)


def _rename(text: str, texts: list[str], chance: Random) -> str:
    """One name, in all its places, to another."""
    names = sorted({token for token in _tokens(text) if _is_name(token)})
    if not names:
        return text
    old, new = chance.choice(names), chance.choice(names)
    return "".join(new if token == old else token for token in _tokens(text))


def _like(token: str, text: str, texts: list[str], chance: Random) -> tuple[str, ...]:
    if token[0].isdigit():
        return _NUMBERS
    if token[0] == "[":
        return _UNITS
    if re.match(r"[A-Za-z_]", token):
        elsewhere = _tokens(chance.choice((text, text, text, chance.choice(texts))))
        alike = _is_name if _is_name(token) else _WORDS.fullmatch
        return tuple(t for t in elsewhere if alike(t)) or ("x",)
    return _OPERATORS


def _is_name(token: str) -> bool:
    return re.fullmatch(r"[A-Za-z_]\w*", token) is not None and not _WORDS.fullmatch(token)


def _edited(text: str, chance: Random, change: Callable[[str], str]) -> str:
    tokens = list(_tokens(text))
    if places := _places(tokens):
        place = chance.choice(places)
        tokens[place] = change(tokens[place])
    return "".join(tokens)


def _places(tokens: list[str]) -> list[int]:
    return [i for i, token in enumerate(tokens) if not token.isspace()]


# ---- mutations of lines and characters ----------------------------------------------------------


def _cut(text: str, texts: list[str], chance: Random) -> str:
    return text[: chance.randrange(len(text) + 1)]


def _characters(text: str, texts: list[str], chance: Random) -> str:
    start = chance.randrange(len(text) + 1)
    stop = min(len(text), start + chance.choice((0, 0, 1, 3)))
    return text[:start] + chance.choice(_CHARACTERS) + text[stop:]


def _lines(text: str, texts: list[str], chance: Random) -> str:
    """A line gone, doubled, moved, or taken from another model."""
    lines = text.splitlines(keepends=True) or ["\n"]
    at, to = chance.randrange(len(lines)), chance.randrange(len(lines))
    match chance.randrange(4):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, lines[at])
        case 2:
            lines.insert(to, lines.pop(at))
        case _:
            lines.insert(at, chance.choice(chance.choice(texts).splitlines(keepends=True) or ["\n"]))
    return "".join(lines)


_GENTLE = (_exchange, _exchange, _exchange, _statement, _rename)
_ANY = (_delete, _duplicate, _swap, _replace, _replace, _replace, _insert, _rename, _cut, _characters, _lines)


def mutants(count: int, seed: int) -> Iterator[str]:
    """Mutants that depend on the seed alone."""
    chance, texts = Random(seed), sources()
    for _ in range(count):
        yield mutant(texts, chance)
