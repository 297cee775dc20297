"""Collecting problems: early phases find all they can, then stop the compilation.

A phase takes a `Collector`, adds what it finds, and calls `stop_on_errors` when it is done. `Rejected` leaves a single expression; the phase
that asked for its value catches it, keeps the problem, and goes on with the next one.
"""

from __future__ import annotations

from collections.abc import Container

from hierc.grammar.problems import ModelError, Problem, in_source_order
from hierc.grammar.source import Span


class Rejected(Exception):
    """An expression has no value. `problem` is None when what it needs was reported already."""

    def __init__(self, problem: Problem | None = None) -> None:
        self.problem = problem
        super().__init__(problem.title() if problem else "reported before")


class Collector:
    """Problems found so far, each once, in the order found."""

    def __init__(self) -> None:
        self._problems: dict[tuple[str, Span | str], Problem] = {}

    def add(self, problem: Problem) -> None:
        """Keep `problem`, unless the same code was already reported at the same place, or with the same title where there is none."""
        self._problems.setdefault((problem.code, problem.span or problem.title()), problem)

    def rejected(self, rejection: Rejected) -> None:
        """Keep the problem that `rejection` carries, if any."""
        if rejection.problem is not None:
            self.add(rejection.problem)

    def has_errors(self, *, but: Container[str] = ()) -> bool:
        """Whether anything found is an error of a code not in `but`."""
        return any(p.severity == "error" and p.code not in but for p in self._problems.values())

    def stop_on_errors(self, *, but: Container[str] = ()) -> None:
        """Raise ModelError with everything found, in source order, if any of it is an error of a code not in `but`."""
        if self.has_errors(but=but):
            raise ModelError(self.in_source_order())

    def in_source_order(self) -> tuple[Problem, ...]:
        """All problems by file and place."""
        return tuple(in_source_order(self._problems.values()))
