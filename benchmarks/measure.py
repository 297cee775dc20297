"""Timed runs of hierc: CPU time and achieved error for every method and tolerance.

CPU time is that of the process, the minimum of several runs after a warm-up. It covers `simulate` and the evaluation of all states at the
101 output times; `kernel` is the part of it spent in the integrator's loop.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np
from cases import Case
from numpy.typing import NDArray
from reference import PARTS, Reference

from hierc.runtime.model import Model
from hierc.runtime.result import Result, SimulationError
from hierc.runtime.simulation import Simulation

Floats = NDArray[np.float64]

#: Runs of one setting: at least the first number, then until the second (s) is spent, at most the third number.
_LEAST, _ENOUGH, _MOST = 3, 0.05, 30
#: A method whose run took longer, s, is not tried at tighter tolerances.
_PATIENCE = 3.0


@dataclass(frozen=True, slots=True)
class Run:
    """One solver at one tolerance. Times are CPU seconds; `evaluations` is per group of hierc, or one number."""

    case: str
    solver: str
    method: str
    tolerance: float
    error: float
    cpu: float
    kernel: float | None
    evaluations: tuple[int, ...]
    steps: tuple[int, ...] = ()


class Collected:
    """Runs by what they measured, each with the least times seen so far."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str, str, float], Run] = {}

    def add(self, runs: Iterable[Run]) -> None:
        """Take in runs; of two of the same kind the lesser times stay."""
        for run in runs:
            key = (run.case, run.solver, run.method, run.tolerance)
            old = self._runs.get(key, run)
            kernel = None if run.kernel is None or old.kernel is None else min(run.kernel, old.kernel)
            self._runs[key] = replace(run, cpu=min(run.cpu, old.cpu), kernel=kernel)

    @property
    def runs(self) -> tuple[Run, ...]:
        """All runs, in the order they first came."""
        return tuple(self._runs.values())


def sweep(
    case: Case, model: Model, methods: Sequence[str], tolerances: Sequence[float], reference: Reference
) -> Iterator[Run]:
    """Runs of one model; those that fail are left out."""
    for method in methods:
        for tolerance in tolerances:
            try:
                run = _measure(case, model, method, tolerance, reference)
            except SimulationError as failure:
                print(f"hierc {method} at {tolerance:g}: {failure}")
                continue
            yield run
            if run.cpu > _PATIENCE:
                break


def _measure(case: Case, model: Model, method: str, tolerance: float, reference: Reference) -> Run:
    result, states = solve(case, model, method, tolerance)  # warms up: machine code is loaded
    best, kernel, total, count = np.inf, np.inf, 0.0, 0
    while count < _LEAST or (total < _ENOUGH and count < _MOST):
        with kernel_clock() as spent:
            began = time.process_time()
            solve(case, model, method, tolerance)
            cpu = time.process_time() - began
        best, kernel, total, count = min(best, cpu), min(kernel, spent[0]), total + cpu, count + 1
    groups = result.stats.values()
    return Run(
        case.name, "hierc", method, tolerance, reference.error(states), best, kernel,
        tuple(g.evaluations for g in groups), tuple(g.steps for g in groups),
    )  # fmt: skip


def solve(case: Case, model: Model, method: str, tolerance: float) -> tuple[Result, Floats]:
    """One run through the public interface, and all states at the output times (101, n)."""
    result = model.simulate(
        stop=case.stop, rtol=tolerance, atol=tolerance, method=method, interval=case.stop / PARTS
    )
    return result, np.column_stack(list(result.columns(case.states).values()))


@contextmanager
def kernel_clock() -> Iterator[list[float]]:
    """CPU seconds spent in `Simulation.advance` inside the `with`, as the list's one element."""
    spent = [0.0]
    advance = Simulation.advance

    def timed(*args: Any, **kwargs: Any) -> Any:
        began = time.process_time()
        try:
            return advance(*args, **kwargs)
        finally:
            spent[0] += time.process_time() - began

    with mock.patch.object(Simulation, "advance", timed):
        yield spent
