"""Runs that cannot go on: how they end, what they say, and what is kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from running import METHODS, run
from small_models import DECAY, FOLLOWER, OSCILLATOR, At, a_class, a_model

import hierc
from hierc.runtime.result import SimulationError
from hierc.runtime.run import FinishedRun

Floats = NDArray[np.float64]
each_method = pytest.mark.parametrize("method", [*METHODS, "auto"])


def failing(**kind: object) -> object:
    """A model of a harmless first group, a middle one that fails, and a last one that reads it."""
    middle = a_class("Middle", **kind)
    nodes = {"first": At(DECAY, (), 1), "middle": At(middle), "last": At(FOLLOWER, ((1, "state", 0),), 1)}
    return a_model(nodes, None, {"first.k": 0.5, "last.k": 3.0})


def check_kept(finished: FinishedRun, exact: object) -> None:
    """What is kept reaches to `t_reached` in every group, and is right."""
    t = np.linspace(0.0, finished.t_reached, 50)
    assert all(g.knots[-1] >= finished.t_reached for g in finished.groups)
    assert finished.t_reached == min(g.knots[-1] for g in finished.groups)
    assert finished.groups[0](t)[:, 0] == pytest.approx(np.exp(-0.5 * t), abs=1e-5)
    assert finished.groups[1](t)[:, 0] == pytest.approx(exact(t), rel=1e-4, abs=1e-5)


@each_method
def test_not_a_number_from_the_start(method: str) -> None:
    model = failing(rhs={"good": "1.0", "bad": "x[1]*math.log(-1.0 - t)"}, jac={(1, 1): "math.log(-1.0 - t)"})
    finished = run(model, 2.0, method=method)
    assert finished.status.name == "NOT_FINITE"
    assert finished.t_reached == 0.0
    for part in ("`middle`", "`middle.bad`", "line 11", "t = 0 s"):
        assert part in finished.status.message


@each_method
def test_not_a_number_later(method: str) -> None:
    """A root whose argument becomes negative at t = 1."""
    finished = run(failing(rhs={"x": "math.sqrt(1.0 - t)"}), 2.0, method=method)
    assert finished.status.name in ("NOT_FINITE", "STEP_TOO_SMALL")
    assert finished.t_reached == pytest.approx(1.0, abs=1e-3)
    for part in ("`middle`", "`middle.x`", "line 10", "t = "):
        assert part in finished.status.message
    check_kept(finished, lambda t: (1.0 - (1.0 - t) ** 1.5) / 1.5)


@each_method
def test_a_pole(method: str) -> None:
    """x' = 1/(t - 1/2)^2: grows without bound."""
    finished = run(failing(rhs={"x": "1.0/((t - 0.5)*(t - 0.5))"}), 2.0, method=method)
    assert finished.status.name in ("STEP_TOO_SMALL", "NOT_FINITE")
    assert "`middle.x` (line 10)" in finished.status.message
    assert finished.t_reached == pytest.approx(0.5, abs=1e-4)
    t = np.linspace(0.0, 0.49, 50)
    assert finished.groups[1](t)[:, 0] == pytest.approx(1.0 / (0.5 - t) - 2.0, rel=1e-4, abs=1e-5)


@each_method
def test_blow_up(method: str) -> None:
    """x' = x^2, x = 1/(1 - t)."""
    finished = run(
        failing(rhs={"x": "x[0]*x[0]"}, jac={(0, 0): "2.0*x[0]"}, start=["1.0"]), 2.0, method=method
    )
    assert finished.status.name in ("STEP_TOO_SMALL", "NOT_FINITE")
    assert "`middle.x` (line 10)" in finished.status.message
    assert finished.t_reached == pytest.approx(1.0, abs=1e-3)
    t = np.linspace(0.0, 0.9, 50)
    assert finished.groups[1](t)[:, 0] == pytest.approx(1.0 / (1.0 - t), rel=1e-3)


@each_method
def test_a_jump_is_passed(method: str) -> None:
    """The step is found that ends near the jump; the result is right on both sides."""
    jump = failing(rhs={"x": "a"}, first=["if t < 0.7:", "    a = 1.0", "else:", "    a = -2.0"])
    finished = run(jump, 2.0, method=method)
    assert finished.status.ok
    t = np.linspace(0.0, 2.0, 200)
    assert finished.groups[1](t)[:, 0] == pytest.approx(np.where(t < 0.7, t, 0.7 - 2.0 * (t - 0.7)), abs=3e-5)


