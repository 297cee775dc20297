"""sin, cos and exp over lanes against 40-digit values."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from machine_code import Floats, compiled, definition, over_lanes, room

TEXT = "def f(x, y):\n" + "".join(
    f"    y[{k}] = math.{f}(x[0])\n" for k, f in enumerate(["sin", "cos", "exp"])
)
RNG = np.random.default_rng(7)


@pytest.fixture(scope="module", params=[4, 8])
def evaluate(request: pytest.FixtureRequest) -> object:
    """(sin, cos, exp) of many arguments, shape (count, 3)."""
    lanes = request.param
    machine = compiled(definition(TEXT), lanes)

    def values(x: Floats) -> Floats:
        rows = []
        for first in range(0, len(x), lanes):
            chunk = np.resize(x[first : first + lanes], lanes)
            out = room(3, lanes)
            machine(over_lanes(chunk[:, None]), out)
            rows.append(out.T.copy())
        return np.concatenate(rows)[: len(x)]

    return values


def worst(found: Floats, x: Floats, function: object) -> float:
    """Largest error in units in the last place of the exact value."""
    error = 0.0
    with mpmath.workdps(40):
        for value, argument in zip(found.tolist(), x.tolist(), strict=True):
            exact = function(mpmath.mpf(argument))
            error = max(error, float(abs(mpmath.mpf(value) - exact)) / math.ulp(float(exact)))
    return error


def arguments(name: str) -> Floats:
    """Arguments of one range; signs both ways."""
    x = {
        "small": RNG.uniform(0, 1, 1500),
        "turns": RNG.uniform(0, 100, 1500),
        "thousands": RNG.uniform(0, 8e5, 1500),
        "near multiples": np.arange(1, 5e5, 333)
        * (math.pi / 2)
        * (1 + RNG.choice([0, 1, -1], 1502) * 2.0**-50),
        "tiny": np.exp(RNG.uniform(-700, 0, 800)),
    }[name]
    return x * RNG.choice([-1.0, 1.0], len(x))


@pytest.mark.parametrize("name", ["small", "turns", "thousands", "near multiples", "tiny"])
def test_sine_and_cosine(evaluate, name: str) -> None:
    x = arguments(name)
    found = evaluate(x)
    assert worst(found[:, 0], x, mpmath.sin) <= 2.0
    assert worst(found[:, 1], x, mpmath.cos) <= 2.0


def test_sine_and_cosine_of_huge_angles(evaluate) -> None:
    """Beyond the reduction's range, and mixed with angles within it."""
    x = np.concatenate([np.exp(RNG.uniform(math.log(8e5), 700, 400)), RNG.uniform(-9, 9, 400)])
    RNG.shuffle(x)
    found = evaluate(x)
    assert worst(found[:, 0], x, mpmath.sin) <= 2.0
    assert worst(found[:, 1], x, mpmath.cos) <= 2.0


@pytest.mark.parametrize("reach", [1e-9, 1.0, 50.0, 700.0])
def test_exponential(evaluate, reach: float) -> None:
    x = RNG.uniform(-reach, reach, 2000)
    assert worst(evaluate(x)[:, 2], x, mpmath.exp) <= 1.0


def test_exponential_at_the_ends(evaluate) -> None:
    """Results that overflow, or are too small to be normal, beside ordinary ones."""
    x = np.array([709.78, 710.0, -745.0, -746.0, -708.5, 700.1, 1.0, 0.0])
    found = evaluate(x)[:, 2]
    assert found[1] == math.inf
    assert found[3] == 0.0
    assert found[7] == 1.0
    for value, argument in zip(found[[0, 2, 4, 5, 6]], x[[0, 2, 4, 5, 6]], strict=True):
        assert value == pytest.approx(math.exp(argument), rel=4e-16, abs=5e-324)


def test_special_values(evaluate) -> None:
    x = np.array([0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, -5e-324, 1e308])
    found = evaluate(x)
    sine, cosine, exponential = found.T
    assert sine[:2].tolist() == [0.0, 0.0]
    assert np.isnan(sine[2:5]).all()
    assert np.isnan(cosine[2:5]).all()
    assert cosine[[0, 1, 5, 6]].tolist() == [1.0] * 4
    assert sine[5:7].tolist() == [5e-324, -5e-324]
    assert exponential[:4].tolist() == [1.0, 1.0, math.inf, 0.0]
    assert np.isnan(exponential[4])
    assert exponential[5:].tolist() == [1.0, 1.0, math.inf]
