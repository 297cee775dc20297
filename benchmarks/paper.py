"""The paper's figures from hierc's own text:  python benchmarks/paper.py --into docs/paper.md

Esposito and Kumar, "Efficient dynamic simulation of robotic systems with hierarchy", ICRA 2001. Operations are counted, not timed (`flops.py`,
`ode45.py`), so a quiet machine is not needed. Pictures go to a folder beside the document.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import efficiency
import numpy as np
from counting import Floats
from document import put
from flops import Prices, Work, prices, run, settings, total
from ode45 import Solution, cost_of_a_step, ode45
from paper_figures import (
    efficiency_of_levels,
    efficiency_of_tolerances,
    equal_error,
    step_sizes,
    trajectories,
)
from scipy.integrate import solve_ivp
from tables import markdown

import hierc
from hierc.runtime.model import Model

_HERE = Path(__file__).parent
#: Times at which errors are measured: the transients at the start are among them.
_TIMES = 20_001
#: The paper's: from the loosest to the tightest.
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
#: For curves over achieved errors.
_SWEEP = (1e-3, *TOLERANCES, 1e-9)
ERRORS = (1e-4, 1e-5, 1e-6, 1e-7)
LEVELS = (3, 4, 5)
#: The counted beginning of a run: its tolerance, and its attempts; numbers in eight lanes take longer to count.
_COUNTED_AT = 1e-6
_COUNTED = {"abm5": (600, 2400), "radau13": (150, 400)}


@dataclass(frozen=True, slots=True)
class Problem:
    """A model, the length of its run (s), and its solution at all times with each state's largest size."""

    name: str
    model: Model
    stop: float
    known: Floats
    scale: Floats

    @property
    def times(self) -> Floats:
        return np.linspace(0.0, self.stop, _TIMES)

    def errors(self, states: Floats) -> tuple[float, float]:
        """The largest error, relative to the state's largest size, over the whole run and at 101 equally spaced times."""
        errors = np.abs(states - self.known) / self.scale
        return float(errors.max()), float(errors[:: (_TIMES - 1) // 100].max())

    @property
    def rhs_flops(self) -> int:
        """Operations of the whole system's right-hand side."""
        plan = self.model.plan
        return sum(plan.classes[node.kind].flops * node.count for node in plan.nodes)


@dataclass(frozen=True, slots=True)
class Run:
    """One integration: tolerance, errors as `Problem.errors` has them, and operations."""

    tolerance: float
    errors: tuple[float, float]
    work: Work


def problem(name: str, path: Path, stop: float) -> Problem:
    """A problem with its reference solution, by scipy's DOP853 on the model's right-hand side in Python."""
    model = hierc.load(path)
    times = np.linspace(0.0, stop, _TIMES)
    found = solve_ivp(model.rhs, (0.0, stop), model.initial(), "DOP853", times, rtol=1e-12, atol=1e-14)
    if not found.success:
        raise ValueError(f"DOP853 fails on {name}: {found.message}")
    return Problem(name, model, stop, found.y.T, np.abs(found.y).max(axis=1))


def multirate(p: Problem, priced: Sequence[Prices], method: str, tolerance: float) -> Run:
    """A run of ours."""
    chosen = settings(method, tolerance)
    finished = run(p.model, p.stop, chosen)
    states = np.hstack([group(p.times) for group in finished.groups])
    works = [price.work(group.stats) for price, group in zip(priced, finished.groups, strict=True)]
    return Run(tolerance, p.errors(states), total(works))


def single_rate(p: Problem, tolerance: float) -> Run:
    """A run of ode45."""
    start = p.model.initial()
    found: Solution = ode45(p.model.rhs, p.stop, start, tolerance, p.times)
    price = cost_of_a_step(p.model.rhs, p.stop, start, tolerance)
    right_hand_sides = float(found.evaluations * p.rhs_flops)
    steps = found.steps + found.rejected
    return Run(tolerance, p.errors(found.states), Work(right_hand_sides + steps * price, right_hand_sides))


def at_error(runs: Sequence[Run], error: float, which: int, of: Callable[[Work], float]) -> float:
    """Operations for an achieved error, between two runs by a straight line of logarithms. NaN beyond the runs."""
    points = sorted((run.errors[which], of(run.work)) for run in runs)
    errors, costs = np.log([e for e, _ in points]), np.log([c for _, c in points])
    return float(np.exp(np.interp(np.log(error), errors, costs, left=np.nan, right=np.nan)))


def all_operations(spent: Work) -> float:
    return spent.total


def of_right_hand_sides(spent: Work) -> float:
    return spent.right_hand_sides


class Comparison:
    """Runs of our methods and of ode45 on one problem, each made once."""

    def __init__(self, p: Problem) -> None:
        self.problem = p
        self.single = cache(lambda tolerance: single_rate(p, tolerance))
        priced = cache(
            lambda method: prices(p.model, p.stop, settings(method, _COUNTED_AT), None, _COUNTED[method])
        )
        self.multi = cache(lambda method, tolerance: multirate(p, priced(method), method, tolerance))

    def shares(self, method: str, error: float, which: int) -> tuple[float, float]:
        """Our operations over those of ode45 for an achieved error: of right-hand sides, and all."""
        ours = [self.multi(method, t) for t in _SWEEP]
        theirs = [self.single(t) for t in _SWEEP]
        right, everything = (
            at_error(ours, error, which, of) / at_error(theirs, error, which, of)
            for of in (of_right_hand_sides, all_operations)
        )
        return right, everything

    def at_tolerance(self, method: str, tolerance: float) -> float:
        """Our operations over those of ode45 at one tolerance."""
        return self.multi(method, tolerance).work.total / self.single(tolerance).work.total


# ---- tables -------------------------------------------------------------------------------------


def equal_errors_table(c: Comparison, method: str) -> str:
    """Shares of ode45's operations at achieved errors."""
    rows = []
    for which, label in enumerate(("over the whole run", "at 101 times")):
        found = [c.shares(method, error, which) for error in ERRORS]
        rows.append([f"right-hand sides, error {label}", *(percent(right) for right, _ in found)])
        rows.append([f"**all, error {label}**", *(percent(everything) for _, everything in found)])
    return markdown([f"{method} / ode45 at error", *(f"{e:.0e}" for e in ERRORS)], rows)


def tolerances_table(c: Comparison) -> str:
    """Runs at equal tolerances."""
    rows = []
    for tolerance in TOLERANCES:
        ours, theirs = c.multi("abm5", tolerance), c.single(tolerance)
        rows.append([
            f"{tolerance:.0e}", f"{theirs.errors[0]:.1e}", millions(theirs.work.total), f"{ours.errors[0]:.1e}",
            millions(ours.work.total), percent(c.at_tolerance("abm5", tolerance)),
        ])  # fmt: skip
    return markdown(
        ["tolerance", "error of ode45", "its Mflop", "error of abm5", "its Mflop", "abm5 / ode45"], rows
    )


def levels_table(measured: Sequence[efficiency.Measured]) -> str:
    """Break-even right-hand sides."""
    rows = [
        [str(m.levels), f"{efficiency.predicted_break_even(m.levels):.1f}", f"{m.break_even():.1f}"]
        for m in measured
    ]
    return markdown(["levels", "equation (9)", "measured"], rows)


def default_table(comparisons: Sequence[Comparison]) -> str:
    """The default method on all problems."""
    rows = []
    for c in comparisons:
        found = [c.shares("radau13", error, 0) for error in ERRORS]
        rows.append([f"{c.problem.name}, right-hand sides", *(percent(right) for right, _ in found)])
        rows.append([f"{c.problem.name}, all", *(percent(everything) for _, everything in found)])
    return markdown(["radau13 / ode45 at error", *(f"{e:.0e}" for e in ERRORS)], rows)


def percent(share: float) -> str:
    return "-" if np.isnan(share) else f"{100 * share:.1f} %"


def millions(count: float) -> str:
    return f"{count / 1e6:.1f}"


# ---- all of it ----------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print, and where asked write tables and pictures."""
    parser = argparse.ArgumentParser(description="Make the paper's figures again.")
    parser.add_argument("--into", type=Path, help="a document whose tables are to be replaced")
    parser.add_argument(
        "--pictures", type=Path, help="folder of the pictures; beside the document by default"
    )
    options = parser.parse_args(argv)
    folder = options.pictures or (options.into.parent if options.into else Path("build")) / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    cart = problem("cart", _HERE.parent / "models" / "cart.hier", 50.0)
    contact = problem("contact", _HERE / "models" / "contact.hier", 2.0)
    platoon = problem("platoon", _HERE.parent / "models" / "platoon.hier", 20.0)
    comparisons = [Comparison(p) for p in (cart, contact, platoon)]
    measured = [efficiency.measure(n) for n in LEVELS]
    shown = cart.model.simulate(stop=50.0, rtol=1e-6, atol=1e-6, method="abm5", interval=0.05)
    trajectories(shown, folder / "paper-fig3.png")
    step_sizes(shown, folder / "paper-fig4.png")
    efficiency_of_levels(measured, folder / "paper-fig2.png")
    shares = [comparisons[0].at_tolerance("abm5", t) for t in TOLERANCES]
    efficiency_of_tolerances(TOLERANCES, shares, folder / "paper-fig5.png")
    curves = {c.problem.name: [c.shares("radau13", e, 0) for e in ERRORS] for c in comparisons}
    equal_error(ERRORS, curves, folder / "paper-default.png")
    tables = {
        "levels": levels_table(measured),
        "equal error": equal_errors_table(comparisons[0], "abm5"),
        "equal tolerance": tolerances_table(comparisons[0]),
        "default": default_table(comparisons),
    }
    for name, text in tables.items():
        print(f"{name}\n\n{text}\n")
        if options.into:
            put(options.into, name, text)


if __name__ == "__main__":
    main()
