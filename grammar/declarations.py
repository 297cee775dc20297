"""Declarations and parameters without their access, their type or their form, as in C, Python and Modelica.

The rules are part of those in `repairs.py`, which states their contract.
"""

from __future__ import annotations

import re

from hierc.grammar import errors, forms
from hierc.grammar.forms import general
from hierc.grammar.misplaced import begins
from hierc.grammar.situation import Repair, Rule, Situation

#: Words that other languages begin a declaration with, and what stands for them here.
_ACCESS = {
    "input": "read", "in": "read", "output": "write", "out": "write", "public": "write", "global": "write", "state": "write real",
    "protected": "private", "local": "private", "double": "write real", "float": "write real", "var": "write real",
    "number": "write real", "integer": "write discrete int", "boolean": "write discrete bool", "vector": "write real[3]",
}  # fmt: skip
_TYPES = {"double": "real", "float": "real", "number": "real", "Real": "real", "integer": "int", "Integer": "int", "boolean": "bool",
          "Boolean": "bool", "float64": "real"}  # fmt: skip


def _without_access(at: Situation) -> Repair | None:
    """`real x = 0;`, `discrete real x = 0;`, `double x = 0;`, `output real y;`"""
    if not begins(at) or not (at.fits("ACCESS") or forms.block(at) == "FILE"):
        return None
    word = str(at.found)
    instead = _ACCESS.get(word, "")
    if at.found.type not in ("SCALAR", "KIND") and not (instead and at.matched(r"\w+\s+[A-Za-z_]\w*")):
        return None
    new = instead or f"write {word}"
    if forms.block(at) == "FILE":
        return _constant(at, word)
    line = at.matched(r"[^;{}\n]*;?")
    rest = line.group()[len(word) :] if line else ""
    swapped = re.match(r"(real|int|bool|analog|discrete)\s+(read|write|private)\b(.*)", f"{word}{rest}")
    text = f"{swapped[2]} {swapped[1]}{swapped[3]}" if swapped else f"{new}{rest}"
    edits = at.edit(text, stop=line.end()) if line else ()
    advice = f"write `{' '.join(text.split())}`" + ("" if instead or swapped else ", or `read` or `private`")
    if swapped:
        return Repair(
            general(at, (advice,), wanted="`read`, `write` or `private`", edits=edits),
            None,
            at.start,
            sure=True,
        )
    insert = ("ACCESS", "SCALAR") if " " in instead else ("ACCESS",)
    resume = at.stop if instead else at.start
    problem = general(at, (advice,), wanted="`read`, `write` or `private`", edits=edits)
    return Repair(problem, insert if at.fits(*insert) else None, resume, sure=True)


def _constant(at: Situation, word: str) -> Repair | None:
    """A declaration at the top of a file."""
    match = at.matched(r"\w+\s+(\w+\s*(?:\[[^\]\n]*\])?\s*=[^;{}\n]*;)")
    if match is None:
        return None
    text = f"const {_TYPES.get(word, word if word in ('real', 'int', 'bool') else 'real')} {match[1]}"
    advice = f"write `{' '.join(text.split())}`, or declare it in an agent"
    problem = errors.MisplacedStatement(
        at.place, "a variable", forms.here(at), advice, at.edit(text, stop=match.end())
    )
    return Repair(problem, None, at.start)


def _without_type(at: Situation) -> Repair | None:
    """`write x = 0;`, `write double x = 0;`, `const g = 9.81;`, `agent A(k = 1)`, `write x: real = 0;`"""
    previous = at.previous
    if previous is None or at.found.type != "NAME" or not at.fits("SCALAR", "NAME"):
        return None
    word = str(at.found)
    if at.matched(r"\w+\s+[A-Za-z_]\w*"):
        if word not in _TYPES:
            return None
        advice, edits = f"write `{_TYPES[word]}`", at.edit(_TYPES[word])
        return Repair(general(at, (advice,), edits=edits), ("SCALAR",), at.stop, sure=True)
    behind = at.matched(r"\w+\s*:\s*(real|int|bool|float|double|Real)\b")
    if behind:
        text = f"{_TYPES.get(behind[1], behind[1])} {word}"
        problem = general(at, (f"write `{text}`",), edits=at.edit(text, stop=behind.end()))
        return Repair(problem, ("SCALAR", "NAME"), behind.end(), sure=True)
    begun = f"{previous} " if previous.type in ("ACCESS", "KIND", "CONST", "FUNC", "EXTERN") else ""
    problem = general(at, (f"write `{begun}real {word}`",), edits=at.insertion("real "))
    return Repair(problem, ("SCALAR",), at.start, sure=True)


