"""Signs and literals of other languages and of mathematics, each with what to write here.

The rules are part of those in `repairs.py`, which states their contract.
"""

from __future__ import annotations

import re
import unicodedata

from hierc.grammar import errors, forms
from hierc.grammar.forms import general
from hierc.grammar.problems import Problem
from hierc.grammar.situation import Repair, Rule, Situation
from hierc.grammar.source import Span
from hierc.grammar.words import JUNK

#: Signs with what to write instead and the terminal to read on with; the longest stand first.
_SIGNS = {
    "&&": ("and", "AND"), "||": ("or", "OR"), "~=": ("!=", "CMP"), "<>": ("!=", "CMP"), "=<": ("<=", "CMP"), "=>": (">=", "CMP"),
    "/=": ("!=", "CMP"), "**": ("^", "POW"), ".^": ("^", "POW"), "&": ("and", "AND"), "|": ("or", "OR"), "!": ("not ", "NOT"), "~": ("not ", "NOT"),
    "\\": ("/", "MUL"), "≤": ("<=", "CMP"), "≥": (">=", "CMP"), "≠": ("!=", "CMP"), "·": ("*", "MUL"), "×": ("*", "MUL"), "÷": ("/", "MUL"),
    "∙": ("*", "MUL"), "⋅": ("*", "MUL"), "\u2212": ("-", "ADD"), "\u2013": ("-", "ADD"), "²": ("^2", ""), "³": ("^3", ""), "\u2032": ("'", "PRIME"),
    "\u2019": ("'", "PRIME"), "∧": ("and", "AND"), "\u2228": ("or", "OR"), "¬": ("not ", "NOT"),
}  # fmt: skip
_SIGN = re.compile("|".join(map(re.escape, _SIGNS)))
_OPENS = frozenset(
    {"LPAR", "LSQB", "LBRACE", "COMMA", "SEMICOLON", "_EQUAL", "_ASSIGN", "ADD", "MUL", "THEN", "ELSE", "IF"}
)


def _foreign_sign(at: Situation) -> Repair | None:
    """`&&`, `**`, `≤`: signs with a counterpart."""
    previous = at.previous
    start = at.start
    if previous is not None and previous.end_pos == start and (previous + at.found) in ("**", "<>"):
        start = previous.start_pos or 0
        return _rest_of_sign(at, start)
    if previous is not None and previous == "." and previous.end_pos == start and at.found == "^":
        return _rest_of_sign(at, start - 1)
    match = _SIGN.match(at.source.text, start)
    if match is None or at.fits(at.found.type):
        return None
    instead, terminal = _SIGNS[match.group()]
    problem = _sign_problem(at, Span(at.source, *match.span()), instead)
    if not terminal:
        return Repair(problem, ("POW", "NUMBER") if at.fits("POW") else (), match.end(), sure=True)
    return Repair(problem, (terminal,) if at.fits(terminal) else (), match.end(), sure=True)


def _rest_of_sign(at: Situation, start: int) -> Repair:
    """A sign of two characters of which the first was read as an operator."""
    place = Span(at.source, start, at.stop)
    problem = _sign_problem(at, place, _SIGNS[place.text][0])
    return Repair(problem, ("NAME", "POW") if place.text == ".^" else (), at.stop, sure=True)


def _sign_problem(at: Situation, place: Span, instead: str) -> Problem:
    if place.text == "\\":  # of MATLAB: no edit can tell the two apart
        return errors.UnexpectedCharacter(
            place, place.text, ("write `solve(M, b)` where `M\\b` is meant, or `/` to divide",)
        )
    advice = "a power is written `^`" if instead == "^" else f"write `{instead.strip()}`"
    return errors.UnexpectedCharacter(place, place.text, (advice,), at.edit(instead, place.start, place.stop))


def _comment(at: Situation) -> Repair | None:
    """`# …`, `-- …`, a docstring, or `% …` where no operator can stand."""
    begins = at.previous is None or at.previous.type in ("SEMICOLON", "LBRACE", "RBRACE")
    sign = at.matched(r"'''|\"\"\"|--|#+|%+|\"")
    if (
        sign is None
        or (at.fits("MUL") and sign.group() != "#")
        or (not begins and not sign.group().startswith(("#", "%")))
    ):
        return None
    if at.fits(at.found.type) or (sign.group() == '"' and not at.matched(r'"[^"\n]*"[ \t\r]*\n')):
        return None
    end = at.source.text.find("\n", at.start)
    stop = end if end >= 0 else len(at.source.text)
    edits = () if sign.group()[0] in "'\"" else at.edit("//", stop=sign.end())
    problem = errors.UnexpectedCharacter(
        Span(at.source, *sign.span()), sign.group(), ("comments begin with `//`",), edits
    )
    return Repair(problem, (), stop, sure=True)


