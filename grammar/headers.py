"""Agents in agents, and the heads of blocks: modes, transitions, samples and what should stand in braces.

The rules are part of those in `repairs.py`, which states their contract.
"""

from __future__ import annotations

import re

from hierc.grammar import errors, forms
from hierc.grammar.forms import general
from hierc.grammar.misplaced import begins, is_agent
from hierc.grammar.situation import Repair, Rule, Situation
from hierc.grammar.source import Span
from hierc.grammar.words import END

# ---- agents in agents ---------------------------------------------------------------------------


def _unnamed_instance(at: Situation) -> Repair | None:
    """`agent B();`, `agent b B();`, `agent b = new B();`, and a definition inside an agent."""
    previous = at.previous
    kinds = [token.type for token in at.pending[-2:]]
    if previous is None or forms.block(at) == "FILE":
        return None
    if previous == "new" and at.found.type == "NAME":
        problem = general(at, ("remove `new`",), edits=at.edit("", previous.start_pos, at.start))
        return Repair(problem, (), at.stop, sure=True)
    if kinds != ["AGENT", "NAME"] or not at.fits("_EQUAL"):
        return None
    if at.found.type == "NAME":
        return Repair(general(at, ("write `=`",), edits=at.insertion("= ")), ("_EQUAL",), at.start, sure=True)
    if at.found.type != "LPAR":
        return None
    if at.matched(r"\([^{};]*\)\s*\{"):
        advice = f"define `{previous}` at the top of the file, and write `agent {_instance_name(previous)} = {previous}();` here"
        place = Span(at.source, previous.start_pos or 0, previous.end_pos or 0)
        problem = errors.MisplacedStatement(place, "the definition of an agent", forms.here(at), advice)
        return Repair(problem, None, at.start, sure=True)
    name = _instance_name(previous)
    edits = at.edit(f"{name} = ", previous.start_pos, previous.start_pos)
    problem = general(at, (f"write `agent {name} = {previous}(…);`",), edits=edits)
    return Repair(problem, ("_EQUAL", "NAME"), at.start, sure=True)


def _instance_name(agent: str) -> str:
    """A name for an instance: `motor` of `Motor`."""
    name = agent[0].lower() + agent[1:]
    return name if name != agent else f"{name}1"


def _coupling_without_brackets(at: Situation) -> Repair | None:
    """`agent b = B() u := x;`, `agent b = B() { u := x };`, `agent b = B() [x -> u];`"""
    if forms.statement(at) != "AGENT":
        return None
    match = at.matched(r"\{?\s*(\w+\s*:?=[^;{}\n\]]*?)\s*\}?\s*(?=;)")
    if (
        match
        and at.found.type in ("NAME", "LBRACE")
        and at.fits("LSQB")
        and at.previous
        and at.previous.type == "RPAR"
    ):
        text = f"[{match[1]}]"
        problem = general(
            at, (f"couplings stand in brackets: `{text}`",), edits=at.edit(text, stop=match.end())
        )
        return Repair(problem, (), match.end(), sure=True)
    arrow = at.matched(r"((?:\.\w+)*)\s*->\s*(\w+)")
    if arrow and at.fits("_ASSIGN") and at.previous:
        text = f"{arrow[2]} := {at.previous}{arrow[1]}"
        edits = at.edit(text, at.previous.start_pos, arrow.end())
        problem = general(at, (f"the input stands on the left: `{text}`",), edits=edits)
        return Repair(problem, ("_ASSIGN", "NUMBER"), arrow.end(), sure=True)
    return None


def _instance(at: Situation) -> Repair | None:
    """`B b;`, `B b(k = 1);` for an agent in an agent."""
    match = at.matched(r"([A-Za-z_]\w*)\s+([A-Za-z_]\w*)\s*(\([^;{}]*\))?\s*;")
    if match is None or at.found.type != "NAME" or not begins(at) or not at.fits("AGENT"):
        return None
    if not is_agent(at, f"{match[1]}("):
        return None
    text = f"agent {match[2]} = {match[1]}{match[3] or '()'};"
    return Repair(
        general(at, (f"write `{text}`",), edits=at.edit(text, stop=match.end())), None, at.start, sure=True
    )


