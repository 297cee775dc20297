"""Groups whose method was left to us and that turn stiff: they change to the implicit method, lose no accuracy, and everybody else has his way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from running import run
from small_models import FOLLOWER, At, a_class, a_model

import hierc
from hierc.runtime import choice, simulation
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun

Floats = NDArray[np.float64]
EXPLICIT = ("tsit5", "dop853", "adams")
STOP = 6.0

#: Follows cos(t) at a rate that rises from 1 to 1e4 around t = 2, smoothly; publishes x**2.
STIFFENING = a_class(
    "Stiffening",
    {"x": "-math.sin(t) - r*(x[0] - math.cos(t))", "y": "x[0] - y"},
    {(0, 0): "-r", (1, 0): "1.0", (1, 1): "-1.0"},
    start=["1.5", "0.0"],
    outs=[("x[0]*x[0]", ())],
    first=["r = 1.0 + 5e3*(1.0 + math.tanh(4.0*(t - 2.0)))", "y = x[1]"],
)
#: Van der Pol's oscillator, stiff only after t = 3.
TURNING = a_class(
    "Turning",
    {"x": "x[1]", "v": "m*((1.0 - x[0]*x[0])*x[1]) - x[0]"},
    {(0, 1): "1.0", (1, 0): "-2.0*m*x[0]*x[1] - 1.0", (1, 1): "m*(1.0 - x[0]*x[0])"},
    start=["2.0", "0.0"],
    first=["m = 0.5 + 300.0*(1.0 + math.tanh(3.0*(t - 3.0)))"],
)


@pytest.fixture
def choosing(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes the choice at the beginning of runs."""

    def choose(method: str) -> None:
        monkeypatch.setattr(choice, "choose", lambda *probes: method)

    return choose


def stiffening() -> Model:
    """A group that turns stiff, and two that read it: a state, and what it publishes."""
    readers = {"a": At(FOLLOWER, ((0, "state", 0),), 1), "b": At(FOLLOWER, ((0, "out", 0),), 1)}
    return a_model({"s": At(STIFFENING), **readers}, None, {"a.rate": 2.0, "b.rate": 3.0})


def states(finished: FinishedRun, t: Floats) -> Floats:
    assert finished.status.ok
    return np.hstack([g(t) for g in finished.groups])


@pytest.mark.parametrize(
    "make", [stiffening, lambda: a_model({"v": At(TURNING)})], ids=["tracking", "van der Pol"]
)
@pytest.mark.parametrize("method", EXPLICIT)
def test_a_group_that_turns_stiff(
    method: str, make: Callable[[], Model], choosing: Callable[[str], None]
) -> None:
    choosing(method)
    model = make()
    t = np.linspace(0.0, STOP, 601)
    truth = states(run(model, STOP, 1e-12, method="radau9"), t)
    for tolerance in (1e-4, 1e-6, 1e-8):
        finished = run(model, STOP, tolerance, method="auto")
        first = finished.groups[0]
        assert first.method == choice.FAVOURITE
        assert first.stats["jacobians"] > 0
        assert np.abs(states(finished, t) - truth).max() <= 50 * tolerance
        stayed = run(model, STOP, tolerance, method=method).groups[0]
        assert stayed.method == method
        assert stayed.stats["jacobians"] == 0
        assert 3 * first.stats["steps"] < stayed.stats["steps"]


@pytest.mark.parametrize("method", EXPLICIT)
def test_one_that_does_not_pay_is_given_up(
    method: str, choosing: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where an implicit step costs too much, the explicit method comes back, once and for all."""
    costs = {**choice.COSTS, choice.FAVOURITE: replace(choice.COSTS[choice.FAVOURITE], base=1e9)}
    monkeypatch.setattr(choice, "COSTS", costs)
    choosing(method)
    stop = 10 * STOP  # the trial takes far longer steps
    t = np.linspace(0.0, stop, 601)
    model = stiffening()
    truth = states(run(model, stop, 1e-11, method="radau9"), t)
    finished = run(model, stop, 1e-5, method="auto")
    first = finished.groups[0]
    assert first.method == method
    assert 0 < first.stats["jacobians"] < 300
    assert np.abs(states(finished, t) - truth).max() <= 50 * 1e-5


@pytest.mark.parametrize("method", EXPLICIT)
def test_calls_of_any_length(
    method: str, choosing: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """When a group asks follows from its own steps; when the kernel returns does not matter."""
    choosing(method)
    model = stiffening()
    whole = run(model, STOP, 1e-6, method="auto")
    take = simulation.Simulation._slice
    for budget in (1, 7, 1000):

        def slice_of_fixed_size(self: simulation.Simulation, budget: int = budget) -> float:
            self._pace.budget = budget
            return take(self)

        with monkeypatch.context() as patch:
            patch.setattr(simulation.Simulation, "_slice", slice_of_fixed_size)
            again = run(model, STOP, 1e-6, method="auto")
        for a, b in zip(whole.groups, again.groups, strict=True):
            assert a.method == b.method
            assert a.coefficients.tobytes() == b.coefficients.tobytes()


def test_smooth_runs_keep_their_method(choosing: Callable[[str], None]) -> None:
    choosing("adams")
    kind = a_class("Calm", {"x": "math.cos(t) - 0.1*x[0]"}, {(0, 0): "-0.1"})
    finished = run(a_model({"c": At(kind)}), 50.0, 1e-6, method="auto")
    assert finished.groups[0].method == "adams"
    assert finished.groups[0].stats["jacobians"] == 0


def test_a_crowd_that_turns_stiff() -> None:
    """A dense group of 40 states, explicit on its own until its rate rises ten thousandfold."""
    model = hierc.load("""agent Crowd() {
  write real[40] x = [0.1*i for i in 1..40];
  let s = sum(x);
  let r = 5e3*(1 + tanh(8 [1/s]*(time - 1 [s])));
  diff { for i in 1..40 { x[i]' = (0.02*sin(s*x[i]) - r*(x[i] - cos(1 [1/s]*time)))*1 [1/s]; } }
}""")
    t = np.linspace(0.0, 5.0, 201)
    truth = model.simulate(stop=5.0, rtol=1e-10, atol=1e-10, method="radau9")
    found = model.simulate(stop=5.0, rtol=1e-6, atol=1e-6)
    (stats,) = found.stats.values()
    assert stats.method == choice.FAVOURITE
    assert stats.evaluations > 13 * stats.jacobians  # most of what it did was explicit
    for state in model.states:
        assert np.abs(found(state, t) - truth(state, t)).max() <= 1e-5 * 10
