"""Did you mean …? Suggestions from the names of the right kind."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def suggestion(word: str, names: Iterable[str]) -> str | None:
    """The name most like `word`, or None when nothing is close."""
    candidates = sorted(set(names) - {word})
    by_case = [name for name in candidates if name.lower() == word.lower()]
    close = by_case or get_close_matches(word, candidates, n=1, cutoff=0.6)
    return close[0] if close else None


def did_you_mean(word: str, names: Iterable[str]) -> tuple[str, ...]:
    """The help line of an unknown name; empty when nothing is close."""
    close = suggestion(word, names)
    return (f"did you mean `{close}`?",) if close else ()


def listed(names: Iterable[str]) -> str:
    """Names in backquotes, with commas."""
    return ", ".join(f"`{name}`" for name in names)
