"""Forms of other languages: Modelica, CHARON, C, MATLAB and Python, each with what to write here.

The rules are part of those in `repairs.py`, which states their contract. A form that is recognised is read to its end, so that
nothing of it is reported a second time.
"""

from __future__ import annotations

import re

from lark import Token

from hierc.grammar import errors
from hierc.grammar.situation import Repair, Rule, Situation, general, on_to_the_brace
from hierc.grammar.source import Span
from hierc.grammar.words import JUNK

# ---- signs --------------------------------------------------------------------------------------

#: Signs with what to write instead and the terminal to read on with.
_SIGNS = {
    "&&": ("write `and`", "AND"),
    "||": ("write `or`", "OR"),
    "&": ("write `and`", "AND"),
    "|": ("write `or`", "OR"),
    "!": ("write `not`", "NOT"),
    "%": ("write `mod(a, b)`", "MUL"),
    "\\": ("division is written `/`", "MUL"),
}


def _comment(at: Situation) -> Repair | None:
    """`# …`, or `% …` where no operator can stand."""
    if at.found.type != JUNK or not (at.found == "#" or (at.found == "%" and not at.fits("MUL"))):
        return None
    problem = errors.UnexpectedCharacter(at.place, str(at.found), ("comments begin with `//`",))
    end = at.source.text.find("\n", at.start)
    return Repair(problem, (), end if end >= 0 else len(at.source.text), sure=True)


def _sign(at: Situation) -> Repair | None:
    match = at.matched(r"&&|\|\||.")
    if at.found.type != JUNK or match is None or match.group() not in _SIGNS:
        return None
    advice, terminal = _SIGNS[match.group()]
    problem = errors.UnexpectedCharacter(Span(at.source, *match.span()), match.group(), (advice,))
    return Repair(problem, (terminal,) if at.fits(terminal) else (), match.end(), sure=True)


def _ternary(at: Situation) -> Repair | None:
    if at.found.type != JUNK or at.found != "?":
        return None
    problem = errors.UnexpectedCharacter(at.place, "?", ("write `if … then … else …`",))
    return Repair(problem, None, at.start)


