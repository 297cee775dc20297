"""Forms of other languages: Modelica, CHARON, C, MATLAB and Python, each with what to write here.

The rules are part of those in `repairs.py`, which states their contract. A form that is recognised is read to its end, so that
nothing of it is reported a second time.
"""

from __future__ import annotations

import re

from lark import Token

from hierc.grammar import errors, foreign_errors
from hierc.grammar.forms import block, general, on_to_the_brace
from hierc.grammar.situation import Repair, Rule, Situation
from hierc.grammar.source import Span

# ---- values -------------------------------------------------------------------------------------


def _list_in_braces(at: Situation) -> Repair | None:
    match = at.matched(r"\{(?:[^{};=]|\{[^{};=]*\})*\}")
    if at.found.type != "LBRACE" or match is None or not at.fits("NUMBER"):
        return None
    instead = " ".join(match.group().translate(str.maketrans("{}", "[]")).split())
    problem = general(at, (f"a list is written `{instead}`",), edits=at.edit(instead, stop=match.end()))
    return Repair(problem, ("NUMBER",), match.end(), sure=True)


def _range_with_colon(at: Situation) -> Repair | None:
    """`1:3`, and `v[:]`"""
    if not at.matched(":(?!=)"):
        return None
    if at.fits("_DOTS"):
        previous, following = at.previous, at.matched(r"\s*(\w+)", at.stop)
        text = f"{previous}..{following[1]}" if following else "1..2"
        problem = general(at, (f"a range is written `{text}`",), edits=at.edit(".."))
        return Repair(problem, ("_DOTS",), at.stop, sure=True)
    if at.innermost("LSQB") and at.previous and at.previous.type in ("LSQB", "COMMA") and at.fits("NUMBER"):
        problem = general(at, ("all elements are the range `1..n`; a name without `[…]` is the whole of it",))
        return Repair(problem, ("NUMBER",), at.stop, sure=True)
    return None


def _else_if(at: Situation) -> Repair | None:
    if at.found not in ("elseif", "elsif", "elif") or not at.fits("ELSE", "IF"):
        return None
    problem = general(at, ("write `else if`",), edits=at.edit("else if"))
    return Repair(problem, ("ELSE", "IF"), at.stop, sure=True)


def _choice(at: Situation) -> Repair | None:
    """`if a { b } else { c }`, `if a: b else: c`, `b if a else c`"""
    if at.found.type == "LBRACE" and at.fits("THEN"):
        braces = at.matched(r"\{\s*([^{};]*?);?\s*\}\s*else\s*\{\s*([^{};]*?);?\s*\}")
        if braces is None:
            return None
        text = f"then {braces[1]} else {braces[2]}"
        problem = general(at, (f"write `{text}`",), edits=at.edit(text, stop=braces.end()))
        return Repair(problem, ("THEN", "NUMBER", "ELSE", "NUMBER"), braces.end(), sure=True)
    if at.found == ":" and (at.fits("THEN") or (at.previous and at.previous.type == "ELSE")):
        then = at.fits("THEN")
        problem = general(
            at, ("write `then`" if then else "remove `:`",), edits=at.edit(" then" if then else "")
        )
        return Repair(problem, ("THEN",) if then else (), at.stop, sure=True)
    if at.found.type == "IF" and at.fits("MUL"):
        turned = at.matched(r"if\s+([^;{}\n]*?)\s+else\s+([^;{}\n]*)")
        if turned is None:
            return None
        problem = general(at, (f"write `if {turned[1]} then … else {turned[2]}`",))
        return Repair(problem, (), turned.end(), sure=True)
    return None


def _for_header(at: Situation) -> Repair | None:
    """`for (i in 1..3)`, `for i = 1..3`, `for i in range(3)`, `agent a[3]`"""
    previous = at.previous
    if previous is None:
        return None
    if previous.type == "FOR" and at.found.type == "LPAR" and at.fits("NAME"):
        head = at.matched(r"\(([^(){};]*)\)")
        if head is None:
            return None
        edits = at.edit(head[1], stop=head.end())
        problem = general(at, (f"write `for {head[1]}`",), edits=edits)
        return Repair(problem, ("NAME", "IN", "NUMBER", "_DOTS", "NUMBER"), head.end(), sure=True)
    if at.found.type == "_EQUAL" and at.fits("IN"):
        return Repair(general(at, ("write `in`",), edits=at.edit("in")), ("IN",), at.stop, sure=True)
    if previous.type == "LSQB" and at.found.type == "NUMBER" and at.accepts == {"NAME"}:
        size = at.matched(r"(?:1\s*\.\.\s*)?(\w+)")
        text = f"i in 1..{size[1]}" if size else "i in 1..n"
        problem = general(at, (f"write `{text}`",), edits=at.edit(text, stop=size.end() if size else None))
        stop = size.end() if size else at.stop
        return Repair(problem, ("NAME", "IN", "NUMBER", "_DOTS", "NUMBER"), stop, sure=True)
    return None


