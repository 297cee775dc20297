"""Counted operations: of generated text, of whole runs, of ode45; and the paper's formula."""

from __future__ import annotations

import counting
import numpy as np
import ode45
import pytest
import tally
from efficiency import CG, PC, PE, predicted, predicted_break_even
from flops import prices, settings, spent
from scipy.integrate import solve_ivp

import hierc
from hierc.runtime.machine.unit import parse_function
from hierc.runtime.model import Model
from hierc.runtime.simulation import Simulation


def test_numbers_count() -> None:
    meter = counting.Meter()
    x = counting.Number(3.0, meter)
    names = counting.dialect(meter)
    meter.wrap(0, "sums", lambda: 2.0 * x + x / x - (-x))()
    meter.wrap(0, "dialect", lambda: names["fma"](x, 2.0, names["max"](x, 1.0)) + names["math"].sqrt(x))()
    meter.wrap(0, "lanes", lambda: np.array([x, x]) * x < 1.0)()
    assert meter.flops == {(0, "sums"): 4, (0, "dialect"): 2 + 1 + 1 + 20, (0, "lanes"): 2 + 2}


@pytest.mark.parametrize("name", ["cart", "servo", "boat", "platoon"])
def test_text_is_counted_as_the_compiler_does(name: str) -> None:
    for kind in hierc.load(name).plan.classes:
        counted = tally.flops(parse_function(kind.rhs))
        assert counted == kind.flops
        assert sum(tally.halves(kind.rhs)) == kind.flops


@pytest.mark.parametrize(
    ("method", "beginning", "attempts"), [("abm5", (400, 900), 1500), ("radau13", (50, 100), 160)]
)
def test_a_run_costs_what_its_counters_say(method: str, beginning: tuple[int, int], attempts: int) -> None:
    """Every operation of a longer run, counted one by one, beside prices from its beginning times its counters."""
    model = hierc.load("cart")
    chosen = settings(method, 1e-6)
    priced = prices(model, 50.0, chosen, None, beginning)
    run = tally.CountedRun(_simulation(model, chosen))
    run.advance(attempts)
    each = [spent(run, g) for g in range(4)]
    counted = sum(sum(flops.values()) for flops, _ in each)
    said = sum(price.work(counters).total for price, (_, counters) in zip(priced, each, strict=True))
    assert said == pytest.approx(counted, rel=0.03)


def _simulation(model: Model, chosen: dict[str, object]) -> Simulation:
    decided = model.engine.group_settings(chosen, {})
    return Simulation(model.engine, model.system(), decided, model.initial(), 0.0, 50.0)


def test_a_counted_run_is_the_run() -> None:
    """Numbers that count change no number: its steps are those of machine code."""
    model = hierc.load("cart")
    simulation = _simulation(model, settings("abm5", 1e-4))
    run = tally.CountedRun(simulation)
    run.advance(300)
    simulation.attempt(300)
    for g, record in enumerate(run.groups):
        assert counting.plain(record.t) == pytest.approx(float(simulation.groups["t"][g]), rel=1e-6)
        assert abs(record.count - int(simulation.groups["count"][g])) <= 1


# ---- ode45 ----------------------------------------------------------------------------------------


def oscillator(t: float, y: np.ndarray) -> np.ndarray:
    return np.array([y[1], -np.sin(y[0])])


def test_its_coefficients_are_those_of_dormand_and_prince() -> None:
    for c, row in zip(ode45.C, ode45.A, strict=True):
        assert sum(row) == pytest.approx(c, abs=1e-14)
    assert sum(ode45.ERROR) == pytest.approx(0.0, abs=1e-14)
    last = np.array([*ode45.A[-1], 0.0])
    assert ode45.DENSE.sum(axis=1) == pytest.approx(last, abs=1e-13)
    assert ode45.DENSE.sum(axis=0)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_ode45(tolerance: float) -> None:
    times = np.linspace(0.0, 10.0, 51)
    found = ode45.ode45(oscillator, 10.0, np.array([2.0, 0.0]), tolerance, times)
    known = solve_ivp(oscillator, (0.0, 10.0), [2.0, 0.0], "DOP853", times, rtol=1e-12, atol=1e-13)
    assert np.abs(found.states - known.y.T).max() <= 100 * tolerance
    assert found.evaluations == 1 + 6 * (found.steps + found.rejected)


def test_what_a_step_of_ode45_costs() -> None:
    """20 coefficients of stages and 6 of the error, the norm, and the scalars of a step."""
    n = 2
    coefficients = sum(a != 0.0 for row in ode45.A for a in row)
    errors = sum(e != 0.0 for e in ode45.ERROR)
    state = 2 * coefficients + 2 * errors - 1 + 6  # two sizes, two maxima, the error's size, a quotient
    scalars = coefficients + 12 + counting.ELEMENTARY + 8 + n - 1 + 1  # largest component, product with h
    cost = ode45.cost_of_a_step(oscillator, 10.0, np.array([2.0, 0.0]), 1e-6)
    assert cost == pytest.approx(n * state + scalars, rel=0.02)


# ---- the paper's formula --------------------------------------------------------------------------


def by_hand(levels: int, rhs: float) -> float:
    """Levels k = 0, 1, … make 2^k steps while the finest makes 2^(n - 1); it looks up all others wherever they have no knot."""
    fine = 2.0 ** (levels - 1)
    steps = sum(2.0**k for k in range(levels))
    looks = sum(fine - 2.0**k for k in range(levels - 1))
    return (steps * (rhs + PC) + steps / 2.0 * CG + looks * PE) / (levels * fine * (rhs + PC))


@pytest.mark.parametrize("levels", [2, 3, 4, 5, 7])
def test_the_formula_is_a_count(levels: int) -> None:
    for rhs in (0.0, 10.0, 100.0):
        assert predicted(levels, rhs) == pytest.approx(by_hand(levels, rhs))


def test_where_it_breaks_even() -> None:
    found = [round(predicted_break_even(levels), 1) for levels in (3, 4, 5)]
    assert found == [25.0, 14.6, 9.7]
    for levels, rhs in zip((3, 4, 5), map(predicted_break_even, (3, 4, 5)), strict=True):
        assert predicted(levels, rhs) == pytest.approx(1.0)