def _power(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None or not previous == at.found == "*" or previous.end_pos != at.start:
        return None
    return Repair(general(at, ("a power is written `^`",)), (), at.stop, sure=True)


def _list_in_braces(at: Situation) -> Repair | None:
    match = at.matched(r"\{(?:[^{};=]|\{[^{};=]*\})*\}")
    if at.found.type != "LBRACE" or match is None or not at.fits("NUMBER"):
        return None
    instead = " ".join(match.group().translate(str.maketrans("{}", "[]")).split())
    return Repair(general(at, (f"a list is written `{instead}`",)), ("NUMBER",), match.end(), sure=True)


def _range_with_colon(at: Situation) -> Repair | None:
    if at.found.type != "COLON" or not at.fits("_DOTS"):
        return None
    return Repair(general(at, ("a range is written `1..2`",)), ("_DOTS",), at.stop, sure=True)


def _else_if(at: Situation) -> Repair | None:
    if at.found not in ("elseif", "elsif", "elif") or not at.fits("ELSE", "IF"):
        return None
    return Repair(general(at, ("write `else if`",)), ("ELSE", "IF"), at.stop, sure=True)


# ---- derivatives --------------------------------------------------------------------------------


def _derivative_call(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None or previous not in ("d", "der") or not at.fits("PRIME", "_EQUAL"):
        return None
    match = at.matched(r"(d|der)\s*\(\s*([A-Za-z_]\w*)\s*\)\s*==?", previous.start_pos)
    if match is None:
        return None
    place = Span(at.source, *match.span())
    if previous == "d":
        return Repair(errors.CharonDerivative(place, match[2]), ("PRIME", "_EQUAL"), match.end(), sure=True)
    problem = errors.ModelicaForm(place, "der", f"write `{match[2]}' = …;`")
    return Repair(problem, ("PRIME", "_EQUAL"), match.end(), sure=True)


def _second_derivative(at: Situation) -> Repair | None:
    if at.found.type != "PRIME" or at.previous is None or at.previous.type != "PRIME":
        return None
    match = at.matched("'+")
    stop = match.end() if match else at.stop
    equation = at.matched(r"\s*=([^;{}\n]*);", stop) if at.fits("_EQUAL") else None
    name = next((token for token in reversed(at.before) if token.type == "NAME"), at.previous)
    place = Span(at.source, name.start_pos or 0, stop)
    problem = errors.SecondDerivative(place, str(name), equation[1].strip() if equation else None)
    return Repair(problem, (), stop, sure=True)


# ---- words --------------------------------------------------------------------------------------

_MODELICA = {
    "connect": "write a coupling where the agent is used: `agent b = B() [input := a.output];`",
    "extends": "write the other agent's text here, or contain it: `agent part = Part();`",
    "der": "write `x' = …;` under `diff`",
    "end": "a block ends with `}`",
    "equation": "write equations under `diff { … }` and `alge { … }`",
    "model": "write `agent Name() { … }`",
    "parameter": "write parameters in parentheses: `agent Name(real k = 1) { … }`",
    "Real": "declare variables in an agent: `write real x = 1;`",
    "Integer": "write parameters in parentheses: `agent Name(int n = 1) { … }`",
    "Boolean": "write parameters in parentheses: `agent Name(bool on = true) { … }`",
}
_CHARON = {
    "readWrite": "declare it `write` in one agent, `read` in the others",
    "chan": "couple agents by `[input := a.output]`",
}


def _foreign_word(at: Situation) -> Repair | None:
    previous = at.previous
    begins = previous is None or previous.type in ("SEMICOLON", "LBRACE", "RBRACE") or at.is_first_on_line
    word = str(at.found)
    if not begins and word != "extends":
        return None
    if word in ("entry", "exit"):
        return Repair(errors.CharonControlPoint(at.place), None, at.start)
    if word in _MODELICA:
        problem = errors.ModelicaForm(at.place, word, _MODELICA[word])
        return on_to_the_brace(at, problem) or Repair(problem, None, at.start)
    if word in _CHARON:
        return Repair(errors.CharonForm(at.place, word, _CHARON[word]), None, at.start)
    return None


def _function_body(at: Situation) -> Repair | None:
    """`func real f(real x) { return …; }`"""
    if at.found.type != "LBRACE" or not at.fits("_EQUAL") or not any(t.type == "FUNC" for t in at.pending):
        return None
    head = next(t.start_pos or 0 for t in reversed(at.pending) if t.type == "FUNC")
    head_text = " ".join(at.source.text[head : at.start].split())
    body = at.matched(r"\{\s*return\s+([^;{}]*);\s*\}")
    right = " ".join(body[1].split()) if body else "…"
    return Repair(general(at, (f"a function is one expression: `{head_text} = {right};`",)), None, at.start)


# ---- arguments ----------------------------------------------------------------------------------

#: What a value begins with; `[1, 2]` looks like a unit where no list can stand.
_BEGIN_VALUES = frozenset({"NUMBER", "ADD", "BOOL", "LSQB", "UNIT", "LPAR", "IF"})


def _argument_without_name(at: Situation) -> Repair | None:
    """`P(2)` or `P(k)`: a value where `name = value` is wanted."""
    bracket = at.innermost("LPAR")
    if bracket is None:
        return None
    if at.accepts <= {"NAME", "RPAR"} and at.found.type in _BEGIN_VALUES:
        value = at.matched(r"[^,;()\[\]{}=\n]+|\[[^;{}\n\[\]]*\]")
        text = value.group().strip() if value else "…"
        insert: tuple[str, ...] = ("NAME", "_EQUAL")
    elif at.found.type in ("COMMA", "RPAR") and at.fits("_EQUAL", "NUMBER", at.found.type):
        text = str(at.previous)
        insert = ("_EQUAL", "NUMBER")
    else:
        return None
    if not at.fits(*insert):
        return None
    advice = f"name the argument: `{_parameter(at, bracket)} = {text}`"
    return Repair(general(at, (advice,)), insert, at.start, sure=True)


def _parameter(at: Situation, bracket: Token) -> str:
    """The parameter that stands where the argument does, if the agent is defined in this text; else `name`."""
    inside = [token for token in at.before if (token.start_pos or 0) >= (bracket.start_pos or 0)]
    place = sum(token.type == "COMMA" for token in inside)
    agent = next((token for token in reversed(at.before[: -len(inside)]) if token.type == "NAME"), None)
    head = re.search(rf"\bagent\s+{agent}\s*\(([^(){{}};]*)\)", at.source.text)
    names = re.findall(r"\b(?:real|int|bool)\b\s*(?:\[[^\]]*\]\s*)?(\w+)", head[1]) if head else []
    return str(names[place]) if place < len(names) else "name"


RULES: tuple[Rule, ...] = (
    _comment,
    _sign,
    _ternary,
    _power,
    _list_in_braces,
    _range_with_colon,
    _else_if,
    _derivative_call,
    _second_derivative,
    _foreign_word,
    _function_body,
    _argument_without_name,
)
