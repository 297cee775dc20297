"""The solvers that `hierc bench` compares: ours, scipy's, and of others those that are installed.

In: a `Problem`. Out: all states at its times, and how often the right-hand side was evaluated. All solve the same equations, others in machine code by one call
from Python; all have the same tolerances, absolute ones times the states' nominals.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.machine.whole import Derivatives
from hierc.runtime.run import Engine, FinishedRun
from hierc.runtime.system import System

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Evaluations after which the clock is looked at.
_GLANCE = 64


class Failed(Exception):
    """A solver gave up; the message says why."""


class TooLong(Failed):
    """A solver took longer than it may."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A model with its parameters: `system` has all states in one group, whose order all answers have. Times in s."""

    engine: Engine
    levels: System
    system: System
    derivatives: Derivatives
    settings: Mapping[str, Any]
    initial: Floats
    times: Floats

    @property
    def nominal(self) -> Floats:
        """Size of each state that its absolute tolerance is relative to."""
        return self.system.nominal


@dataclass(frozen=True, slots=True)
class Solved:
    """All states (times, n), and evaluations of right-hand sides: of the whole system, or with groups of each."""

    states: Floats
    evaluations: tuple[int, ...]


#: Solves a problem at a tolerance within some seconds. Raises Failed.
Solver = Callable[[Problem, float, float], Solved]


def solvers() -> dict[str, Solver]:
    """All that can be run here, by name."""
    found: dict[str, Solver] = {"hierc": _ours("auto"), "hierc, one group": _ours("one")}
    found |= {f"scipy {name}": _scipy(name) for name in ("RK45", "DOP853", "LSODA", "Radau")}
    if find_spec("sksundae"):
        found |= {f"SUNDIALS CVODE {name}": _cvode(name) for name in ("Adams", "BDF")}
    return found


# ---- ours -----------------------------------------------------------------------------------------


def _ours(group: str) -> Solver:
    def solve(problem: Problem, tolerance: float, limit: float) -> Solved:
        from hierc.runtime.grouping import grouped

        settings = {**problem.settings, "rtol": tolerance, "atol": tolerance}
        engine = grouped(problem.engine, group, problem.levels, settings, {})
        run = engine.run(engine.equations(problem.levels), settings, {}, progress=_until(limit))
        if not run.status.ok:
            raise Failed(run.status.message)
        states = run.groups.states(order(run.system, problem.system), problem.times)
        return Solved(states, tuple(_evaluations(run)))

    return solve


def order(given: System, wanted: System) -> Integers:
    """Where in the state vector of one system the states of another with the same elements are."""
    elements, there = wanted.elements, given.elements
    positions = [
        there.offsets[element] + np.arange(len(wanted.kind(element).states))
        for element in elements.order.tolist()
    ]
    return np.concatenate([np.zeros(0, np.int64), *positions])


def _evaluations(run: FinishedRun) -> Sequence[int]:
    records = run.groups.records
    if records is None:
        return []
    counts: list[int] = records["evaluations"][: len(run.groups)].tolist()
    return counts


def _until(limit: float) -> Callable[[float], None]:
    end = time.perf_counter() + limit

    def progress(_: float) -> None:
        if time.perf_counter() > end:
            raise TooLong(f"took longer than {limit:g} s")

    return progress


# ---- others ---------------------------------------------------------------------------------------


def _watched(problem: Problem, limit: float) -> Callable[[float, Floats], Floats]:
    """The right-hand side, which gives up when the time is over."""
    derivatives, progress = problem.derivatives, _until(limit)
    derivatives.evaluations = 0

    def evaluate(t: float, x: Floats) -> Floats:
        if derivatives.evaluations % _GLANCE == 0:
            progress(t)
        return derivatives(t, x)

    return evaluate


def _scipy(method: str) -> Solver:
    def solve(problem: Problem, tolerance: float, limit: float) -> Solved:
        from scipy.integrate import solve_ivp

        times = problem.times
        found = solve_ivp(
            _watched(problem, limit), (times[0], times[-1]), problem.initial, method, t_eval=times,
            rtol=tolerance, atol=tolerance * problem.nominal, max_step=problem.settings["max_step"],
        )  # fmt: skip
        if not found.success:
            raise Failed(found.message)
        return Solved(found.y.T, (problem.derivatives.evaluations,))

    return solve


def witness(method: str) -> Solver:
    """One of scipy's methods that ends a step at each of the times, so that nothing is interpolated."""

    def solve(problem: Problem, tolerance: float, limit: float) -> Solved:
        from scipy.integrate import solve_ivp

        evaluate, rows = _watched(problem, limit), [problem.initial]
        for span in pairwise(problem.times.tolist()):
            found = solve_ivp(
                evaluate, span, rows[-1], method, rtol=tolerance, atol=0.01 * tolerance * problem.nominal
            )
            if not found.success:
                raise Failed(found.message)
            rows.append(found.y[:, -1])
        return Solved(np.array(rows), (problem.derivatives.evaluations,))

    return solve


def _cvode(method: str) -> Solver:
    def solve(problem: Problem, tolerance: float, limit: float) -> Solved:
        from sksundae.cvode import CVODE

        evaluate, failures = _watched(problem, limit), list[Failed]()

        def into(t: float, x: Floats, dx: Floats) -> int:
            try:
                dx[:] = evaluate(t, x)
            except Failed as failure:  # would not come through C
                failures.append(failure)
                return -1
            return 0

        largest = problem.settings["max_step"]
        solver = CVODE(
            into, method=method, rtol=tolerance, atol=tolerance * problem.nominal, max_num_steps=10**9,
            max_step=largest if np.isfinite(largest) else 0.0,
        )  # fmt: skip
        found = solver.solve(problem.times, problem.initial)
        if failures:
            raise failures[0]
        if not found.success:
            raise Failed(str(found.message))
        return Solved(np.asarray(found.y), (problem.derivatives.evaluations,))

    return solve