def _modulo(at: Situation) -> Repair | None:
    if at.found.type != JUNK or at.found != "%" or not at.fits("MUL"):
        return None
    right = at.matched(r"\s*(\w+)", at.stop)
    left = str(at.previous) if at.previous and at.previous.type in ("NAME", "NUMBER") and right else ""
    example = f"mod({left}, {right[1]})" if left and right else "mod(a, b)"
    problem = errors.UnexpectedCharacter(at.place, "%", (f"write `{example}`",))
    return Repair(problem, ("MUL",), at.stop, sure=True)


def _ternary(at: Situation) -> Repair | None:
    if at.found.type != JUNK or at.found != "?":
        return None
    problem = errors.UnexpectedCharacter(at.place, "?", ("write `if … then … else …`",))
    return Repair(problem, None, at.start)


def _bars(at: Situation) -> Repair | None:
    """`|x|`"""
    match = at.matched(r"\|([^|;{}\n]+)\|")
    if at.found != "|" or match is None or not at.fits("NUMBER"):
        return None
    text = f"abs({match[1].strip()})"
    place = Span(at.source, *match.span())
    problem = errors.UnexpectedCharacter(
        place, place.text, (f"write `{text}`",), at.edit(text, stop=match.end())
    )
    return Repair(problem, ("NUMBER",), match.end(), sure=True)


def _equals_in_a_condition(at: Situation) -> Repair | None:
    """`when x = 0`, `if n = 1 then`"""
    if at.found.type != "_EQUAL" or not at.fits("CMP") or at.fits("_EQUAL"):
        return None
    if not at.outreaches("CMP", at.stop):
        return None
    problem = general(at, ("to compare, write `==`",), edits=at.edit("=="))
    return Repair(problem, ("CMP",), at.stop)


def _quotes(at: Situation) -> Repair | None:
    """`'out.csv'` and `“out.csv”`"""
    match = at.matched(r"'([^'\n]*)'|[“”„]([^“”\n]*)[“”]")
    if match is None or at.fits(at.found.type):
        return None
    text = match[1] if match[2] is None else match[2]
    if not at.fits("STRING") and not (at.previous and at.previous.type in _OPENS):
        return None
    advice = (
        f'strings stand between `"`: write `"{text}"`'
        if at.fits("STRING")
        else "strings are only file names and messages"
    )
    edits = at.edit(f'"{text}"', stop=match.end()) if at.fits("STRING") else ()
    insert = ("STRING",) if at.fits("STRING") else ("NUMBER",) if at.fits("NUMBER") else ()
    return Repair(general(at, (advice,), edits=edits), insert, match.end(), sure=True)


def _string(at: Situation) -> Repair | None:
    """`method = "radau";`"""
    if at.found.type != "STRING" or not at.fits("NUMBER") or at.fits("STRING"):
        return None
    inside = str(at.found)[1:-1]
    if forms.block(at) == "EXPERIMENT" and re.fullmatch(r"[A-Za-z_]\w*", inside):
        problem = general(at, (f"write it without quotes: `{inside}`",), edits=at.edit(inside))
    else:
        problem = general(at, ("strings are only file names and messages",))
    return Repair(problem, ("NUMBER",), at.stop, sure=True)


def _all_of(at: Situation) -> Repair | None:
    """`record a*;`"""
    if at.found != "*" or not at.fits("STAR") or at.fits("MUL"):
        return None
    return Repair(
        general(at, ("all variables of an agent are written `.*`",), edits=at.edit(".*")),
        ("STAR",),
        at.stop,
        sure=True,
    )


def _unit_of_function(at: Situation) -> Repair | None:
    """`func real f(real x) [m] = x;`"""
    if at.found.type != "UNIT" or forms.statement(at) != "FUNC" or not at.fits("_EQUAL"):
        return None
    advice = f"remove `{at.found}`: the unit of a function follows from what it computes"
    return Repair(general(at, (advice,), edits=at.removal()), (), at.stop, sure=True)


def _file_name(at: Situation) -> Repair | None:
    """`save out.csv;`: a string without its quotes."""
    match = at.matched(r"[A-Za-z_][\w./:-]*")
    if match is None or not at.accepts <= {"STRING"}:
        return None
    text = f'"{match.group()}"'
    edits = at.edit(text, stop=match.end())
    return Repair(general(at, (f"write `{text}`",), edits=edits), ("STRING",), match.end(), sure=True)


# ---- numbers and units --------------------------------------------------------------------------

