"""Did you mean …? Suggestions from the names of the right kind."""

from __future__ import annotations

from collections.abc import Iterable

from hierc.grammar.problems import closest


def did_you_mean(word: str, names: Iterable[str]) -> tuple[str, ...]:
    """The help line of an unknown name; empty when nothing is close."""
    close = closest(word, names)
    return (f"did you mean `{close}`?",) if close else ()


def listed(names: Iterable[str]) -> str:
    """Names in backquotes, with commas."""
    return ", ".join(f"`{name}`" for name in names)
