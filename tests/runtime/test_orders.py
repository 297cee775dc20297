"""Observed orders, from runs with fixed steps: at knots, between knots, and of readers whose steps stand in any ratio to the writer's.

The claims are one-sided: the observed order is at least the claimed one less a quarter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from running import run
from small_models import OSCILLATOR, At, a_class, a_model

from hierc.runtime.contract import Class
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.methods.radau import Radau
from hierc.runtime.run import FinishedRun

Floats = NDArray[np.float64]
STOP = 40.0
#: So loose that `max_step` alone decides; the first few steps grow to it.
LOOSE = 100.0

#: Claimed orders at knots, between them and of readers.
CLAIMS = {
    "radau5": (5, 4, 4),
    "radau9": (9, 6, 6),
    "radau13": (13, 8, 8),
    "tsit5": (5, 4, 4),
    "dop853": (8, 7, 7),
    "abm5": (5, 5, 5),
}
#: Largest steps, in radians: those of the rotation, of the warp, and of readers.
LARGEST = {
    "radau5": (0.8, 0.3, 0.8),
    "radau9": (2.2, 0.55, 1.6),
    "radau13": (2.4, 0.9, 2.0),
    "tsit5": (0.8, 0.3, 0.8),
    "dop853": (1.4, 0.45, 1.4),
    "abm5": (0.4, 0.15, 0.4),
}
#: Errors below this are of rounding, gathered over up to some hundred steps.
ROUNDING = 2e-12
#: Where Newton's iteration stops, well below the method's error.
NEWTON = {"radau5": 1e-10, "radau9": 1e-13, "radau13": 1e-14}

#: x = tan(sin(t)): not linear, and rich in high derivatives.
WARP = a_class("Warp", {"x": "math.cos(t)*(1.0 + x[0]*x[0])"}, {(0, 0): "2.0*math.cos(t)*x[0]"})
#: Follows its input, x' = rate (u - x), from where the transient is zero: rate and initial value are parameters.
TRACKER = a_class(
    "Tracker",
    {"x": "p[0]*(u[0] - x[0])"},
    {(0, 0): "-p[0]", (0, 1): "p[0]"},
    start=["p[1]"],
    inputs=1,
    values=["q[0]", "q[1]"],
)
#: OSCILLATOR of rate 1 that publishes cos(2t), by an expression that is no polynomial of its states.
SPEAKER = a_class(
    "Speaker",
    {"c": "-x[1]", "s": "x[0]"},
    {(0, 1): "-1.0", (1, 0): "1.0"},
    start=["1.0", "0.0"],
    outs=[("(x[0]*x[0] - x[1]*x[1])/(x[0]*x[0] + x[1]*x[1])", ())],
)


@pytest.fixture(autouse=True)
def _exact_newton(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's iteration goes on to rounding, so that only the method's own error is left."""
    for name, method in METHODS.items():
        if isinstance(method, Radau):
            monkeypatch.setitem(METHODS, name, replace(method, newton_tolerance=NEWTON[name] / LOOSE))


def rotation(t: Floats) -> Floats:
    return np.stack([np.cos(t), np.sin(t)], axis=1)


def tracker(rate: float, angular: float) -> Callable[[Floats], Floats]:
    """The solution without transient of x' = rate (cos(angular t) - x)."""

    def exact(t: Floats) -> Floats:
        sum_ = rate**2 * np.cos(angular * t) + rate * angular * np.sin(angular * t)
        return (sum_ / (rate**2 + angular**2))[:, None]

    return exact


def errors(finished: FinishedRun, g: int, exact: Callable[[Floats], Floats]) -> tuple[float, float]:
    """Largest errors at and between the knots of a group, up to where the last steps land on the stop."""
    assert finished.status.ok
    track = finished.groups[g]
    sizes = np.diff(track.knots)
    assert np.ptp(sizes[8:-2]) < 1e-9  # the steps are indeed fixed
    end = STOP - 2.5 * sizes.max()
    knots = track.knots[track.knots < end]
    times = np.linspace(0.0, knots[-1], 2000)
    at, between = (np.abs(track(t) - exact(t)).max() for t in (knots, times))
    return float(at), float(between)


def observed(steps: Floats, found: Floats) -> float:
    """Slope of log(error) over log(step), as far as the error is not of rounding."""
    clear = np.minimum.accumulate(found > ROUNDING)
    assert clear.sum() >= 3
    return float(np.polyfit(np.log(steps[clear]), np.log(found[clear]), 1)[0])


def warp(t: Floats) -> Floats:
    return np.tan(np.sin(t))[:, None]


@pytest.mark.parametrize(
    ("kind", "exact"), [(OSCILLATOR, rotation), (WARP, warp)], ids=["linear", "nonlinear"]
)
@pytest.mark.parametrize("method", CLAIMS)
def test_alone(method: str, kind: Class, exact: Callable[[Floats], Floats]) -> None:
    model = a_model({"o": At(kind, (), 1)}, None, {"rate": 1.0})
    steps = LARGEST[method][kind is WARP] / 1.25 ** np.arange(8)
    found = np.array([errors(run(model, STOP, LOOSE, method=method, max_step=h), 0, exact) for h in steps])
    at_knots, between, _ = CLAIMS[method]
    assert observed(steps, found[:, 0]) >= at_knots - 0.25
    assert observed(steps[3:], found[3:, 1]) >= between - 0.25


@pytest.mark.parametrize("ratio", [0.63, 1.37, 2.0])
@pytest.mark.parametrize("writer", ["state", "out"])
@pytest.mark.parametrize("method", CLAIMS)
def test_readers(method: str, writer: Literal["state", "out"], ratio: float) -> None:
    """The reader's step is `ratio` times the writer's."""
    kind, angular = (At(OSCILLATOR, (), 1), 1.0) if writer == "state" else (At(SPEAKER, (), 1), 2.0)
    exact = tracker(0.6, angular)
    parameters = {"rate": 1.0, "speed": 0.6, "first": float(exact(np.zeros(1))[0, 0])}
    model = a_model({"w": kind, "r": At(TRACKER, ((0, writer, 0),), 2)}, None, parameters)
    steps = LARGEST[method][2] / 1.5 ** np.arange(7) / max(ratio, 1.0)
    runs = [
        run(model, STOP, LOOSE, {"w": {"max_step": h}, "r": {"max_step": ratio * h}}, method=method)
        for h in steps
    ]
    worst = np.array([max(errors(r, 1, exact)) for r in runs])
    assert observed(steps, worst) >= CLAIMS[method][2] - 0.25
