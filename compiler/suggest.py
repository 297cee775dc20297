"""Did you mean …? Suggestions from the names of the right kind."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence
from itertools import combinations

from hierc.grammar.problems import Edit, closest
from hierc.grammar.source import Span


def did_you_mean(word: str, names: Iterable[str]) -> tuple[str, ...]:
    """The help line of an unknown name; empty when nothing is close."""
    close = closest(word, names)
    return (f"did you mean `{close}`?",) if close else ()


def edits_of(span: Span | None, word: str, names: Iterable[str]) -> tuple[Edit, ...]:
    """What `did_you_mean` says as an edit of `word` in `span`; none where the word stands there more than once."""
    close = closest(word, names)
    return respelt(span, word, close) if close else ()


def respelt(span: Span | None, word: str, instead: str) -> tuple[Edit, ...]:
    """`instead` for `word`, which stands somewhere in `span`."""
    if span is None:
        return ()
    found = [*re.finditer(rf"(?<!\w){re.escape(word)}(?!\w)", span.text)]
    if len(found) != 1:
        return ()
    start, stop = found[0].span()
    return (Edit(Span(span.file, span.start + start, span.start + stop), instead),)


def without_level(path: str, known: Container[str]) -> str | None:
    """`path` without one or two of its steps but the last, if that is known: levels are no part of paths."""
    *steps, last = path.split(".")
    kept = (k for fewer in (1, 2) if fewer <= len(steps) for k in combinations(steps, len(steps) - fewer))
    shorter = (".".join((*k, last)) for k in kept)
    return next((path for path in shorter if path in known), None)


def did_you_mean_without(shorter: str) -> str:
    """The help line for a path that goes through a level."""
    return f"did you mean `{shorter}`? Levels are no part of a path"


def import_line(name: str, module: str | None) -> tuple[str, ...]:
    """The help line of what `module` defines and nobody imported; empty where there is no such module."""
    return (f"add `from {module} import {name};`",) if module else ()


def import_edits(span: Span | None, name: str, module: str | None) -> tuple[Edit, ...]:
    """The same line put in at the top of the file that `span` is in."""
    if span is None or not module:
        return ()
    return (Edit(Span(span.file, 0, 0), f"from {module} import {name};\n"),)


def listed(names: Iterable[str]) -> str:
    """Names in backquotes, with commas."""
    return ", ".join(f"`{name}`" for name in names)


#: Steps of a closed path that a message spells out.
SPELLED_STEPS = 6


def abbreviated(parts: Sequence[str]) -> list[str]:
    """The steps of a closed path; of a long one the first few and the last, with how many are between."""
    if len(parts) <= SPELLED_STEPS:
        return list(parts)
    kept = list(parts[: SPELLED_STEPS - 2])
    return [*kept, f"… ({len(parts) - len(kept) - 1} more)", parts[-1]]
