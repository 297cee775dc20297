"""A syntax error as the rules of `repairs.py` see it, and what they answer.

The rules look at the text and at the tokens around; of the parser they only ask "could you read these terminals now?"
(`fits`) and "with these put in, how many tokens of the text from here on could you read?" (`reach`, up to a limit).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from lark import Token, Tree

from hierc.grammar import errors, words
from hierc.grammar.problems import Problem
from hierc.grammar.source import SourceFile, Span

#: Closing brackets with those that they close.
CLOSERS = {"RPAR": "LPAR", "RSQB": "LSQB", "RBRACE": "LBRACE"}


@dataclass(frozen=True, slots=True)
class Situation:
    """The parser cannot take `found`, only one of `accepts`.

    `before` are all tokens read, `pending` those still on the parser's stack; `operands` are the three topmost entries
    after the reductions that `found` has led to; `vocabulary` maps each word of the language to its terminal.
    """

    source: SourceFile
    before: Sequence[Token]
    found: Token
    accepts: frozenset[str]
    pending: tuple[Token, ...]
    operands: tuple[Token | Tree[Token], ...]
    vocabulary: Mapping[str, str]
    fits: Callable[..., bool]
    reach: Callable[[tuple[str, ...], int], int]

    @property
    def previous(self) -> Token | None:
        """The token before, or None at the start."""
        return self.before[-1] if self.before else None

    @property
    def start(self) -> int:
        """Offset of the token found."""
        return self.found.start_pos or 0

    @property
    def stop(self) -> int:
        """Offset behind the token found."""
        return self.start + len(self.found)

    @property
    def place(self) -> Span:
        """The token found."""
        return Span(self.source, self.start, self.stop)

    def matched(self, pattern: str, start: int | None = None) -> re.Match[str] | None:
        """The text from the token found on, or from `start`, against a pattern."""
        return re.compile(pattern).match(self.source.text, self.start if start is None else start)

    @property
    def is_word(self) -> bool:
        """Whether the token found is a word of the language, here or elsewhere."""
        return self.found in self.vocabulary

    @property
    def is_first_on_line(self) -> bool:
        """Whether only blanks stand before the token found on its line."""
        return not self.source.text[self.source.text.rfind("\n", 0, self.start) + 1 : self.start].strip()

    @property
    def open_brackets(self) -> list[Token]:
        """The brackets that wait for their partner, outermost first."""
        waiting: list[Token] = []
        for token in self.pending:
            if token.type in CLOSERS.values():
                waiting.append(token)
            elif token.type in CLOSERS:
                waiting.pop()
        return waiting

    def innermost(self, kind: str) -> Token | None:
        """The innermost open bracket, if it is of this kind."""
        brackets = self.open_brackets
        return brackets[-1] if brackets and brackets[-1].type == kind else None


@dataclass(frozen=True, slots=True)
class Repair:
    """What is wrong; terminals to put in, reading on at `resume`; `insert` None to give up the statement from there on.

    After a `sure` repair the next problem is no echo of this one.
    """

    problem: Problem
    insert: tuple[str, ...] | None
    resume: int
    sure: bool = False
    closes_blocks: bool = False


def span_of(source: SourceFile, token: Token) -> Span:
    """The span of a token of the text."""
    start = token.start_pos or 0  # None only in tokens made by hand
    return Span(source, start, start + len(token))


#: One way to mend a text; None where it does not apply.
Rule = Callable[[Situation], Repair | None]


def general(
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


def on_to_the_brace(at: Situation, problem: Problem) -> Repair | None:
    """Where a block must begin and does so further along the line, what stands between is left out."""
    ahead = at.matched(r"[^\n{};]*(?=\{)")
    if ahead is None or not at.fits("LBRACE"):
        return None
    return Repair(problem, (), ahead.end(), sure=True)
