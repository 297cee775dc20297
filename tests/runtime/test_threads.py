"""Runs in several threads: not a bit may differ, whatever there is to wait for, to grow, or to fail."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator

import numpy as np
import pytest
from array_models import a_model, chain, platoon, robots
from running import METHODS
from small_models import DECAY, FOLLOWER, At
from small_models import a_model as a_small_model

import hierc
from hierc.runtime.contract import Plan
from hierc.runtime.errors import SettingError
from hierc.runtime.model import Model
from hierc.runtime.pace import Pace
from hierc.runtime.simulation import Simulation
from hierc.runtime.status import Status


def simulated(
    model: Model, threads: int, stop: float, method: str = "radau13", **others: float
) -> tuple[Simulation, Status]:
    given = {
        "rtol": 1e-6, "atol": 1e-6, "method": method, "max_step": np.inf, "min_step": 0.0, **others
    }  # fmt: skip
    chosen = model.engine.group_settings(given, {})
    simulation = Simulation(model.engine, model.system(), chosen, model.initial(), 0.0, stop)
    return simulation, simulation.advance(threads=threads)


def assert_equal(one: Simulation, other: Simulation) -> None:
    for a, b in zip(one.trajectories(), other.trajectories(), strict=True):
        assert np.array_equal(a.table, b.table), a.name
        assert a.stats == b.stats


@pytest.fixture
def quick_switches() -> Iterator[None]:
    """Threads of Python take turns a thousand times as often."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.parametrize("threads", [2, 3, 5, 200])
@pytest.mark.parametrize("method", METHODS)
def test_a_chain_is_the_same_in_threads(method: str, threads: int, quick_switches: None) -> None:
    model = a_model(platoon(40))
    alone, done = simulated(model, 1, 20.0, method)
    together, also = simulated(model, threads, 20.0, method)
    assert done == also
    assert done.ok
    assert_equal(alone, together)


@pytest.mark.parametrize("name", ["swarm", "quadrotor", "snake"])
def test_models_are_the_same_in_threads(name: str) -> None:
    model = hierc.load(name)
    assert_equal(simulated(model, 1, 10.0)[0], simulated(model, 3, 10.0)[0])


def test_many_short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each block is a window behind the one before it, some hundred times."""
    monkeypatch.setattr("hierc.runtime.wavefront._FIRST_STEPS", 1.0)
    monkeypatch.setattr("hierc.runtime.wavefront._FEW", 20)
    monkeypatch.setattr("hierc.runtime.wavefront._MANY", 100)
    monkeypatch.setattr("hierc.runtime.pace.SLICE", 0.0)
    model = a_model(platoon(24))
    assert_equal(simulated(model, 1, 60.0)[0], simulated(model, 4, 60.0)[0])


def test_memory_grows_between_the_windows() -> None:
    model = a_model(platoon(6))
    alone, together = simulated(model, 1, 20.0, max_step=0.01)[0], simulated(model, 3, 20.0, max_step=0.01)[0]
    assert int(together.groups["capacity"][:6].max()) > 1000
    assert_equal(alone, together)


@pytest.mark.parametrize("plan", [chain(7, one_group=True), robots(3, 4)])
def test_groups_of_all_kinds(plan: Plan) -> None:
    model = a_model(plan)
    assert_equal(simulated(model, 1, 5.0)[0], simulated(model, 2, 5.0)[0])


def test_a_run_that_fails_keeps_as_much_and_says_the_same() -> None:
    """One group of the second block cannot go on; the groups behind it end where it does."""
    nodes = {"n0": At(DECAY, (), 1)} | {f"n{k}": At(FOLLOWER, ((k - 1, "state", 0),), 1) for k in range(1, 6)}
    rates = {f"n{k}.rate": 0.5 for k in range(6)} | {"n4.rate": 1e9}
    model = a_small_model(nodes, None, rates)
    settings = {"min_step": 0.2}
    alone, one = simulated(model, 1, 50.0, "tsit5", **settings)
    together, other = simulated(model, 3, 50.0, "tsit5", **settings)
    assert not one.ok
    assert one == other
    assert alone.reached == together.reached


def test_the_first_to_fail_is_told_in_any_number_of_threads() -> None:
    source = """agent Late() { write real x = 1; diff { x' = if time < 3 then 0 else x^9*1e9; } }
agent Early() { write real x = 1; diff { x' = if time < 2 then 0 else x^9*1e9; } }
agent Both() { agent late = Late(); agent early = Early(); }"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = hierc.load(source)
    found = [simulated(model, threads, 5.0)[1] for threads in (1, 2)]
    said = [re.sub(r"smaller than \S+ s", "smaller", status.message) for status in found]
    assert said[0] == said[1]
    assert "`early.x`" in said[0]


def test_threads_by_the_public_interface() -> None:
    model = hierc.load("platoon", params={"N": 50})
    alone, together = model.simulate(20), model.simulate(20, threads=2)
    for name in model.states:
        assert np.array_equal(alone[name], together[name])


@pytest.mark.parametrize("threads", [0, -1, 1.5, True])
def test_a_number_of_threads_that_is_none_is_refused(threads: int) -> None:
    with pytest.raises(SettingError, match="threads must be a whole number of at least 1"):
        hierc.load("cart").simulate(1, threads=threads)


def test_calls_become_short_where_steps_are_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in one thread: a call of the kernel should take some hundredths of a second, whatever a step costs."""
    budgets: list[int] = []

    class Watched(Pace):
        def learn(self, spent: float) -> None:
            super().learn(1000 * spent)
            budgets.append(self.budget)

    monkeypatch.setattr("hierc.runtime.wavefront.Pace", Watched)
    monkeypatch.setattr("hierc.runtime.wavefront._FIRST_STEPS", 1e9)
    model = a_model(platoon(12))
    assert_equal(simulated(model, 1, 20.0)[0], simulated(model, 2, 20.0)[0])
    assert min(budgets) < 100
