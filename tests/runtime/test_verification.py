"""Errors as a second run shows them: against closed forms, and what is said where there is no second run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_models import OSCILLATOR, At, a_plan

import hierc
from hierc.runtime.contract import Experiment
from hierc.runtime.errors import SettingError
from hierc.runtime.model import Model

STOP = 20.0


def oscillators(experiment: Experiment | None = None) -> Model:
    nodes = {"slow": At(OSCILLATOR, (), 1), "fast": At(OSCILLATOR, (), 1)}
    plan = a_plan(nodes, None, {"slow.w": 1.0, "fast.w": 9.0})
    return Model(replace(plan, experiment=experiment or Experiment()))


@pytest.mark.parametrize("method", ["radau5", "radau13", "tsit5"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_errors_are_those_beside_the_closed_form(method: str, tolerance: float) -> None:
    model = oscillators()
    r = model.simulate(STOP, tolerance, tolerance, method=method, verify=True)
    assert r.verification is not None
    for group, w in (("slow", 1.0), ("fast", 9.0)):
        starts, sizes = r.steps(group)
        t = (starts[:, None] + sizes[:, None] * np.array([0.25, 0.5, 0.75, 1.0])).clip(max=STOP).ravel()
        exact = {f"{group}.c": np.cos(w * t), f"{group}.s": np.sin(w * t)}
        errors = [np.abs(r(name, t) - values).max() for name, values in exact.items()]
        true = max(errors) / (2 * tolerance)  # the states' size and `nominal` are 1
        found = next(v for v in r.verification.groups if v.name == group)
        assert found.error == pytest.approx(true, rel=0.3)
        assert found.state in exact
        assert 0 < found.time <= STOP
    assert r.verification.error == max(v.error for v in r.verification.groups)
    assert r.verification.status.ok
    assert r.verification.reached == STOP


def test_a_result_that_was_not_verified_has_no_error() -> None:
    assert oscillators().simulate(STOP).verification is None


def test_each_group_is_measured_by_its_own_tolerance() -> None:
    model = oscillators(Experiment(groups={"fast": {"rtol": 1e-3}}))
    r = model.simulate(STOP, verify=True)
    assert r.verification is not None
    found = {v.name: v for v in r.verification.groups}
    wanted = {"slow": 1e-6, "fast": 1e-3}
    for group, w in (("slow", 1.0), ("fast", 9.0)):
        name, t = found[group].state, found[group].time
        exact = np.cos(w * t) if name.endswith(".c") else np.sin(w * t)
        assert abs(r(name, t) - exact) / (2 * wanted[group]) == pytest.approx(found[group].error, rel=0.3)


def test_the_results_are_those_of_the_first_run() -> None:
    model = oscillators()
    plain, checked = model.simulate(STOP), model.simulate(STOP, verify=True)
    for name in model.states:
        assert np.array_equal(plain[name], checked[name])


def test_tolerances_without_room_below_them_are_refused_before_the_run() -> None:
    with pytest.raises(SettingError, match="cannot be verified: the second run would need 1e-15"):
        oscillators().simulate(STOP, 1e-14, verify=True)


def test_arrays_are_told_together() -> None:
    found = (
        hierc.load("platoon", params={"N": 40})
        .simulate(stop=20, rtol=1e-5, group="level", verify=True)
        .verification
    )
    assert found is not None
    assert [v.name for v in found.groups] == ["lead", "car[1..40]"]
    assert found.groups[1].state.startswith("car[")
    assert 0 < found.error < 10


def test_a_second_run_that_fails_says_so() -> None:
    """Its steps would have to be smaller than the user allows."""
    settings: dict[str, Any] = {"rtol": 1e-3, "method": "radau5", "min_step": 0.045}
    found = oscillators().simulate(STOP, verify=True, **settings).verification
    assert found is not None
    assert found.status.name == "STEP_TOO_SMALL"
    assert found.reached < STOP
