"""Costs of a run: the run with timers is the same run, its sections are those that the counters count, and the parts make the whole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from array_models import a_model, platoon

import hierc
from hierc.runtime import costs as counting
from hierc.runtime.costs import Costs, cost_of
from hierc.runtime.machine.timing import ALGEBRA, INPUTS, PARTS, PUBLISHING, RHS, STEPS, TIMERS
from hierc.runtime.machine.unit import Unit
from hierc.runtime.methods.radau import step
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun

SETTINGS = {"start": 0.0, "stop": 5.0, "rtol": 1e-6, "atol": 1e-6, "max_step": np.inf, "min_step": 0.0}
METHODS = ("radau5", "radau13", "tsit5", "dop853")


def timed(model: Model, method: str) -> FinishedRun:
    return model.engine.with_timers.run(model.system(), {**SETTINGS, "method": method}, {})


def costs(model: Model, method: str = "radau9") -> Costs:
    settings: Mapping[str, object] = {**SETTINGS, "method": method}
    return cost_of(model.engine, model.engine.run(model.system(), settings, {}), settings, {})


@pytest.mark.parametrize("method", METHODS)
def test_timers_change_no_bit_of_a_run(method: str) -> None:
    model = a_model(platoon(4))
    plain = model.engine.run(model.system(), {**SETTINGS, "method": method}, {})
    again = timed(model, method)
    assert plain.clocks is None
    for x, y in zip(plain.groups, again.groups, strict=True):
        assert x.coefficients.tobytes() == y.coefficients.tobytes()
        assert x.stats == y.stats


@pytest.mark.parametrize("method", METHODS)
def test_sections_are_those_that_are_counted(method: str) -> None:
    """Radau evaluates, factors and solves as often as its counters say; each group that reads something reads it at each trial."""
    run = timed(a_model(platoon(4)), method)
    assert run.clocks is not None
    assert run.groups.records is not None
    calls = run.clocks[:, :, 1]
    count = {
        name: run.groups.records[name] for name in ("steps", "evaluations", "factorizations", "rejected")
    }
    assert (calls[:, STEPS] >= count["steps"]).all()
    assert (calls[:, RHS] > count["evaluations"]).all()  # fixed parts have calls of their own
    assert (calls[:, INPUTS] > count["steps"]).all()
    assert not calls[:, PUBLISHING].any()  # cars read states alone
    if method.startswith("radau"):
        solved = calls[:, ALGEBRA] - count["factorizations"]
        assert (solved > count["steps"]).all()
    else:
        assert not calls[:, ALGEBRA].any()
    assert not calls[:, TIMERS].any()
    assert (run.clocks[:, STEPS, 0] >= run.clocks[:, RHS, 0]).all()


def test_parts_make_the_whole() -> None:
    found = costs(a_model(platoon(4)))
    assert [g.name for g in found.groups] == ["lead", "car[1..4]"]
    assert found.seconds == pytest.approx(sum(g.seconds for g in found.groups))
    for g in found.groups:
        parts = (g.rhs, g.algebra, g.inputs, g.publishing, g.rest)
        assert min(parts) >= 0.0
        assert sum(parts) >= g.seconds * (1 - 1e-12)
        assert g.rhs > 0.0
    assert found.timers > 0.0


def test_an_array_is_told_in_one_row() -> None:
    model = a_model(platoon(5))
    found = costs(model, "radau5")
    stats = model.engine.run(model.system(), {**SETTINGS, "method": "radau5"}, {}).groups
    assert [(g.name, g.groups) for g in found.groups] == [("lead", 1), ("car[1..5]", 5)]
    cars = [g.stats for g in stats if g.name.startswith("car")]
    assert found.groups[1].evaluations == sum(s["evaluations"] for s in cars)
    kind = next(k for k in model.plan.classes if k.inputs)
    assert found.groups[1].flops == found.groups[1].evaluations * 4 * kind.flops  # radau5 has four lanes


def test_time_of_timers_is_taken_off() -> None:
    """Two calls of 100 ticks, of which a timer takes 10, in a step of 1000 in which each of the three timers takes 25."""
    clocks = np.zeros((1, len(PARTS), 2), np.int64)
    clocks[0, RHS] = 200, 2
    clocks[0, INPUTS] = 50, 1
    clocks[0, STEPS] = 1000, 1
    seconds, lost = counting._seconds(clocks, counting._Timer(inside=10.0, around=25.0, rate=1e9))
    assert seconds[0, RHS] == pytest.approx(180e-9)
    assert seconds[0, INPUTS] == pytest.approx(40e-9)
    assert seconds[0, STEPS] == pytest.approx((1000 - 10 - 3 * 25) * 1e-9)
    assert lost == pytest.approx(4 * 25e-9)


def test_only_units_that_are_made_for_it_have_timers() -> None:
    from hierc.runtime.methods.catalogue import METHODS as known

    method = known["radau9"]
    texts = []
    for timers in (False, True):
        unit = Unit("one", timed=timers)
        unit.lower(step, lanes=method.lanes, constants=method.step_names(), export="step")
        texts.append(unit.text())
    assert ["counter" in text for text in texts] == [False, True]


def test_a_run_that_fails_at_its_start_has_no_costs() -> None:
    model = hierc.load("agent A(real k = 0) { write real x = 1/k; diff { x' = -x; } }")
    settings = {**SETTINGS, "method": "radau5"}
    run = model.engine.run(model.system(), settings, {})
    assert run.status.name == "BAD_START"
    assert cost_of(model.engine, run, settings, {}) == Costs((), 0.0, 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_publishing_is_told_apart(method: str) -> None:
    """Only the second of three groups has something algebraic that another reads."""
    text = """
agent Clock() { write real x = 1; diff { x' = -x; } }
agent Middle() { read real x; write real y = 0, z; alge { z = y*y + sin(x); } diff { y' = x - y; } }
agent Last() { read real z; write real w = 0; diff { w' = z - w; } }
agent Three() {
  level a { agent a = Clock(); }
  level b { agent b = Middle() [x := a.x]; }
  level c { agent c = Last() [z := b.z]; }
}
"""
    run = timed(hierc.load(text), method)
    assert run.clocks is not None
    assert (run.clocks[:, PUBLISHING, 1] > 0).tolist() == [False, True, False]