@each_method
def test_a_sliding_switch_fails_cleanly(method: str) -> None:
    """x' = -sign(x) chatters at zero: either creeps on close to zero, or says where it stopped."""
    kind = {"rhs": {"x": "-1.0 if x[0] > 0.0 else 1.0"}, "start": ["0.5"]}
    finished = run(failing(**kind), 1.0, 1e-3, method=method, most_steps=20_000)
    assert finished.status.name in ("DONE", "STEP_TOO_SMALL", "NOT_FINITE", "TOO_MANY_STEPS")
    end = finished.groups[1].knots[-1]
    assert end >= 0.49
    assert np.abs(finished.groups[1](np.array([end]))).max() < 0.02


@each_method
def test_an_initial_value_that_is_no_number(method: str) -> None:
    finished = run(
        failing(rhs={"a": "1.0", "x": "1.0"}, start=["0.0", "math.sqrt(-1.0)"]), 2.0, method=method
    )
    assert finished.status.name == "BAD_START"
    assert "`middle.x`" in finished.status.message
    assert "line 11" in finished.status.message
    assert finished.t_reached == 0.0


@each_method
def test_most_steps(method: str) -> None:
    model = a_model(
        {"slow": At(OSCILLATOR, (), 1), "fast": At(OSCILLATOR, (), 1)}, None, {"w": 1.0, "v": 50.0}
    )
    finished = run(model, 1e5, method=method, most_steps=500)
    assert finished.status.name == "TOO_MANY_STEPS"
    assert "`fast`" in finished.status.message
    assert "500" in finished.status.message
    assert 0.0 < finished.t_reached < 1e5
    t = np.linspace(0.0, finished.t_reached, 20)
    assert finished.groups[0](t)[:, 0] == pytest.approx(np.cos(t), abs=1e-2)


@each_method
def test_interrupts(method: str) -> None:
    """What the callback has seen is kept."""
    seen: list[float] = []

    def stop_after_three(t: float) -> None:
        seen.append(t)
        if len(seen) == 3:
            raise KeyboardInterrupt

    model = a_model({"o": At(OSCILLATOR, (), 1), "p": At(OSCILLATOR, (), 1)}, None, {"w": 1.0, "v": 20.0})
    finished = run(model, 1e5, 1e-8, method=method, progress=stop_after_three)
    assert finished.status.name == "INTERRUPTED"
    assert seen == sorted(seen)
    assert 0.0 < seen[-1] <= finished.t_reached < 1e5
    t = np.linspace(0.0, finished.t_reached, 50)
    assert finished.groups[0](t)[:, 0] == pytest.approx(np.cos(t), abs=1e-4)


def test_progress_reaches_the_stop_in_order() -> None:
    seen: list[float] = []
    model = a_model({"o": At(OSCILLATOR, (), 1)}, None, {"w": 30.0})
    assert run(model, 300.0, 1e-10, progress=seen.append).status.ok
    assert len(seen) > 2
    assert seen == sorted(seen)
    assert seen[0] >= 0.0
    assert seen[-1] <= 300.0


def test_simulate_raises_with_the_partial_result() -> None:
    model = failing(rhs={"x": "x[0]*x[0]"}, jac={(0, 0): "2.0*x[0]"}, start=["1.0"])
    with pytest.raises(SimulationError, match=r"middle\.x") as caught:
        model.simulate(stop=2.0)
    result = caught.value.result
    assert result.status.name in ("STEP_TOO_SMALL", "NOT_FINITE")
    assert result.t_reached == pytest.approx(1.0, abs=1e-3)
    assert result["first.x"][0] == 1.0
    assert result("middle.x", 0.5) == pytest.approx(2.0, rel=1e-4)


def test_min_step_is_kept() -> None:
    finished = run(
        failing(rhs={"x": "x[0]*x[0]"}, jac={(0, 0): "2.0*x[0]"}, start=["1.0"]), 2.0, min_step=1e-3
    )
    assert finished.status.name == "STEP_TOO_SMALL"
    assert all(np.diff(g.knots)[1:].min(initial=math.inf) >= 0.9e-3 for g in finished.groups[1:2])


def test_a_least_step_that_is_too_large_is_named() -> None:
    """A fast start under a large `min_step`: the message says which setting stands in the way."""
    model = hierc.load("agent Fast() { write real x = 1; diff { x' = -1e6 [1/s]*x; } }")
    with pytest.raises(hierc.SimulationError, match=r"needs a step smaller than its `min_step` of 0\.5 s$"):
        model.simulate(stop=10.0, min_step=0.5, method="tsit5")