_NUMBER_FORMS = (
    (r"(?P<n>\d[\d_]*)(?P<x>_\d+)", lambda m: m.group().replace("_", "")),
    (r"0[xX][0-9a-fA-F]+", lambda m: str(int(m.group(), 16))),
    (r"0[bB][01]+", lambda m: str(int(m.group(), 2))),
    (r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?[fFlL]\b", lambda m: m.group()[:-1]),
    (r"\d+(?:\.\d+)?[eE][+-]?(?![\w])", lambda m: re.sub("[eE]", "e0", m.group()).rstrip("+-")),
    (r"\d+(?:\.\d+)?[dD][+-]?\d+", lambda m: re.sub("[dD]", "e", m.group())),
)  # fmt: skip
_ONE_UNIT = r"(?:[munkMGµ]?(?:m|s|g|N|Hz|V|A|W|J|Pa|rad|H|F|ohm|Ω|K)|deg|rpm|min|h|%)(?:\^-?\d+)?(?![\w.(])"
_UNIT = re.compile(rf"{_ONE_UNIT}(?:[*/]{_ONE_UNIT})*")


def _number_form(at: Situation) -> Repair | None:
    """`1_000`, `0x10`, `1.0f`, `1d3`: what was read as a number goes on with letters."""
    previous = at.previous
    if (
        previous is None
        or previous.type != "NUMBER"
        or previous.end_pos != at.start
        or at.fits(at.found.type)
    ):
        return None
    for pattern, value in _NUMBER_FORMS:
        if (match := at.matched(pattern, previous.start_pos)) and match.end() > at.start:
            text = value(match)
            edits = at.edit(text, match.start(), match.end())
            problem = errors.UnexpectedCharacter(
                Span(at.source, at.start, match.end()),
                at.source.text[at.start : match.end()],
                (f"write `{text}`",),
                edits,
            )
            return Repair(problem, (), match.end(), sure=True)
    return None


def _bare_unit(at: Situation) -> Repair | None:
    """`10 ms`, `x (m)`: a unit without its brackets. A name that the model uses is taken for a factor."""
    previous = at.previous
    inside = at.start + (at.found == "(")
    match = _UNIT.match(at.source.text, inside)
    if previous is None or match is None or not at.fits("UNIT") or at.fits(at.found.type):
        return None
    if at.source.text.startswith("]", match.end()):
        return None
    stop = match.end() + (inside > at.start)
    if inside > at.start and not at.source.text.startswith(")", match.end()):
        return None
    if not at.outreaches("UNIT", stop):
        return None
    text = match.group()
    if previous.type == "NUMBER" and text == at.found and any(token == text for token in at.before):
        return None
    edits = at.edit(f" [{text}]", previous.end_pos, stop)
    problem = errors.HalfAUnit(Span(at.source, at.start, stop), text, f"{previous} [{text}]", edits)
    return Repair(problem, ("UNIT",), stop, sure=True)


_FUNCTIONS = frozenset(
    re.findall(
        r"\w+",
        "sin cos tan asin acos atan sqrt exp log abs sign floor ceil dot cross norm transpose det sum min max",
    )
)
_ENDS = frozenset({"NUMBER", "NAME", "RPAR", "RSQB", "UNIT", "PRIME", "TIME"})


def missing_operator(at: Situation) -> Repair | None:
    """`2 x`, `(a)(b)`, `sin x`, `[1 2]`: two operands side by side on a line. Tried late, when no word explains what is found."""
    previous = at.previous
    if previous is None or previous.type not in _ENDS or not at.on_the_line_before:
        return None
    if at.found.type not in ("NAME", "NUMBER", "LPAR") or not at.fits("MUL", at.found.type):
        return None
    if not at.outreaches("MUL", at.start) and not at.outreaches("COMMA", at.start):
        return None
    bracket = at.innermost("LSQB")
    if bracket and any(token.end_pos == bracket.start_pos and token.type == "SCALAR" for token in at.before):
        return None  # the size of a type, not closed
    blank = at.source.text[previous.end_pos : at.start]
    if blank.strip():
        return None  # there is something between them that was not read
    if (
        at.innermost("LSQB")
        and at.fits("COMMA")
        and blank
        and at.reach(("COMMA",), at.start) > at.reach(("RSQB",), at.start)
    ):
        edits = at.edit(", ", previous.end_pos, at.start)
        return Repair(
            general(at, ("elements are separated by `,`",), edits=edits), ("COMMA",), at.start, sure=True
        )
    if at.innermost("LPAR") and at.fits("COMMA") and blank and at.found.type != "LPAR":
        edits = at.edit(", ", previous.end_pos, at.start)
        return Repair(
            general(at, ("arguments are separated by `,`",), edits=edits), ("COMMA",), at.start, sure=True
        )
    if previous in _FUNCTIONS and at.found.type != "LPAR":
        argument = at.matched(r"[\w.]+")
        text = f"({argument.group()})" if argument else "(…)"
        edits = at.edit(text, previous.end_pos, argument.end()) if argument else ()
        problem = general(at, (f"write `{previous}{text}`",), wanted="`(`", edits=edits)
        return Repair(problem, ("MUL",), at.start, sure=True)
    if previous.type == "NAME" and at.found.type == "NUMBER":
        return None
    text = f"{previous}*{at.found}" if previous.type == "NUMBER" and at.found.type == "NAME" else "*"
    edits = () if previous.type in ("NAME", "TIME") else at.edit("*", previous.end_pos, at.start)
    advice = (
        f"write `{text}` to multiply"
        if previous.type in ("NUMBER", "RPAR", "UNIT")
        else "to multiply, write `*`"
    )
    return Repair(
        general(at, (advice,), wanted="an operator", edits=edits),
        ("MUL",),
        at.start,
        sure=previous.type != "NAME",
    )


# ---- lists --------------------------------------------------------------------------------------


def _rows_in_a_list(at: Situation) -> Repair | None:
    """`[1, 2; 3, 4]` and `[1 2; 3 4]`: a matrix as in MATLAB."""
    bracket = at.innermost("LSQB")
    if bracket is None or not at.fits("RSQB"):
        return None
    match = at.matched(r"\[([^\[\]{}=\n]*;[^\[\]{}=\n]*)\]", bracket.start_pos)
    if match is None or ";" not in match[1]:
        return None
    rows = [
        ", ".join(re.split(r"\s*,\s*|\s+(?=[\w.(])", row.strip()))
        for row in match[1].split(";")
        if row.strip()
    ]
    lists = all("," not in row for row in rows)
    text = f"[{', '.join(rows if lists else (f'[{row}]' for row in rows))}]"
    problem = general(
        at, (f"a matrix is a list of rows: write `{text}`",), edits=at.edit(text, match.start(), match.end())
    )
    return Repair(problem, ("RSQB",), match.end(), sure=True)


def _list_in_parentheses(at: Situation) -> Repair | None:
    """`(1, 2)` for a list."""
    bracket = at.innermost("LPAR")
    if at.found.type != "COMMA" or bracket is None or not at.fits("RPAR") or at.fits("COMMA"):
        return None
    match = at.matched(r"\(([^()\[\]{};=\n]*[\w'])\s*\)", bracket.start_pos)
    if match is None or not at.fits("MUL") or not at.reach(("RPAR",), match.end()):
        return None
    text = f"[{' '.join(match[1].split())}]"
    problem = general(at, (f"a list is written `{text}`",), edits=at.edit(text, match.start(), match.end()))
    return Repair(problem, ("RPAR",), match.end(), sure=True)


def _items_of_a_call(at: Situation) -> Repair | None:
    """`sum(v for v in 1..2)`: a list without its brackets."""
    bracket = at.innermost("LPAR")
    match = at.matched(r"for\s+\w+\s+in\s+([^(){};\n]*)(?=\))")
    if at.found.type != "FOR" or bracket is None or match is None or not at.fits("COMMA"):
        return None
    edits = (*at.edit("[", bracket.end_pos, bracket.end_pos), *at.edit("]", match.end(), match.end()))
    text = at.source.text[bracket.end_pos : match.end()]
    problem = general(at, (f"a list stands in brackets: `[{' '.join(text.split())}]`",), edits=edits)
    return Repair(problem, (), match.end(), sure=True)


# ---- letters ------------------------------------------------------------------------------------


def ascii_name(word: str) -> str:
    """A name of ASCII letters for one with others: `θ_1` is `theta_1`, `größe` is `grosse`; empty where there is none."""
    letters = [_ascii(letter) for letter in word]
    return "".join(letters) if all(letters) and letters[0][0].isalpha() else ""


def _ascii(letter: str) -> str:
    if letter.isascii():
        return letter
    name = unicodedata.name(letter, "").split()
    if name[:1] == ["GREEK"] and "LETTER" in name:
        plain = name[name.index("LETTER") + 1].lower().replace("lamda", "lambda_")
        return plain.capitalize() if "CAPITAL" in name else plain
    simple = unicodedata.normalize("NFKD", letter.replace("ß", "ss"))
    return "".join(c for c in simple if c.isascii() and (c.isalnum() or c == "_"))


RULES: tuple[Rule, ...] = (
    _comment,
    _modulo,
    _ternary,
    _bars,
    _equals_in_a_condition,
    _quotes,
    _string,
    _all_of,
    _unit_of_function,
    _file_name,
    _foreign_sign,
    _number_form,
    _bare_unit,
    _rows_in_a_list,
    _list_in_parentheses,
    _items_of_a_call,
)
