"""Groups whose method was left to us and that turn stiff, or stop being so: they change their method, lose no accuracy, and everybody else has his way."""

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
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun
from hierc.runtime.switching import Reviews

Floats = NDArray[np.float64]
Dear = Callable[[float], None]
Changes = list[tuple[int, str]]
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
#: Follows cos(t) at a rate that rises twice: from 1 to 1 + 2a around t = 2, and to 2e5 around t = 6.
IN_STAGES = a_class(
    "InStages",
    {"x": "-r*(x[0] - math.cos(t))", "y": "x[0] - y"},
    {(0, 0): "-r", (1, 0): "1.0", (1, 1): "-1.0"},
    start=["1.0", "0.0"],
    values=["q[0]"],
    first=[
        "r = 1.0 + p[0]*(1.0 + math.tanh(20.0*(t - 2.0))) + 1e5*(1.0 + math.tanh(20.0*(t - 6.0)))",
        "y = x[1]",
    ],
)
#: A state that follows cos(t), at a rate of 2e4 between t = 2 and t = 6 and of 1 before and after, and an oscillator.
FOR_A_WHILE = a_class(
    "ForAWhile",
    {"x": "-r*(x[0] - math.cos(t))", "y": "x[2]", "v": "-x[1]"},
    {(0, 0): "-r", (1, 2): "1.0", (2, 1): "-1.0"},
    start=["1.0", "1.0", "0.0"],
    outs=[("x[0]*x[1]", ())],
    first=["r = 1.0 + 1e4*(math.tanh(20.0*(t - 2.0)) - math.tanh(20.0*(t - 6.0)))"],
)


