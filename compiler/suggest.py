"""Did you mean …? Suggestions from the names of the right kind."""

from __future__ import annotations

from collections.abc import Container, Iterable

from hierc.grammar.problems import closest


def did_you_mean(word: str, names: Iterable[str]) -> tuple[str, ...]:
    """The help line of an unknown name; empty when nothing is close."""
    close = closest(word, names)
    return (f"did you mean `{close}`?",) if close else ()


def without_level(path: str, known: Container[str]) -> str | None:
    """`path` without one of its steps but the last, if that is known: levels are no part of paths."""
    steps = path.split(".")
    shorter = (".".join(steps[:place] + steps[place + 1 :]) for place in range(len(steps) - 1))
    return next((path for path in shorter if path in known), None)


def did_you_mean_without(shorter: str) -> str:
    """The help line for a path that goes through a level."""
    return f"did you mean `{shorter}`? Levels are no part of a path"


def import_line(name: str, module: str | None) -> tuple[str, ...]:
    """The help line of what `module` defines and nobody imported; empty where there is no such module."""
    return (f"add `from {module} import {name};`",) if module else ()


def listed(names: Iterable[str]) -> str:
    """Names in backquotes, with commas."""
    return ", ".join(f"`{name}`" for name in names)
