"""Tokens with their comments: a source text taken apart in order, so that nothing in it can be lost.

In: a text that parses. The printer takes the tokens it expects one by one; each comes back as a document with the
comments that belong to it: those that follow it on its line, and those that stand on lines of their own before it. What
is not expected is a fault of the printer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

from hierc.grammar.formatting.layout import Aside, Break, Doc, concat

_BLANK = re.compile(r"\s*")
_COMMENT = re.compile(r"//[^\n]*|/\*[\s\S]*?\*/")
_STRING = re.compile(r'"(\\.|[^"\\\n])*"')


@dataclass(frozen=True, slots=True)
class Remark:
    """A comment and the number of line breaks before it. `text` has no blanks at the ends of its lines."""

    text: str
    breaks: int

    @property
    def ends_line(self) -> bool:
        return self.text.startswith("//")


class Piece(NamedTuple):
    """A token: the comments before it, its text, the comments after it."""

    lead: Doc
    text: str
    trail: Doc


class Tokens:
    """Reads a text token by token. `next` is the offset of the token that comes next."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.next = 0
        #: Whether what comes next, comment or token, is on a later line than the token before.
        self.break_ahead = False
        self._lead: list[Remark] = []  # comments that belong to the next token
        self._breaks = 0  # line breaks right before it
        self._passed: list[Remark] = []  # a comment of the token before that is to stand behind the next
        self._read_on(0, "")

    # ---- looking --------------------------------------------------------------------------------

    @property
    def blank_ahead(self) -> bool:
        """Whether a blank line stands before what comes next, comments included."""
        return (self._lead[0].breaks if self._lead else self._breaks) > 1

    def sees(self, text: str) -> bool:
        """Whether this text comes next."""
        return self.text.startswith(text, self.next)

    # ---- taking ---------------------------------------------------------------------------------

    def take(self, text: str) -> Doc:
        """The token that comes next, which must be `text`, with its comments."""
        return concat(*self.piece(text))

    def drop(self, text: str) -> Doc:
        """Only the comments of the token that comes next."""
        lead = self.lead(closing=True)
        return concat(lead, self.piece(text).trail)

    def take_string(self) -> Doc:
        """The string that comes next."""
        match = _STRING.match(self.text, self.next)
        assert match, self.next
        return self.take(match.group())

    def piece(self, text: str, shown: str | None = None) -> Piece:
        """As `take`, in parts; `shown` instead of the token's own text."""
        if not self.sees(text):
            raise AssertionError(f"expected `{text}` at {self.next}")
        lead = self.lead(closing=text in {")", "]", "}"})
        trail = self._read_on(self.next + len(text), text)
        return Piece(lead, text if shown is None else shown, trail)

    def lead(self, *, closing: bool = False) -> Doc:
        """The comments before the next token, once; before what closes a bracket no blank follows them."""
        parts: list[Doc] = []
        for i, remark in enumerate(self._lead):
            if remark.breaks:
                parts.append(Break(blank=i > 0 and remark.breaks > 1))
            elif i > 0:
                parts.append(" ")
            parts.append(remark.text)
        if self._lead:
            gap = "" if closing else " "
            parts.append(Break(blank=self._breaks > 1 and not closing) if self._breaks else gap)
        self._lead = []
        return concat(*parts)

    # ---- comments -------------------------------------------------------------------------------

    def _read_on(self, offset: int, token: str) -> Doc:
        """Go from the end of `token` to the token that comes next. Returns the comments that belong to `token`."""
        gap = _Gap.after(self.text, offset)
        belong = gap.belong_to(token)
        own, self._lead = [*self._passed, *gap.remarks[:belong]], gap.remarks[belong:]
        self.next, self._breaks = gap.stop, gap.breaks
        self.break_ahead = bool(self._passed or gap.breaks or any(remark.breaks for remark in gap.remarks))
        self._passed = own[-1:] if self._passes(own) else []
        return concat(*map(_after, own[: len(own) - len(self._passed)]))

    def _passes(self, own: list[Remark]) -> bool:
        """Whether the last comment before `,` or `;` is better placed behind it, where no other stands."""
        if not own or not own[-1].ends_line or self._lead or not (self.sees(",") or self.sees(";")):
            return False
        return not _Gap.after(self.text, self.next + 1).belong_to(self.text[self.next])


class _Gap(NamedTuple):
    """What stands between two tokens: comments, then line breaks up to the offset `stop`."""

    remarks: list[Remark]
    breaks: int
    stop: int

    @classmethod
    def after(cls, text: str, offset: int) -> _Gap:
        """The gap that begins at `offset`."""
        remarks: list[Remark] = []
        while True:
            blank = _BLANK.match(text, offset)
            stop = blank.end() if blank else offset
            breaks = text.count("\n", offset, stop)
            comment = _COMMENT.match(text, stop)
            if comment is None:
                return cls(remarks, breaks, stop)
            remarks.append(Remark("\n".join(map(str.rstrip, comment.group().split("\n"))), breaks))
            offset = comment.end()

    def belong_to(self, token: str) -> int:
        """How many of the comments say something about the token before: those on its line, unless they lead to the next."""
        behind = len(list(takewhile(lambda remark: remark.breaks == 0, self.remarks)))
        if token == "":  # the beginning of the file
            return 0
        if behind == 0 or self.remarks[behind - 1].ends_line:
            return behind
        inline = behind == len(self.remarks) and self.breaks == 0
        leads = token in {"(", "["} or (inline and token in {",", ";", "{"})
        return 0 if leads else behind


def _after(remark: Remark) -> Doc:
    """A comment behind a token."""
    return concat(Aside(f"  {remark.text}"), Break()) if remark.ends_line else f" {remark.text}"
