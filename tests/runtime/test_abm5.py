"""The paper's method: its coefficients, its stability, its knots, and its accuracy on the models that come with hierc."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from running import run
from scipy.integrate import solve_ivp
from small_models import DECAY, FOLLOWER, OSCILLATOR, At, a_model

import hierc
from hierc.runtime.choice import COSTS
from hierc.runtime.methods.abm5 import GAMMAS, LATER, MILNES
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.model import Model
from hierc.runtime.result import Result

Floats = NDArray[np.float64]
#: Polynomials with exact coefficients, lowest power first.
Polynomial = list[Fraction]


def times(a: Polynomial, b: Polynomial) -> Polynomial:
    made = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            made[i + j] += x * y
    return made


def integral(a: Polynomial) -> Fraction:
    """Over [0, 1]."""
    return sum((x / (k + 1) for k, x in enumerate(a)), Fraction(0))


def weights(nodes: list[int]) -> list[Fraction]:
    """Integrals over [0, 1] of the Lagrange polynomials of some nodes: an Adams formula in values of the derivative."""
    found = []
    for node in nodes:
        basis: Polynomial = [Fraction(1)]
        for other in nodes:
            if other != node:
                basis = times(basis, [Fraction(-other, node - other), Fraction(1, node - other)])
        found.append(integral(basis))
    return found


def from_differences(coefficients: tuple[Fraction, ...]) -> list[Fraction]:
    """A sum of backward differences in values: D^j f = sum_m (-1)^m binomial(j, m) f_(-m)."""
    rows: list[Polynomial] = [[Fraction(1)]]
    while len(rows) < len(coefficients):
        rows.append(times(rows[-1], [Fraction(1), Fraction(-1)]))
    made = [Fraction(0)] * len(coefficients)
    for c, row in zip(coefficients, rows, strict=True):
        for m, factor in enumerate(row):
            made[m] += c * factor
    return made


def test_the_predictor_is_that_of_adams_and_bashforth() -> None:
    assert from_differences(GAMMAS[:4]) == weights([0, -1, -2, -3])


def test_the_corrector_is_that_of_adams_and_moulton() -> None:
    """Predicted value and the last coefficient times D^4 of the derivative at the end: order 5 with as many derivatives."""
    fourth = from_differences((Fraction(0),) * 4 + (GAMMAS[4],))  # in f_1, f_0, …, f_-3
    predictor = [Fraction(0), *weights([0, -1, -2, -3])]
    assert [a + b for a, b in zip(predictor, fourth, strict=True)] == weights([1, 0, -1, -2, -3])


def test_the_estimate_is_milnes() -> None:
    """Of the pair of order 4: 19/270 of corrector less predictor, which leaves the formula of order 5."""
    lower = weights([1, 0, -1, -2])
    fourth = from_differences((Fraction(0),) * 4 + (Fraction(1),))
    predictor = [Fraction(0), *weights([0, -1, -2, -3])]
    difference = [a - b for a, b in zip([*lower, Fraction(0)], predictor, strict=True)]
    assert [Fraction(19, 270) * d for d in difference] == [MILNES * f for f in fourth]
    corrected = [a - Fraction(19, 270) * d for a, d in zip([*lower, Fraction(0)], difference, strict=True)]
    assert corrected == weights([1, 0, -1, -2, -3])


def test_a_polynomial_ends_at_the_corrected_value() -> None:
    """Its last term is a multiple of (s + 2)(s + 1)s(s - 1), which vanishes where it takes derivatives from."""
    term: Polynomial = [Fraction(1)]
    for node in (-2, -1, 0, 1):
        term = times(term, [Fraction(-node), Fraction(1)])
    assert LATER * integral(term) == -GAMMAS[4]


@pytest.mark.parametrize(("size", "stable"), [(1.3, True), (1.6, False)])
def test_how_long_a_stable_step_is(size: float, stable: bool) -> None:
    """On x' = -x, with a tolerance that is never exceeded; with a predictor of order 5 the limit would be 0.94, not 1.41."""
    model = a_model({"d": At(DECAY, (), 1)}, None, {"rate": 1.0})
    finished = run(model, 400.0, 10.0, method="abm5", max_step=size)
    assert np.diff(finished.groups[0].knots)[10:].min() > size - 0.01
    last = abs(float(finished.groups[0](np.array([400.0]))[0, 0]))
    assert last < 1e-6 if stable else last > 1.0


