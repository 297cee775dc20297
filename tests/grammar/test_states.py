"""Whatever stands in the way, wherever the parser is: one clear message at the place, in the user's terms.

Every state of the parser is reached by the shortest text that leads to it. Each terminal that cannot stand there, and the end of the
file, is put in; behind it the shortest text follows that ends what was begun.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

import pytest
from automaton import Automaton, Place, Terminals
from lark import Token

from hierc.grammar import errors, forms, words
from hierc.grammar.parser import _lark, parse
from hierc.grammar.problems import ModelError, Problem, apply
from hierc.grammar.render import render, to_json
from hierc.grammar.source import SourceFile

AUTOMATON = Automaton(_lark())
TERMINALS = sorted(AUTOMATON.samples)
PARTS = 8

#: Words for what may stand somewhere; nothing else may follow "expected".
PHRASES = {
    *words.PHRASES.values(),
    *(phrase for _, phrase in words._PLACES),
    *words._OPTIONAL.values(),
    *forms._NAMES.values(),
    *forms._CONTENTS.values(),
    "an expression",
    "an operator",
    "`read`, `write` or `private`",
    "the name of a parameter",
    "a name for the parameter",
    "the name of a read variable",
    "the name of a group",
}


@dataclass(frozen=True, slots=True)
class Case:
    """A text with an error at `offset`, and what is said of it."""

    text: str
    offset: int
    found: str
    problems: tuple[Problem, ...]
    #: Whether the parser stops there; else what was put in can stand there, and what follows it cannot.
    stops: bool


@cache
def places() -> tuple[Place, ...]:
    """A place for each state, those that several states share once."""
    unique = {place.before: place for place in AUTOMATON.places().values()}
    return tuple(unique[before] for before in sorted(unique, key=lambda before: (len(before), before)))


@cache
def cases(part: int) -> tuple[Case, ...]:
    found = (case_of(place, terminal) for place in places()[part::PARTS] for terminal in [*TERMINALS, ""])
    return tuple(case for case in found if case is not None)


def case_of(place: Place, terminal: str) -> Case | None:
    """A terminal, or the end of the file if empty, at a place; None where it can stand there."""
    terminals: Terminals = (*place.before, terminal, *place.after) if terminal else place.before
    text = AUTOMATON.text(terminals)
    upto = AUTOMATON.text((*place.before, terminal)) if terminal else text
    found = AUTOMATON.samples.get(terminal, "")
    problems = problems_of(text)
    stops = (terminal or "$END") not in possible(place)
    return Case(text, len(upto.rstrip()) - len(found), found, problems, stops) if problems else None


@cache
def possible(place: Place) -> frozenset[str]:
    """The terminals that the parser takes at a place."""
    parser = _lark().parse_interactive("")
    for terminal in place.before:
        parser.feed_token(Token(terminal, AUTOMATON.samples[terminal]))
    return frozenset(parser.accepts())


def problems_of(text: str) -> tuple[Problem, ...]:
    try:
        parse(SourceFile("case.hier", text))
    except ModelError as error:
        return error.problems
    return ()


def test_every_state_is_reached() -> None:
    """The places are those of all states; their texts can be read, and the parser's table has no state without a place."""
    found = AUTOMATON.places()
    assert set(found) == set(AUTOMATON.table)
    assert len(found) > 500
    for place in places():
        assert problems_of(AUTOMATON.text((*place.before, *place.after))) == ()


def test_every_terminal_has_a_sample() -> None:
    ignored = set(_lark().ignore_tokens)
    assert set(AUTOMATON.samples) == {terminal.name for terminal in _lark().terminals} - ignored


@pytest.mark.parametrize("part", range(PARTS))
def test_messages(part: int) -> None:
    """Every message names what may stand there or what to do, at the place, without a token's id."""
    count = 0
    for case in cases(part):
        count += 1
        first = case.problems[0]
        assert_is_placed(case, first)
        assert_is_specific(case, first)
        assert len(case.problems) <= 5, case.text
        for problem in case.problems:
            shown = render(problem)
            assert not re.search(r"\b_?(?:[A-Z]{3,}|[A-Z]+_[A-Z]+)\b", shown.replace("CHARON", "")), shown
            to_json(problem)
    assert count > 2000


def assert_is_placed(case: Case, problem: Problem) -> None:
    """The first problem is at the terminal put in or before it, on what is one thing with it; or it points at what was not closed."""
    assert problem.span is not None
    if isinstance(problem, errors.UnclosedBrace):
        assert problem.span.text == "{"
        assert problem.seen.start <= case.offset + len(case.found) or problem.seen_as == "the file ends here"
        return
    if case.stops and case.found != "[":  # which may begin what reads as a unit
        assert problem.span.start <= case.offset + len(case.found) + 1, case.text
    assert problem.span.stop >= len(case.text[: case.offset].rstrip()) - 3, case.text


def assert_is_specific(case: Case, problem: Problem) -> None:
    if not isinstance(problem, errors.UnexpectedText):
        assert problem.title()
        return
    if not problem.expected:
        assert problem.help() == ("remove it",)
        return
    assert problem.expected != "something else"
    rest = problem.expected
    for phrase in sorted(PHRASES, key=len, reverse=True):
        rest = rest.replace(phrase, "")
    assert re.fullmatch("(, | or )*", rest), problem.expected


@pytest.mark.parametrize("part", range(PARTS))
def test_edits_lead_on(part: int) -> None:
    """What an editor would change for the first problem takes that away and brings no other."""
    count = 0
    for case in cases(part):
        first = case.problems[0]
        if not (edits := first.edits()):
            continue
        count += 1
        mended = apply(edits, case.text)
        left = problems_of(mended)
        same = [p for p in left if (_begin(p), p.title()) == (_begin(first), first.title())]
        assert not same, (case.text, mended)
        # Only behind a block that is closed at last, what it holds may come to light.
        assert len(left) <= len(case.problems) or isinstance(first, errors.UnclosedBrace), (case.text, mended)
    assert count > 500


def _begin(problem: Problem) -> int:
    assert problem.span is not None
    return problem.span.start