# ---- blocks and headers -------------------------------------------------------------------------


def _block_without_braces(at: Situation) -> Repair | None:
    """`diff x' = v;`: what should stand in braces stands without them."""
    if at.found.type in ("LBRACE", "SEMICOLON", END) or not at.fits("LBRACE") or at.fits("SEMICOLON"):
        return None
    if not at.is_balanced:
        return None  # only the `{` is missing
    body = at.matched(r":?\s*\(?\s*([A-Za-z_][^;{}\n()]*(?:\([^;{}\n()]*\)[^;{}\n()]*)*;)[ \t]*\)?")
    if body is None or not at.on_the_line_before:
        return None
    statement = " ".join(body[1].split())
    start = at.previous.end_pos if at.previous else None
    edits = at.edit(f" {{ {statement} }}", start, body.end())
    word = f"{at.previous} " if at.previous and at.previous.type in forms.BLOCKS else ""
    problem = general(at, (f"write `{word}{{ {statement} }}`",), edits=edits)
    return Repair(problem, None, body.end() - 1, sure=True) if at.matched(r"[^;{}\n]*;") else None


def _body_missing(at: Situation) -> Repair | None:
    """`agent A()` with the next definition below it."""
    if not at.fits("LBRACE") or at.fits("SEMICOLON") or at.previous is None or at.previous.type != "RPAR":
        return None
    if not at.matched(r"(experiment|func|import|extern)\b|agent\s+\w+\s*\(|\Z") or (
        at.on_the_line_before and at.found
    ):
        return None
    last = at.previous.end_pos
    problem = general(at, ("write `{ }` for an empty block",), edits=at.edit(" { }", last, last))
    return Repair(problem, ("LBRACE", "RBRACE"), at.start, sure=True)


def _without_do(at: Situation) -> Repair | None:
    """`trans … when g { … }` and `trans … when g then { … }`"""
    brace = at.matched(r"(then\s*)?\{")
    if brace is None or not at.fits("DO", "LBRACE"):
        return None
    edits = at.edit("do {", stop=brace.end())
    return Repair(general(at, ("write `do {`",), edits=edits), ("DO",), brace.end() - 1, sure=True)


def _transition(at: Situation) -> Repair | None:
    """`trans a to b when g`, `trans a -> b when g`, `trans from a to b if g`"""
    arrow = at.matched(r"([A-Za-z_][\w.]*)\s*(?:to|->)\s*([A-Za-z_][\w.]*)")
    if arrow and at.previous and at.previous.type == "TRANS" and at.fits("FROM"):
        text = f"from {arrow[1]} to {arrow[2]}"
        problem = general(at, (f"write `trans {text}`",), edits=at.edit(text, stop=arrow.end()))
        return Repair(problem, ("FROM", "NAME", "TO", "NAME"), arrow.end(), sure=True)
    if at.found.type == "IF" and at.fits("WHEN"):
        return Repair(general(at, ("write `when`",), edits=at.edit("when")), ("WHEN",), at.stop, sure=True)
    return None


def _first_mode(at: Situation) -> Repair | None:
    """`init m { … }`, `mode init m { … }`, `init { x = 0; }` in an agent."""
    previous = at.previous
    if previous is None or forms.block(at) == "EXPERIMENT":
        return None
    if previous.type == "INIT" and at.found.type == "NAME" and at.fits("MODE"):
        problem = general(at, (f"write `init mode {at.found}`",), edits=at.insertion("mode "))
        return Repair(problem, ("MODE",), at.start, sure=True)
    if previous.type == "MODE" and at.found.type == "INIT":
        edits = at.edit("init mode", previous.start_pos)
        return Repair(general(at, ("write `init mode`",), edits=edits), (), at.stop, sure=True)
    if previous.type == "INIT" and at.found.type == "LBRACE":
        advice = "initial values stand with the declaration: `write real x = 0;`"
        problem = errors.MisplacedStatement(
            Span(at.source, previous.start_pos or 0, previous.end_pos or 0),
            "`init { … }`",
            forms.here(at),
            advice,
        )
        return Repair(problem, None, at.start, sure=True)
    return None


