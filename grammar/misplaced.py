"""Statements in the wrong place, and statements that lack their first word.

The rules are part of those in `repairs.py`, which states their contract. They apply where a statement may begin, so that an equation
outside `diff` or a setting outside an experiment is named as what it is.
"""

from __future__ import annotations

import re

from hierc.grammar import errors, forms, words
from hierc.grammar.forms import general
from hierc.grammar.problems import Edit
from hierc.grammar.situation import Repair, Rule, Situation

_TOP = "it stands at the top of a file"
_AGENT = "it stands in an agent"
_AGENT_OR_MODE = "it stands in an agent or a mode"
_EXPERIMENT = "it stands in an experiment: `experiment e of A() { … }`"

#: Where a statement stands, by its first word and how it goes on.
_HOMES = (
    (r"(import|from|func|extern|experiment)\b", _TOP),
    (r"table\s+\w+\s*\(", _TOP),
    (r"(read|write|private)\b", _AGENT),
    (r"(let|diff|alge|inv|trans|mode)\b", _AGENT_OR_MODE),
    (r"init(?=\s+mode\b)", _AGENT_OR_MODE),
    (r"init(?=\s*\{)", "initial values stand with the declaration: `write real x = 0;`"),
    (r"(level)\s+\w+\s*\{", _AGENT),
    (r"(sample|group|const|agent)\b", _AGENT),
    (r"(record|save)\s+[\w\"]", _EXPERIMENT),
    (r"for\b", "it stands under `diff` or `alge`"),
    (r"when\b", "write `trans when … do { … }`, in an agent or a mode"),
    (r"(if)\b", "`if` chooses between values: `x = if … then … else …;`"),
    (r"(while|switch|case|return|goto|break)\b", "there are no such statements: a model states equations"),
    (r"(every|at)\b", "write `sample every 10 [ms] { … }`, in an agent"),
    (r"nominal\b", "it ends a declaration: `write real x = 0 nominal 1;`"),
)  # fmt: skip

_SETTINGS = frozenset(
    {"stop", "start", "rtol", "atol", "interval", "max_step", "min_step", "method", "order", "on_violation"}
)
_EQUATION = r"(?P<left>[A-Za-z_]\w*(?:\s*\[[^\]\n;]*\])?)\s*(?P<prime>'?)\s*(?P<sign>=(?!=)|:=|==)\s*(?P<right>[^;{}\n]*)(?P<end>;?)"


def begins(at: Situation) -> bool:
    """Whether a statement of some kind may begin at the error, after another one or at the start of its block."""
    kind = at.previous.type if at.previous else "SEMICOLON"
    return kind in ("SEMICOLON", "LBRACE", "RBRACE") and (
        words.begins_statement(at.accepts) or "RBRACE" in at.accepts
    )


def _word_elsewhere(at: Situation) -> Repair | None:
    """A statement known by its first word, where it does not belong."""
    if not begins(at):
        return None
    for pattern, home in _HOMES:
        if match := at.matched(pattern):
            word = match.group().split()[0]
            advice = f"{home}: `{_example(word)}`" if home in (_TOP, _AGENT, _AGENT_OR_MODE) else home
            if word == "let" and forms.block(at) == "FILE":
                advice = "at the top of a file write `const real g = 9.81;`"
            problem = errors.MisplacedStatement(at.place, f"`{at.found}`", forms.here(at), advice)
            return Repair(problem, None, _after_else(at))
    return None


def _example(word: str) -> str:
    if word == "agent":
        return forms.INSTANCE_FORM[1]
    if word in ("read", "write", "private"):
        return re.sub("^write", word, forms.FORMS["ACCESS"][1]) if word != "read" else "read real u [m];"
    return forms.FORMS["MODE" if word == "init" else word.upper()][1]


def _after_else(at: Situation) -> int:
    """Where to go on: behind `if … then …;`, if an `else` follows it."""
    both = at.matched(r"if\b[^;{}]*;\s*(?=else\b)")
    return both.end() if both else at.start


def _equation(at: Situation) -> Repair | None:
    """`x' = v;` or `x = v;` where neither equation nor setting can stand."""
    if at.found.type != "NAME" or not begins(at) or at.fits("NAME"):
        return None
    match = at.matched(_EQUATION)
    if match is None:
        return _increment(at)
    here, text = forms.here(at), " ".join(match.group().split())
    what = "a derivative" if match["prime"] else "an equation"
    edits: tuple[Edit, ...] = ()
    if forms.block(at) == "FILE" and not match["prime"]:
        what, instead = "a value", f"const real {text}"
        edits, advice = at.insertion("const real "), f"write `{instead}`, or declare it in an agent"
    elif match["left"] in _SETTINGS:
        what, advice = "a setting", f"settings stand in an experiment: `experiment e of A() {{ {text} }}`"
    elif is_agent(at, match["right"]):
        problem = general(at, (f"write `agent {text}`",), edits=at.insertion("agent "))
        return Repair(problem, ("AGENT",), at.start, sure=True)
    elif match["sign"] == ":=" and not match["prime"]:
        what, advice = (
            "an assignment",
            "assignments stand in the `do` block of a `trans` and in `sample` blocks",
        )
    elif forms.block(at) in ("EXPERIMENT", "FILE"):
        advice = "equations stand in agents, under `diff` and `alge`"
    else:
        kind = "diff" if match["prime"] else "alge"
        also = "" if match["prime"] else f", or `let {text}` for a name that is not declared"
        advice = f"write `{kind} {{ {text} }}`{also}"
        edits = (*at.insertion(f"{kind} {{ "), *at.edit(" }", match.end(), match.end()))
    problem = errors.MisplacedStatement(at.place, what, here, advice, edits if match["end"] else ())
    return Repair(problem, None, at.start)


def _increment(at: Situation) -> Repair | None:
    """`x += 1;` and `x++;`"""
    if not at.matched(r"\w+\s*(\+\+|--|[-+*/]=)"):
        return None
    advice = "write `x := x + 1;` in the `do` block of a `trans` or in a `sample` block"
    return Repair(
        errors.MisplacedStatement(at.place, "an assignment", forms.here(at), advice), None, at.start
    )


def is_agent(at: Situation, right: str) -> bool:
    """Whether `B(…)` is an agent: one of this text, or one that is called like one."""
    call = re.match(r"([A-Za-z_]\w*)\s*\(", right)
    if call is None:
        return False
    return call[1][0].isupper() or re.search(rf"\bagent\s+{call[1]}\s*\(", at.source.text) is not None


def _path_in_experiment(at: Situation) -> Repair | None:
    """`cart.x = 1;` in an experiment."""
    match = at.matched(r"(\w+(?:\.\w+)+)\s*=\s*([^;{}\n]*);", at.previous.start_pos) if at.previous else None
    if match is None or at.found.type != "DOT" or forms.block(at) != "EXPERIMENT" or not at.fits("_EQUAL"):
        return None
    advice = f"write `init {{ {match.group()} }}` for an initial value; parameters stand in the parentheses after the agent's name"
    start = match.start()
    edits = (*at.edit("init { ", start, start), *at.edit(" }", match.end(), match.end()))
    return Repair(
        errors.MisplacedStatement(at.place, "a path", "before `=` here", advice, edits), None, at.start
    )


RULES: tuple[Rule, ...] = (
    _path_in_experiment,
    _equation,
    _word_elsewhere,
)
