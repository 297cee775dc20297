"""Sums and extremes over many agents that many read: against their solution by hand, and what is reported of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import hierc
from hierc.runtime.model import Model

Floats = NDArray[np.float64]
COUNT = 40
TEXT = """
agent Car(real w [1/s] = 1) {
  write real x [m] = 1, v [m/s] = 0;
  diff { x' = v; v' = -w^2*x; }
}
agent Follower(real k [1/s] = 1, real T [s] = 1) {
  read real mean [m], low [m], high [m], spread [m^2];
  write real y [m] = 0, z [m^2] = 0, e [m] = 0;
  diff { y' = k*(mean - y); z' = (spread - z)/T; e' = k*(low + high - e); }
}
agent Road(int N = 40) {
  level cars { agent car[i in 1..N] = Car(w = 0.2*1.13^i*1 [1/s]); }
  group each car;
  let mean = sum(car.x)/N;
  let spread = sum([(car[j].x - mean)^2 for j in 1..N])/N;
  level followers {
    agent f[i in 1..N] = Follower(k = 1.2^i*1 [1/s], T = 5 [s]/i) [mean := mean, low := min(car.x), high := max(car.x), spread := spread];
  }
  group each f;
}
experiment go of Road() { stop = 3 [s]; }
"""
METHODS = ("auto", "radau5", "radau9", "radau13", "tsit5", "dop853", "adams")


@cache
def model() -> Model:
    return hierc.load(TEXT)


@cache
def by_hand() -> tuple[Floats, Floats, Floats]:
    """y, z and e of all followers after 3 s: quadrature of what they follow, straight between 300,000 places, from the cars' own solutions, cos(w t)."""
    i = np.arange(1, COUNT + 1)
    t = np.linspace(0.0, 3.0, 300_001)
    x = np.cos(np.outer(0.2 * 1.13**i, t))
    k = 1.2**i
    return _followed(k, t, x.mean(0)), _followed(i / 5, t, x.var(0)), _followed(k, t, x.min(0) + x.max(0))


def _followed(rates: Floats, t: Floats, u: Floats) -> Floats:
    """The solutions of y' = rate*(u - y), y = 0 at first, at the last of some times."""
    found = []
    for rate in rates:
        step = rate * np.diff(t)
        mean = -np.expm1(-step) / step
        later = np.exp(-rate * (t[-1] - t[1:]))
        found.append(np.sum(later * (u[1:] * (1 - mean) + u[:-1] * (mean - np.exp(-step)))))
    return np.array(found)


@pytest.mark.parametrize("method", METHODS)
def test_by_hand(method: str) -> None:
    """Rates differ a hundredfold among the cars, and a thousandfold among those that follow them.

    Extremes have kinks, which an implicit reader may step over with less care than where everything is smooth.
    """
    result = model().simulate(rtol=1e-7, atol=1e-7, method=method)
    y, z, e = by_hand()
    assert result["f.y"][-1] == pytest.approx(y, abs=2e-7)
    assert result["f.z"][-1] == pytest.approx(z, abs=2e-7)
    assert result["f.e"][-1] == pytest.approx(e, abs=1e-5)


def test_what_is_told_of_it() -> None:
    result = model().simulate()
    shared = {family.name: family for family in result.families if family.states == (0,)}
    variance = "sum([(car[j].x - mean)^2 for j in 1..N])"
    assert sorted(shared) == sorted(["sum(car.x)", variance, "min(car.x)", "max(car.x)"])
    assert {family.methods for family in shared.values()} == {("fit",)}
    assert result.stats["sum(car.x)"].steps == shared["sum(car.x)"].steps
    assert len(result.steps("sum(car.x)")[1]) == shared["sum(car.x)"].steps
    assert "mean" not in result.names  # nor is anything of it a variable


def test_results_are_exact_sums_of_the_states() -> None:
    """What is written out does not come from the polynomials of a group without states."""
    text = TEXT.replace("let mean", "write real total [m];\n  alge { total = sum(car.x); }\n  let mean")
    result = hierc.load(text).simulate(rtol=1e-4, atol=1e-4)
    assert result["total"] == pytest.approx(result["car.x"].sum(axis=1), rel=1e-13, abs=1e-13)


def test_verification_looks_at_what_has_states() -> None:
    found = model().simulate(rtol=1e-5, atol=1e-5, group="level", verify=True).verification
    assert found is not None
    assert [group.name for group in found.groups] == ["car[1..40]", "f[1..40]"]