def _message(at: Situation) -> Repair | None:
    """`inv { x > 0 "too low"; }`"""
    if at.found.type != "STRING" or not at.fits("COLON"):
        return None
    return Repair(
        general(at, ("write `:` before the message",), edits=at.insertion(": ")),
        ("COLON",),
        at.start,
        sure=True,
    )


def _several_conditions(at: Situation) -> Repair | None:
    """`inv { x > 0, x < 1; }`"""
    if (
        at.found.type != "COMMA"
        or forms.block(at) != "INV"
        or not at.fits("SEMICOLON")
        or at.innermost("LPAR")
    ):
        return None
    return Repair(general(at, ("write `;`",), edits=at.edit(";")), ("SEMICOLON",), at.stop, sure=True)


def _definition_with_arguments(at: Situation) -> Repair | None:
    """`let f(x) = x;`"""
    match = at.matched(r"\(([^(){};\n]*)\)\s*=\s*([^{};\n]*);")
    if match is None or at.previous is None or forms.statement(at) != "LET" or not at.fits("_EQUAL"):
        return None
    params = ", ".join(f"real {name.strip()}" for name in match[1].split(","))
    advice = f"write `func real {at.previous}({params}) = {match[2].strip()};` at the top of a file"
    return Repair(general(at, (advice,)), None, at.start, sure=True)


def _names_in_brackets(at: Situation) -> Repair | None:
    """`group g = [a, b];`, `record [x, y];`"""
    match = at.matched(r"\[([\w., *]+)\]")
    if match is None or forms.statement(at) not in ("GROUP", "RECORD") or at.accepts != {"NAME"}:
        return None
    text = ", ".join(part.strip() for part in match[1].split(","))
    return Repair(
        general(at, (f"write `{text}`",), edits=at.edit(text, stop=match.end())),
        ("NAME",),
        match.end(),
        sure=True,
    )


def _sample_rate(at: Situation) -> Repair | None:
    """`sample Ts { … }`, `sample every Ts do { … }`"""
    if at.found.type == "DO" and at.fits("LBRACE"):
        start = at.previous.end_pos if at.previous else at.start
        return Repair(general(at, ("remove `do`",), edits=at.edit("", start)), (), at.stop, sure=True)
    if at.fits("RATE", "NUMBER") and at.found.type in ("NAME", "NUMBER"):
        problem = general(at, (f"write `sample every {at.found}`",), edits=at.insertion("every "))
        return Repair(problem, ("RATE",), at.start, sure=True)
    return None


def _header(at: Situation) -> Repair | None:
    """`agent A(): B {`, `agent A = B() { }`, `experiment e(A) { }`, `mode m() { }`, `level a = {`"""
    if at.found.type not in ("COLON", "_EQUAL", "LPAR", "LSQB", "SEMICOLON") and at.found != ":":
        return None
    if not at.fits("LBRACE") or at.fits(at.found.type):
        return None
    if at.found.type == "SEMICOLON":
        problem = general(at, ("write `{ }` for an empty block",), edits=at.edit(" { }"))
        return Repair(problem, ("LBRACE", "RBRACE"), at.stop, sure=True)
    ahead = at.matched(r"[^\n{};]*(?=\{)")
    if ahead is None:
        return None
    words = f"remove `{' '.join(ahead.group().split())}`"
    start = at.previous.end_pos if at.previous else at.start
    return Repair(general(at, (words,), edits=at.edit(" ", start, ahead.end())), (), ahead.end(), sure=True)


