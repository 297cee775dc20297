"""A syntax error as the rules of `repairs.py` see it, and what they answer.

The rules look at the text and at the tokens around; of the parser they only ask "could you read these terminals now?"
(`fits`) and "with these put in, how many tokens of the text from here on could you read?" (`reach`, up to a limit).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from lark import Token, Tree

from hierc.grammar import words
from hierc.grammar.problems import Edit, Problem
from hierc.grammar.source import SourceFile, Span

#: Closing brackets with those that they close.
CLOSERS = {"RPAR": "LPAR", "RSQB": "LSQB", "RBRACE": "LBRACE"}

_BRACES = re.compile(r"//[^\n]*|/\*[\s\S]*?(?:\*/|\Z)|\"(?:\\.|[^\"\\\n])*\"|[{}]")


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

    def outreaches(self, terminal: str, offset: int) -> bool:
        """Whether with this terminal put in, read on at `offset`, the text can be read at least as far as with any other put in here."""
        best = self.reach((terminal,), offset)
        return best > 0 and all(best >= self.reach((other,), self.start) for other in words.PHRASES)

    @property
    def is_balanced(self) -> bool:
        """Whether the text has a `}` for each `{`."""
        found = [match.group() for match in _BRACES.finditer(self.source.text)]
        return found.count("{") == found.count("}")

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

    def edit(self, text: str, start: int | None = None, stop: int | None = None) -> tuple[Edit, ...]:
        """`text` in place of the token found, or of what stands from `start` to `stop`."""
        begin = self.start if start is None else start
        return (Edit(Span(self.source, begin, self.stop if stop is None else stop), text),)

    def removal(self) -> tuple[Edit, ...]:
        """The token found taken out, with the blanks behind it."""
        blanks = self.matched(r"[ \t]*", self.stop)
        return self.edit("", stop=blanks.end() if blanks else None)

    def insertion(self, text: str) -> tuple[Edit, ...]:
        """`text` put in before the token found."""
        return self.edit(text, stop=self.start)

    @property
    def on_the_line_before(self) -> bool:
        """Whether the token before stands on the same line."""
        return (
            self.previous is not None
            and "\n" not in self.source.text[self.previous.end_pos or 0 : self.start]
        )

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
