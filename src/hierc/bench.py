"""`hierc bench`: our runs of a model beside other solvers, at equal achieved error.

In: a model and tolerances. Out: `Bench`, every run with its error and time, and a table of the cheapest run within each error. Guaranteed: errors are
against a solution that a second, independent solver confirms, or it is said that none did.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.bench_solvers import Failed, Problem, Solved, Solver, TooLong, order, solvers, witness
from hierc.exits import UsageError
from hierc.runtime import partitions
from hierc.runtime.machine.whole import Derivatives
from hierc.runtime.model import Model
from hierc.screen import aligned

Floats = NDArray[np.float64]
#: Errors are taken at the ends of so many equal parts of the run.
PARTS = 100
#: The tolerance of our reference solution, and what confirms it: solvers with their tolerances, in the order in which they are tried.
REFERENCE = 1e-13
WITNESSES = (("DOP853", 1e-12), ("Radau", 1e-10))
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
#: Achieved errors that the table compares at.
TARGETS = (1e-3, 1e-5, 1e-7, 1e-9)
#: A run is done again, at most so often, until so many seconds are spent; the quickest counts.
_MOST, _ENOUGH = 20, 0.1


@dataclass(frozen=True, slots=True)
class Run:
    """One solver at one tolerance: the largest error of any state, relative to its largest size, and CPU time in s; or why it failed."""

    solver: str
    tolerance: float
    error: float | None
    seconds: float | None
    evaluations: tuple[int, ...]
    failure: str | None = None


@dataclass(frozen=True, slots=True)
class Bench:
    """All runs. `agreement`: by how much the reference and its witness differ, None if none came to an end."""

    model: str
    states: int
    stop: float
    witness: str | None
    agreement: float | None
    runs: tuple[Run, ...]

    @property
    def solvers(self) -> tuple[str, ...]:
        """Those that were run."""
        return tuple(dict.fromkeys(run.solver for run in self.runs))

    def cheapest(self, solver: str, error: float) -> Run | None:
        """The quickest run of a solver whose error is at most so large."""
        fit = [r for r in self.runs if r.solver == solver and r.error is not None and r.error <= error]
        return min(fit, key=lambda run: run.seconds or 0.0, default=None)


def bench(
    model: Model,
    settings: Mapping[str, Any],
    tolerances: Sequence[float] = TOLERANCES,
    limit: float = 60.0,
    tell: Callable[[str], None] = lambda _: None,
) -> Bench:
    """Run everything. `settings` holds start, stop and max_step; `limit` is how long a run may take, s. Raises UsageError for what cannot be compared."""
    problem = _problem(model, settings)
    known = solvers()
    tell(f"reference: hierc at a tolerance of {REFERENCE:g}")
    reference = _solved(known["hierc"], problem, REFERENCE, limit)
    if isinstance(reference, Failed):
        raise UsageError(f"there is nothing to compare with: {reference}")
    scale = np.abs(reference.states).max(axis=0)
    scale[scale == 0.0] = problem.nominal[scale == 0.0]

    def error(states: Floats) -> float:
        return float((np.abs(states - reference.states) / scale).max())

    confirmed, agreement = _confirmed(problem, limit, error, tell)
    runs: list[Run] = []
    for name, solver in known.items():
        tell(name)
        runs += _sweep(name, solver, problem, tolerances, limit, error)
    return Bench(
        model.plan.name, problem.system.size, float(problem.times[-1]), confirmed, agreement, tuple(runs)
    )


def _problem(model: Model, settings: Mapping[str, Any]) -> Problem:
    engine = model.engine.with_groups(partitions.one(model.engine.elements))
    levels = model.system()
    system = engine.equations(levels)
    if not system.size:
        raise UsageError(f"{model.plan.name} has no states: there is nothing to integrate")
    start, stop = float(settings["start"]), float(settings["stop"])
    initial = levels.initial(start)[order(levels, system)]
    if not np.isfinite(initial).all():
        raise UsageError(
            f"the initial values of {model.plan.name} are not all finite; `hierc run` tells where"
        )
    try:
        derivatives = Derivatives(system)
    except ValueError as error:
        raise UsageError(f"{model.plan.name} cannot be given to other solvers: {error}") from None
    whole = {"max_step": np.inf, "min_step": 0.0, "method": "auto", **settings}
    times = np.linspace(start, stop, PARTS + 1)
    return Problem(model.engine, levels, system, derivatives, whole, initial, times)


def _solved(solver: Solver, problem: Problem, tolerance: float, limit: float) -> Solved | Failed:
    """What a solver finds, or how it fails."""
    try:
        with np.errstate(all="ignore"):
            found = solver(problem, tolerance, limit)
    except Failed as failure:
        return failure
    except (ArithmeticError, ValueError, RuntimeError) as error:  # others fail in many ways
        return Failed(f"{type(error).__name__}: {error}")
    return found if np.isfinite(found.states).all() else Failed("its solution is not finite")


def _confirmed(
    problem: Problem, limit: float, error: Callable[[Floats], float], tell: Callable[[str], None]
) -> tuple[str | None, float | None]:
    for name, tolerance in WITNESSES:
        tell(f"its witness: scipy {name} at a tolerance of {tolerance:g}")
        found = _solved(witness(name), problem, tolerance, limit)
        if isinstance(found, Solved):
            return f"scipy {name}", error(found.states)
    return None, None


def _sweep(
    name: str,
    solver: Solver,
    problem: Problem,
    tolerances: Sequence[float],
    limit: float,
    error: Callable[[Floats], float],
) -> Iterator[Run]:
    """The runs of one solver; after one that takes too long no tighter ones."""
    for tolerance in sorted(tolerances, reverse=True):
        best, spent, count = np.inf, 0.0, 0
        found = _solved(solver, problem, tolerance, limit)  # warms up
        while isinstance(found, Solved) and (count == 0 or (spent < min(_ENOUGH, limit) and count < _MOST)):
            began = time.process_time()
            found = _solved(solver, problem, tolerance, limit)
            took = time.process_time() - began
            best, spent, count = min(best, took), spent + took, count + 1
        if isinstance(found, Failed):
            yield Run(name, tolerance, None, None, (), str(found))
            if isinstance(found, TooLong):
                return
            continue
        yield Run(name, tolerance, error(found.states), best, found.evaluations)


# ---- the report -----------------------------------------------------------------------------------


def report(found: Bench) -> str:
    """The table of the cheapest runs, and what it stands on."""
    lines = [f"{found.model}: {found.states} states, to {found.stop:g} s; CPU ms at an error of"]
    targets = [t for t in TARGETS if found.agreement is None or t >= 3.0 * found.agreement]
    head = ["", *(f"{t:g}" for t in targets), "failed" if any(run.failure for run in found.runs) else ""]
    rows = [
        [name, *(_cell(found.cheapest(name, t)) for t in targets), _failures(found, name)]
        for name in found.solvers
    ]
    lines += ["  " + line for line in aligned([head, *rows], left=1)]
    return "\n".join([*lines, "", _standing(found)]) + "\n"


def _cell(run: Run | None) -> str:
    return "-" if run is None or run.seconds is None else f"{1e3 * run.seconds:.3g}"


def _failures(found: Bench, name: str) -> str:
    failed = [run for run in found.runs if run.solver == name and run.failure]
    if not failed:
        return ""
    short = (failed[0].failure or "").splitlines()[0][:60]
    return f"{len(failed)} of {sum(run.solver == name for run in found.runs)}: {short}"


def _standing(found: Bench) -> str:
    checked = (
        "no other solver came to an end that could confirm it"
        if found.agreement is None
        else f"from which {found.witness} differs by {found.agreement:.1e}: smaller errors mean nothing"
    )
    return (
        f"Errors are the largest of any state at {PARTS + 1} times, relative to its largest size, against a run of hierc at {REFERENCE:g},\n"
        f"{checked}. Times are CPU times of a whole solve,\n"
        "the cheapest tolerance that achieves the error; others call the right-hand side in machine code, from Python."
    )