def _experiment_head(at: Situation) -> Repair | None:
    """`experiment e(A)`, `experiment A()`, `experiment e = A()`, `experiment e for A()`, `experiment of A()`"""
    kinds = [token.type for token in at.pending[-2:]]
    if kinds[-1:] == ["EXPERIMENT"] and at.found.type == "OF":
        return Repair(
            general(at, ("write `experiment e of`",), edits=at.insertion("e ")),
            ("NAME",),
            at.start,
            sure=True,
        )
    if kinds != ["EXPERIMENT", "NAME"] or at.found.type not in ("LPAR", "_EQUAL", "FOR", "COLON"):
        return None
    name = str(at.previous)
    empty = at.matched(r"\(\s*\)|\(\s*\w+\s*=")
    if at.found.type == "LPAR" and empty:
        edits = at.edit(f"e of {name}", at.before[-1].start_pos, at.before[-1].end_pos)
        problem = general(at, (f"name the experiment: `experiment e of {name}`",), edits=edits)
        return Repair(problem, ("OF", "NAME"), at.start, sure=True)
    inside = at.matched(r"\(\s*(\w+)\s*\)")
    if inside:
        problem = general(
            at,
            (f"write `experiment {name} of {inside[1]}()`",),
            edits=at.edit(f" of {inside[1]}()", stop=inside.end()),
        )
        return Repair(problem, ("OF", "NAME", "LPAR", "RPAR"), inside.end(), sure=True)
    if at.found.type == "LPAR":
        return None
    return Repair(
        general(at, ("write `of`",), edits=at.edit("of")),
        ("OF",),
        at.stop,
        sure=True,
    )


def _import_form(at: Situation) -> Repair | None:
    """`import "a.hier";`, `from a import *;`, `import a.b.*;`, `import a, b;`, `from a import b as c;`"""
    if (
        not at.pending
        or not any(t.type in ("IMPORT", "FROM") for t in at.pending)
        or forms.block(at) != "FILE"
    ):
        return None
    if at.found.type == "STRING" and at.fits("NAME"):
        path = re.sub(r"\.hier$", "", str(at.found)[1:-1]).strip("./")
        text = re.sub(r"\W+", ".", path) or "name"
        problem = general(at, (f"write `import {text};`",), edits=at.edit(text))
        return Repair(problem, ("NAME",), at.stop, sure=True)
    if at.matched(r"\.?\*"):
        problem = general(
            at, ("names are imported one by one: `from a import B, C;`, or the file as `import a;`",)
        )
        return Repair(problem, ("NAME",) if at.fits("NAME") else None, at.stop, sure=True)
    if at.found.type == "COMMA" and at.fits("SEMICOLON"):
        problem = general(at, ("write an `import` for each file",), edits=at.edit("; import"))
        return Repair(problem, ("SEMICOLON", "IMPORT"), at.stop, sure=True)
    if at.found.type == "AS":
        problem = general(at, ("only files get another name: `import a as m;`",))
        return Repair(problem, None, at.start, sure=True)
    return None


def _function_body(at: Situation) -> Repair | None:
    """`func real f(real x) { return …; }`"""
    if at.found.type != "LBRACE" or not at.fits("_EQUAL") or not any(t.type == "FUNC" for t in at.pending):
        return None
    head = next(t.start_pos or 0 for t in reversed(at.pending) if t.type == "FUNC")
    head_text = " ".join(at.source.text[head : at.start].split())
    body = at.matched(r"\{\s*return\s+([^;{}]*);\s*\}")
    right = " ".join(body[1].split()) if body else "…"
    edits = at.edit(f"= {right};", stop=body.end()) if body else ()
    problem = general(at, (f"a function is one expression: `{head_text} = {right};`",), edits=edits)
    return Repair(problem, None, at.start)


#: Tried before declarations and statements.
HEADS: tuple[Rule, ...] = (_function_body, _import_form, _experiment_head, _header)

RULES: tuple[Rule, ...] = (
    _instance,
    _unnamed_instance,
    _coupling_without_brackets,
    _first_mode,
    _message,
    _several_conditions,
    _definition_with_arguments,
    _names_in_brackets,
    _body_missing,
    _without_do,
    _transition,
    _sample_rate,
    _block_without_braces,
)