def test_it_is_never_chosen() -> None:
    assert "abm5" in METHODS
    assert "abm5" not in COSTS


# ---- knots ----------------------------------------------------------------------------------------


def assert_nested(result: Result, reader: str, read: str) -> float:
    """Every knot of what is read is one of its reader's. Returns the part of ways between them that the reader's steps divide equally."""
    starts, sizes = result.steps(reader)
    knots = {*starts.tolist(), float(starts[-1] + sizes[-1])}
    upper, upper_sizes = result.steps(read)
    assert knots.issuperset(upper.tolist())
    ends = [*upper[1:].tolist(), float(upper[-1] + upper_sizes[-1])]
    equal = 0
    for a, b in zip(upper.tolist(), ends, strict=True):
        inside = sizes[(starts >= a) & (starts < b)]
        assert len(inside)
        equal += bool(np.ptp(inside) < 1e-9 * (b - a))
    return equal / len(ends)


def test_ratios_of_a_cascade_are_integers() -> None:
    result = hierc.load("cart").simulate(stop=20.0, rtol=1e-5, atol=1e-5, method="abm5")
    levels = list(result.stats)
    shares = [assert_nested(result, below, above) for above, below in pairwise(levels)]
    assert shares[-1] > 0.8  # elsewhere a trial failed, or steps became longer on a long way
    steps = [result.stats[level].steps for level in levels]
    assert steps == sorted(steps)


def test_a_reader_of_several_lands_on_the_knots_of_all() -> None:
    result = hierc.load("platoon").simulate(stop=1.0, method="abm5")
    names = list(result.stats)
    for k, name in enumerate(names[1:], 1):
        for read in {names[0], names[k - 1]}:
            assert_nested(result, name, read)


def test_a_slow_reader_of_a_fast_group_takes_its_steps() -> None:
    model = a_model(
        {"fast": At(OSCILLATOR, (), 1), "slow": At(FOLLOWER, ((0, "state", 0),), 1)},
        None,
        {"w": 20.0, "rate": 0.1},
    )
    finished = run(model, 5.0, 1e-6, method="abm5")
    fast, slow = (group.knots for group in finished.groups)
    assert set(slow.tolist()) >= set(fast.tolist())
    assert len(slow) < 1.1 * len(fast)  # the slow one's start takes smaller ones


# ---- accuracy -------------------------------------------------------------------------------------


def error(model: Model, result: Result, stop: float) -> float:
    """Largest error of all states at 501 times, each relative to its largest size."""
    t = np.linspace(0.0, stop, 501)
    known = solve_ivp(model.rhs, (0.0, stop), model.initial(), "DOP853", t, rtol=1e-12, atol=1e-13)
    worst = [
        np.abs(result(name, t) - y).max() / max(np.abs(y).max(), 1.0)
        for name, y in zip(model.states, known.y, strict=True)
    ]
    return float(max(worst))


@pytest.mark.parametrize(
    ("name", "stop", "tolerance"),
    [
        ("cart", 4.0, 1e-4),
        ("cart", 4.0, 1e-6),
        ("cart", 4.0, 1e-8),
        ("platoon", 3.0, 1e-4),
        ("platoon", 3.0, 1e-6),
        ("platoon", 3.0, 1e-8),
    ],
)
def test_accuracy(name: str, stop: float, tolerance: float) -> None:
    model = hierc.load(name)
    result = model.simulate(stop=stop, rtol=tolerance, atol=tolerance, method="abm5")
    assert error(model, result, stop) <= 10 * tolerance


@pytest.mark.filterwarnings("ignore:warning.W013")
def test_a_jump_is_left_behind() -> None:
    """The history before it says nothing of what comes; the steps find back to their size."""
    model = hierc.load("""
        agent Lag() {
          write real x = 0;
          diff { x' = ((if time < 1 [s] then 0 else 1) - x)*1 [1/s]; }
        }
    """)
    t = np.linspace(0.0, 8.0, 801)
    result = model.simulate(stop=8.0, rtol=1e-6, atol=1e-6, method="abm5")
    assert np.abs(result("x", t) - np.where(t < 1, 0.0, 1 - np.exp(1 - t))).max() <= 1e-5
    starts, sizes = result.steps("Lag")
    assert sizes[starts > 2].min() > 0.01