def _size_behind_name(at: Situation) -> Repair | None:
    """`write real y[2] = …;`: the size belongs to the type."""
    if (
        at.previous is None
        or at.previous.type != "NAME"
        or len(at.before) < 2
        or at.before[-2].type != "SCALAR"
    ):
        return None
    match = at.matched(r"\[([^\[\]{};=\n]*)\]")
    if match is None or at.fits(at.found.type):
        return None
    text = f"{at.before[-2]}[{match[1].strip()}] {at.previous}"
    edits = at.edit(text, at.before[-2].start_pos, match.end())
    return Repair(
        general(at, (f"the size belongs to the type: `{text}`",), edits=edits), (), match.end(), sure=True
    )


def _type_said_twice(at: Situation) -> Repair | None:
    """`write real x, real y;`"""
    if (
        at.found.type != "SCALAR"
        or at.previous is None
        or at.previous.type not in ("COMMA", "RSQB")
        or not at.fits("NAME")
        or at.fits("NUMBER")
    ):
        return None
    problem = general(at, (f"the type is said once: remove `{at.found}`",), edits=at.removal())
    return Repair(problem, (), at.stop, sure=True)


def _parameter_list(at: Situation) -> Repair | None:
    """`(real k; real l)`, `(real k real l)`, `(read real u)`, `(const real k)`"""
    if not at.innermost("LPAR") or not at.open_brackets or forms.block(at) != "FILE":
        return None
    if at.fits("COMMA", "SCALAR") and at.matched(r";?\s*(real|int|bool|double|float|Real|Integer|Boolean)\b"):
        last = at.previous.end_pos if at.previous else at.start
        semicolon = at.found.type == "SEMICOLON"
        edits = at.edit(",", last, at.stop if semicolon else last)
        problem = general(at, ("parameters are separated by `,`",), wanted="`,` or `)`", edits=edits)
        return Repair(problem, ("COMMA",), at.stop if semicolon else at.start, sure=True)
    if at.fits("SCALAR") and at.found.type in ("ACCESS", "CONST", "KIND"):
        variable = at.found.type == "ACCESS"
        advice = (
            f"variables are declared between the braces: `{{ {at.found} real x; }}`"
            if variable
            else f"remove `{at.found}`"
        )
        edits = () if variable else at.removal()
        return Repair(general(at, (advice,), edits=edits), (), at.stop, sure=True)
    return None


_STAND_INS = (
    ("NUMBER",),
    ("SCALAR", "NAME"),
    ("NAME", "_EQUAL", "NUMBER"),
    ("NAME", "_ASSIGN", "NUMBER"),
    ("NAME",),
)


def _comma_too_many(at: Situation) -> Repair | None:
    """`f(a, )`, `[1, 2,]`, `write real x, ;`"""
    previous = at.previous
    if previous is None or previous.type != "COMMA" or at.found.type not in ("RPAR", "RSQB", "SEMICOLON"):
        return None
    insert = next((terms for terms in _STAND_INS if at.fits(*terms, at.found.type)), None)
    if insert is None:
        return None
    problem = general(
        at, ("remove the `,` before it",), edits=at.edit("", previous.start_pos, previous.end_pos)
    )
    return Repair(problem, insert, at.start, sure=True)


RULES: tuple[Rule, ...] = (
    _without_access,
    _without_type,
    _size_behind_name,
    _type_said_twice,
    _parameter_list,
    _comma_too_many,
)
