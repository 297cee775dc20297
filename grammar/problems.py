"""Problems (diagnostics): what is wrong, where in the user's text, and what to do about it.

Each phase defines its problems in its own `errors.py` as frozen dataclasses derived from `Problem`; the wording is class data or a
short method. Rendering is in `render.py`; nothing here prints.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import ClassVar, Literal

from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class Label:
    """A span of the user's text with a short remark under it."""

    span: Span
    text: str = ""


@dataclass(frozen=True, slots=True)
class Edit:
    """A change to the user's text: `text` in place of `span`, which is empty where something is put in."""

    span: Span
    text: str


@dataclass(frozen=True)
class Problem:
    """One problem at one place. Subclasses add the fields that their wording needs."""

    code: ClassVar[str]
    severity: ClassVar[Literal["error", "warning"]] = "error"
    #: The page of this code in the error index: what it means, why it is so, what to write instead.
    explanation: ClassVar[str] = ""

    #: None only where there is no text to point at, as for a file that cannot be read.
    span: Span | None

    def title(self) -> str:
        """One line that names the problem in the user's own names."""
        raise NotImplementedError

    def remark(self) -> str:
        """Text beside the carets of the main span."""
        return ""

    def labels(self) -> tuple[Label, ...]:
        """Secondary places, each with a remark."""
        return ()

    def notes(self) -> tuple[str, ...]:
        """Background that explains the problem."""
        return ()

    def help(self) -> tuple[str, ...]:
        """What to do; text that can be pasted stands in backquotes."""
        return ()

    def edits(self) -> tuple[Edit, ...]:
        """The first help as changes that an editor can make, all at once; empty where the user has to choose."""
        return ()


class ModelError(Exception):
    """A model has errors. `problems` holds all that were found, in source order; never empty."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(f"[{p.code}] {p.title()}" for p in self.problems))


def in_place_of(span: Span | None, text: str) -> tuple[Edit, ...]:
    """One edit, or none where there is no text to change."""
    return () if span is None else (Edit(span, text),)


def apply(edits: Iterable[Edit], text: str) -> str:
    """The text with all edits made. They lie in this text and do not overlap."""
    for edit in sorted(edits, key=lambda e: e.span.start, reverse=True):
        text = text[: edit.span.start] + edit.text + text[edit.span.stop :]
    return text


def in_source_order(problems: Iterable[Problem]) -> list[Problem]:
    """Sorted by file name and place; those without a place come first, equal places keep their order."""
    return sorted(problems, key=lambda p: ("", -1) if p.span is None else (p.span.file.name, p.span.start))


def closest(name: str, candidates: Iterable[str]) -> str | None:
    """The candidate that `name` is most likely a slip for ("did you mean"), or None. Does not depend on their order."""
    ordered = sorted(set(candidates) - {name})
    folded = name.casefold()
    for candidate in ordered:
        if candidate.casefold() == folded:
            return candidate
    if similar := get_close_matches(name, ordered, n=1):
        return similar[0]
    return next(
        (c for c in ordered if folded.startswith(c.casefold()) or c.casefold().startswith(folded)), None
    )