def _range_call(at: Situation) -> Repair | None:
    """`in range(3)` or `in 3` where `..` is missing."""
    if at.found.type not in ("LBRACE", "RSQB") or at.fits(at.found.type) or not at.fits("_DOTS"):
        return None
    found = re.search(r"\bin\s+(?:range\((\w+)\)|(\w+))\s*$", at.source.text[: at.start])
    if found is None:
        return None
    start, text = found.start(1 if found[1] is None else 0), f"in 1..{found[1] or found[2]}"
    edits = at.edit(text, found.start(), found.start() + len(found.group().rstrip()))
    problem = general(at, (f"write `{text}`",), wanted="`..`", edits=edits)
    return Repair(problem, ("_DOTS", "NUMBER"), at.start, sure=True) if start else None


def _increment(at: Situation) -> Repair | None:
    """`x += 1`, `x++`"""
    previous = at.previous
    if previous is None or previous.type != "NAME" or not any(map(at.fits, ("_ASSIGN", "_EQUAL", "PRIME"))):
        return None
    match = at.matched(r"([-+*/])=\s*([^;{}\n]*)|([-+])\3")
    if match is None:
        return None
    right = f"{previous} {match[1] or match[3]} {(match[2] or '1').strip()}"
    sign = ":=" if at.fits("_ASSIGN") else "="
    text = f"{previous} {sign} {right};"
    if sign == "=":
        problem = general(
            at, ("an equation says what a variable is; to change it by steps, assign it in `do` or `sample`",)
        )
    else:
        edits = at.edit(f" {sign} {right}", previous.end_pos, match.end())
        problem = general(at, (f"write `{text}`",), edits=edits)
    return Repair(problem, (sign_terminal(sign), "NUMBER"), match.end(), sure=True)


def sign_terminal(sign: str) -> str:
    """The terminal of `=` or `:=`."""
    return "_EQUAL" if sign == "=" else "_ASSIGN"


def _derivative_of(at: Situation) -> Repair | None:
    """`(v + u)'`, `time'`: only variables have derivatives."""
    previous = at.previous
    if (
        at.found.type != "PRIME"
        or previous is None
        or previous.type not in ("RPAR", "RSQB", "TIME", "NUMBER", "UNIT")
    ):
        return None
    if not at.fits("MUL") or at.fits("PRIME"):
        return None
    advice = (
        "the derivative of `time` is 1"
        if previous.type == "TIME"
        else "only a variable has a derivative: differentiate by hand, or write `transpose(…)`"
    )
    return Repair(general(at, (advice,), wanted="an operator"), (), at.stop, sure=True)


def _side_of_equation(at: Situation) -> Repair | None:
    """`2*x' = 1;`, `x + y = 1;`, `0 = x;`: the left side of an equation is one variable."""
    kind = block(at)
    if kind not in ("DIFF", "ALGE", "FOR") or at.fits(at.found.type):
        return None
    starts = at.previous is not None and at.previous.type in ("LBRACE", "SEMICOLON", "RBRACE")
    if at.found.type not in ("ADD", "MUL", "NUMBER", "LPAR", "POW") or not (
        at.fits("_EQUAL") or at.fits("PRIME") or starts
    ):
        return None
    equation = at.matched(r"[^;{}\n]*=[^;{}\n]*(?=;)")
    if equation is None or (at.found.type == "LPAR" and not starts):
        return None
    left = "x'" if kind == "DIFF" else "x"
    advice = f"solve for one variable: `{left} = …;`"
    return Repair(general(at, (advice,)), None, equation.end(), sure=True)


def _several_equations(at: Situation) -> Repair | None:
    """`x' = 1, v' = 2;`"""
    if (
        at.found.type != "COMMA"
        or not at.fits("SEMICOLON")
        or not at.matched(r",\s*\w+(\[[^\]]*\])?\s*'?\s*:?=")
    ):
        return None
    return Repair(general(at, ("write `;`",), edits=at.edit(";")), ("SEMICOLON",), at.stop, sure=True)


# ---- derivatives --------------------------------------------------------------------------------