@pytest.fixture
def choosing(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes the choice at the beginning of runs."""

    def choose(method: str) -> None:
        monkeypatch.setattr(choice, "choose", lambda *probes: method)

    return choose


@pytest.fixture
def dear(monkeypatch: pytest.MonkeyPatch) -> Dear:
    """Makes each step of the implicit method cost so many ns, whatever else it costs."""

    def cost(base: float) -> None:
        costs = {**choice.COSTS, choice.FAVOURITE: replace(choice.COSTS[choice.FAVOURITE], base=base)}
        monkeypatch.setattr(choice, "COSTS", costs)

    return cost


@pytest.fixture
def changes(monkeypatch: pytest.MonkeyPatch) -> Changes:
    """What becomes of the first group: after how many steps it goes on with which method."""
    found: Changes = []
    change = Reviews._change

    def noted(self: Reviews, run: simulation.Simulation, wiring: Wiring, g: int, name: str) -> None:
        if g == 0:
            found.append((int(run.groups["steps"][g]), name))
        change(self, run, wiring, g, name)

    monkeypatch.setattr(Reviews, "_change", noted)
    return found


def stiffening() -> Model:
    """A group that turns stiff, and two that read it: a state, and what it publishes."""
    readers = {"a": At(FOLLOWER, ((0, "state", 0),), 1), "b": At(FOLLOWER, ((0, "out", 0),), 1)}
    return a_model({"s": At(STIFFENING), **readers}, None, {"a.rate": 2.0, "b.rate": 3.0})


def for_a_while() -> Model:
    """A group that is stiff for a while, and two that read it."""
    readers = {"a": At(FOLLOWER, ((0, "state", 0),), 1), "b": At(FOLLOWER, ((0, "out", 0),), 1)}
    return a_model({"s": At(FOR_A_WHILE), **readers}, None, {"a.rate": 2.0, "b.rate": 3.0})


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
def test_one_that_does_not_pay_is_given_up(method: str, choosing: Callable[[str], None], dear: Dear) -> None:
    """Where an implicit step costs too much, the explicit method comes back, and what trials cost stays little beside it."""
    dear(1e9)
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


def test_trials_that_do_not_pay_become_rare(
    choosing: Callable[[str], None], dear: Dear, changes: Changes
) -> None:
    """A group that is a little stiff for ever: the implicit method is tried again and again, each time after twice as many steps."""
    dear(1e4)
    choosing("tsit5")
    kind = a_class("Follows", {"x": "30.0*(math.cos(t) - x[0])"}, {(0, 0): "-30.0"}, start=["1.0"])
    (group,) = run(a_model({"f": At(kind)}), 5e4, 1e-4, method="auto").groups
    tried = [steps for steps, name in changes if name == choice.FAVOURITE]
    assert group.method == "tsit5"
    assert 4 <= len(tried) <= 6
    waits = np.diff(tried)
    assert (waits[1:] > 1.9 * waits[:-1]).all()
    assert 10 * group.stats["jacobians"] * 1e4 < group.stats["steps"] * choice.COSTS["tsit5"].base


@pytest.mark.parametrize(
    ("method", "a"),
    [("tsit5", a) for a in (1, 5, 10, 20, 30, 35, 100)] + [("adams", a) for a in (1, 5, 8, 10, 12, 20, 40)],
)
def test_a_group_that_turns_stiff_in_stages(method: str, a: float, choosing: Callable[[str], None]) -> None:
    """What did not pay in the first stage pays in the second."""
    choosing(method)
    model = a_model({"s": At(IN_STAGES, (), 1)}, None, {"s.a": float(a)})
    t = np.linspace(0.0, 20.0, 2001)
    truth = states(run(model, 20.0, 1e-11, method="radau9"), t)
    finished = run(model, 20.0, 1e-6, method="auto")
    assert finished.groups[0].method == choice.FAVOURITE
    assert finished.groups[0].stats["steps"] <= 500
    assert np.abs(states(finished, t) - truth).max() <= 50 * 1e-6


def test_a_failed_trial_is_not_the_last(choosing: Callable[[str], None], changes: Changes) -> None:
    choosing("tsit5")
    assert run(a_model({"s": At(IN_STAGES, (), 1)}, None, {"s.a": 30.0}), 20.0, 1e-6, method="auto").status.ok
    assert [name for _, name in changes] == [choice.FAVOURITE, "tsit5", choice.FAVOURITE]


@pytest.mark.parametrize("method", ["tsit5", "adams"])
def test_a_group_that_is_stiff_for_a_while(
    method: str, choosing: Callable[[str], None], dear: Dear, changes: Changes
) -> None:
    """The implicit method is left again, where it costs more than the first one does once stiffness is over."""
    dear(2e4)
    choosing(method)
    model = for_a_while()
    t = np.linspace(0.0, 200.0, 20001)
    truth = states(run(model, 200.0, 1e-11, method="radau9"), t)
    finished = run(model, 200.0, 1e-6, method="auto")
    first = finished.groups[0]
    assert first.method == method
    assert [name for _, name in changes[:1] + changes[-1:]] == [choice.FAVOURITE, method]
    assert np.abs(states(finished, t) - truth).max() <= 50 * 1e-6
    alone = run(model, 200.0, 1e-6, method=choice.FAVOURITE).groups[0]
    stayed = run(model, 200.0, 1e-6, method=method).groups[0]
    assert first.stats["jacobians"] < 0.75 * alone.stats["jacobians"]
    assert first.stats["steps"] < 0.1 * stayed.stats["steps"]


@pytest.mark.parametrize("method", EXPLICIT)
def test_a_group_that_stays_stiff(method: str, choosing: Callable[[str], None]) -> None:
    """Looking whether it still is costs little."""
    choosing(method)
    auto = run(stiffening(), 500.0, 1e-6, method="auto").groups[0]
    alone = run(stiffening(), 500.0, 1e-6, method=choice.FAVOURITE).groups[0]
    assert auto.method == choice.FAVOURITE
    assert auto.stats["steps"] < 1.25 * alone.stats["steps"] + 150


@pytest.mark.parametrize(("method", "least"), [("tsit5", 3e-4), ("dop853", 1e-3), ("adams", 3e-4)])
def test_a_trial_that_cannot_go_on(
    method: str, least: float, choosing: Callable[[str], None], changes: Changes
) -> None:
    """The explicit method would need steps that are too small: the implicit one, which does not, comes back."""
    choosing(method)
    model = a_model({"s": At(STIFFENING)})
    finished = run(model, 500.0, 1e-6, method="auto", min_step=least)
    assert finished.status.ok
    assert [name for _, name in changes[:3]] == [choice.FAVOURITE, method, choice.FAVOURITE]
    failed = run(model, 500.0, 1e-6, method=method, min_step=least)
    assert failed.status.name == "STEP_TOO_SMALL"


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize("method", ["tsit5", "adams"])
def test_in_threads(
    method: str, threads: int, choosing: Callable[[str], None], dear: Dear, changes: Changes
) -> None:
    """Groups that change their methods to and fro: not a bit differs."""
    dear(2e4)
    choosing(method)
    one = run(for_a_while(), 200.0, 1e-6, method="auto")
    assert len(changes) >= 2
    other = run(for_a_while(), 200.0, 1e-6, method="auto", threads=threads)
    for a, b in zip(one.groups, other.groups, strict=True):
        assert a.method == b.method
        assert a.table.tobytes() == b.table.tobytes()


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
