"""What is wrong at a syntax error, and how the text could go on.

In: a `Situation`, the parser's state around the token it cannot take. Out: a `Repair`, a problem in the user's terms with
the tokens to put in, or none where the statement is to be given up. The rules are tried from the particular to the
general; each looks at the text, not at parser internals, and asks the parser only "could you read this now?".
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

from lark import Token, Tree

from hierc.grammar import errors, words
from hierc.grammar.problems import Problem, closest
from hierc.grammar.situation import CLOSERS, Repair, Situation, span_of
from hierc.grammar.source import SourceFile, Span
from hierc.grammar.words import END, JUNK

LARGEST_INT = 2**53  # beyond it a float no longer tells neighbouring integers apart


Rule = Callable[[Situation], Repair | None]


def choose(at: Situation) -> Repair:
    """The first rule that applies; the last one always does."""
    for rule in RULES:
        if repair := rule(at):
            return repair
    return Repair(_general(at), None, at.start)


def literal_problems(source: SourceFile, token: Token) -> Iterator[Problem]:
    """Whether a number can be held as written."""
    value = float(token)
    vanishes = value == 0 and re.search("[1-9]", re.split("[eE]", token)[0]) is not None
    if math.isinf(value) or vanishes or (token.isdigit() and value > LARGEST_INT):
        yield errors.NumberOutOfRange(span_of(source, token), str(token), value)


# ---- characters and literals --------------------------------------------------------------------

_OTHER


def _reserved_word(at: Situation) -> Repair | None:
    """A word of the language where a name would fit, followed by something that may follow a name."""
    if at.found.type == "NAME" or not at.is_word:
        return None
    if not at.reach(("NAME",), at.stop):
        return None
    return Repair(errors.ReservedWord(at.place, str(at.found)), ("NAME",), at.stop, sure=True)


def _missing_semicolon(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None or not at.fits("SEMICOLON"):
        return None
    last = previous.end_pos or 0
    ends = at.found.type in ("RBRACE", END) or at.is_word or "\n" in at.source.text[last : at.start]
    if not ends or not at.reach(("SEMICOLON",), at.start):
        return None
    return Repair(errors.MissingSemicolon(Span(at.source, last, last)), ("SEMICOLON",), at.start)


def _misspelt_word(at: Situation) -> Repair | None:
    if at.found.type != "NAME" or len(at.found) < 3:
        return None
    accepted = {word: terminal for word, terminal in at.vocabulary.items() if terminal in at.accepts}
    if (word := closest(str(at.found), accepted)) is None:
        return None
    return Repair(_general(at, (f"did you mean `{word}`?",)), (accepted[word],), at.stop)


# ---- the general form ---------------------------------------------------------------------------

_PAIRS = (("LPAR", "RPAR"), ("RPAR", "SEMICOLON"), ("RSQB", "SEMICOLON"))


def _in_the_way(at: Situation) -> Repair | None:
    """A sign that nothing asks for: a second `;`, a bracket that closes nothing."""
    kind = at.found.type
    closes_nothing = kind in CLOSERS and all(b.type != CLOSERS[kind] for b in at.open_brackets)
    ends_nothing = kind == "SEMICOLON" and words.begins_statement(at.accepts)
    return _in_excess(at) if closes_nothing or ends_nothing else None


def _in_excess(at: Situation) -> Repair:
    after = "" if at.previous is None else str(at.previous)
    problem = errors.UnexpectedToken(
        at.place, "", after, words.found(at.found.type, at.found), ("remove it",)
    )
    return Repair(problem, (), at.stop)


def _left_out(at: Situation) -> Repair | None:
    """One or two tokens to put in, or a sign to leave out; the choice with which most of the text can be read."""
    if words.begins_statement(at.accepts):
        return None
    insertions: list[tuple[str, ...]] = [(terminal,) for terminal in words.PHRASES if terminal in at.accepts]
    changes = [(insert, at.start) for insert in [*insertions, *_PAIRS]]
    if at.found.type in (*CLOSERS, "COMMA", "SEMICOLON"):
        changes.append(((), at.stop))
    insert, resume = max(changes, key=lambda change: at.reach(*change))
    if not at.reach(insert, resume):
        return _on_to_the_brace(at, _general(at))
    if resume == at.stop:
        return _in_excess(at)
    bracket = at.innermost(CLOSERS[insert[0]]) if insert[0] in CLOSERS else None
    advice = ("write `()` where there is nothing to give",) if insert == ("LPAR", "RPAR") else ()
    return Repair(_general(at, advice, bracket), insert, resume)


def _on_to_the_brace(at: Situation, problem: Problem) -> Repair | None:
    """Where a block must begin and does so further along the line, what stands between is left out."""
    ahead = at.matched(r"[^\n{};]*(?=\{)")
    if ahead is None or not at.fits("LBRACE"):
        return None
    return Repair(problem, (), ahead.end())


def _general(
    at: Situation, advice: tuple[str, ...] = (), bracket: Token | None = None, expected: str = ""
) -> Problem:
    """`expected … after …, found …`."""
    return errors.UnexpectedToken(
        at.place,
        expected or words.expected(at.accepts),
        "" if at.previous is None else str(at.previous),
        words.found(at.found.type, at.found),
        advice,
        None if bracket is None else span_of(at.source, bracket),
    )


RULES: tuple[Rule, ...] = (
    _unclosed_string,
    _strange_characters,
    _number_without_digit,
    _derivative_call,
    _foreign_word,
    _equals_signs,
    _primes,
    _power_sign,
    _misplaced_unit,
    _half_a_unit,
    _chained_comparison,
    _unclosed_at_end,
    _unclosed_at_definition,
    _unclosed_at_outdent,
    _reserved_word,
    _missing_semicolon,
    _misspelt_word,
    _in_the_way,
    _left_out,
)