def _derivative_call(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None or previous not in ("d", "der") or not at.fits("PRIME", "_EQUAL"):
        return None
    match = at.matched(r"(d|der)\s*\(\s*([A-Za-z_]\w*(?:\s*\[[^\]]*\])?)\s*\)\s*==?", previous.start_pos)
    if match is None:
        return None
    place = Span(at.source, *match.span())
    if previous == "d":
        return Repair(
            foreign_errors.CharonDerivative(place, match[2]), ("PRIME", "_EQUAL"), match.end(), sure=True
        )
    edits = at.edit(f"{match[2]}' =", *match.span())
    problem = foreign_errors.ModelicaForm(place, "der", f"write `{match[2]}' = …;`", edits)
    return Repair(problem, ("PRIME", "_EQUAL"), match.end(), sure=True)


def _quotient(at: Situation) -> Repair | None:
    """`dx/dt = v;`"""
    previous = at.previous
    match = at.matched(r"/\s*dt\s*==?")
    if (
        previous is None
        or match is None
        or not at.fits("PRIME", "_EQUAL")
        or not re.fullmatch(r"d\w+", previous)
    ):
        return None
    text = f"{previous[1:]}' ="
    edits = at.edit(text, previous.start_pos, match.end())
    problem = general(at, (f"write `{text} …;`",), wanted="`'`", edits=edits)
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
    "algorithm": "write `trans when … do { … }` or `sample every 10 [ms] { … }`",
    "initial": "write initial values with the declaration: `write real x = 0;`",
    "annotation": "comments begin with `//`, documentation with `///`",
    "flow": "data flow has a direction: declare `read` and `write` variables",
    "inner": "everything comes in by parameters and `read` variables",
    "outer": "everything comes in by parameters and `read` variables",
    "constant": "write `const real g = 9.81;`",
    "Real": "declare variables in an agent: `write real x = 1;`",
    "Integer": "write parameters in parentheses: `agent Name(int n = 1) { … }`",
    "Boolean": "write parameters in parentheses: `agent Name(bool on = true) { … }`",
}
#: Words that begin something in C, Python and MATLAB.
_OTHERS = {
    "class": "write `agent Name() { … }`",
    "struct": "write `agent Name() { … }`",
    "block": "write `agent Name() { … }`",
    "subsystem": "write `agent Name() { … }`",
    "module": "write `agent Name() { … }`",
    "package": "a file is a module: its name is the package's",
    "include": "write `import name;`",
    "using": "write `import name;`",
    "function": "write `func real f(real x) = …;`, at the top of a file",
    "def": "write `func real f(real x) = …;`, at the top of a file",
    "print": "name what to keep in an experiment: `record x;`",
    "plot": "write `hierc run FILE --plot picture.svg`",
    "assert": 'write `inv { x > 0 : "message"; }`',
    "event": "write `trans when … do { … }`",
    "param": "write parameters in parentheses: `agent Name(real k = 1) { … }`",
    "equations": "write equations under `diff { … }` and `alge { … }`",
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
        return Repair(foreign_errors.CharonControlPoint(at.place), None, at.start)
    if word in _MODELICA:
        modelica = foreign_errors.ModelicaForm(at.place, word, _MODELICA[word])
        return on_to_the_brace(at, modelica) or Repair(modelica, None, at.start)
    if word in _CHARON:
        return Repair(foreign_errors.CharonForm(at.place, word, _CHARON[word]), None, at.start)
    if word in _OTHERS and at.found.type == "NAME" and not at.fits("NAME"):
        problem = general(at, (_OTHERS[word],))
        return Repair(problem, None, _behind_head(at), sure=True)
    return None


def _behind_head(at: Situation) -> int:
    """Behind what stands up to the end of a line that ends as in Python."""
    head = at.matched(r"[^\n;{}]*(:|\))?[ \t\r]*(?=\n)")
    return head.end() if head else at.start


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
    name = _parameter(at, bracket)
    start = at.start if insert[0] == "NAME" else (at.previous.start_pos if at.previous else at.start)
    problem = general(
        at,
        (f"name the argument: `{name} = {text}`",),
        edits=at.edit(f"{name} = ", start, start) if name != "name" else (),
    )
    return Repair(problem, insert, at.start, sure=True)


def _parameter(at: Situation, bracket: Token) -> str:
    """The parameter that stands where the argument does, if the agent is defined in this text; else `name`."""
    inside = [token for token in at.before if (token.start_pos or 0) >= (bracket.start_pos or 0)]
    place = sum(token.type == "COMMA" for token in inside)
    agent = next((token for token in reversed(at.before[: -len(inside)]) if token.type == "NAME"), None)
    head = re.search(rf"\bagent\s+{agent}\s*\(([^(){{}};]*)\)", at.source.text)
    names = re.findall(r"\b(?:real|int|bool)\b\s*(?:\[[^\]]*\]\s*)?(\w+)", head[1]) if head else []
    return str(names[place]) if place < len(names) else "name"


RULES: tuple[Rule, ...] = (
    _list_in_braces,
    _range_with_colon,
    _range_call,
    _else_if,
    _choice,
    _for_header,
    _increment,
    _derivative_call,
    _quotient,
    _second_derivative,
    _derivative_of,
    _side_of_equation,
    _several_equations,
    _foreign_word,
    _argument_without_name,
)
