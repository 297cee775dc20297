"""Calls that only inputs reach: which they are, what a loop over many of them computes, and that code does not grow with their number."""

from __future__ import annotations

import numpy as np
import pytest
from array_models import a_model, one_by_one
from fan_models import fan
from machine_code import exported, room
from numpy.typing import NDArray
from running import METHODS, run
from scipy.integrate import solve_ivp

from hierc.runtime.contract import Plan
from hierc.runtime.machine import body
from hierc.runtime.machine.calls import divide, series
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.forms import wire
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.parameters import parameter_vector
from hierc.runtime.run import FinishedRun
from hierc.runtime.system import System

Floats = NDArray[np.float64]
RNG = np.random.default_rng(17)
NEVER = 10**9


def composer_of(plan: Plan, name: str, lanes: int = 8) -> Composer:
    """The composer of a group's form."""
    names = [family.name for family in plan.groups]
    (wiring,) = (w for w in wire(plan) if names[w.family] == name)
    return Composer(Unit("fan"), "fan", wiring.form, plan.classes, parse_function, lanes)


def bits(finished: FinishedRun) -> list[tuple[bytes, bytes]]:
    assert finished.status.ok
    return [(g.knots.tobytes(), g.coefficients.tobytes()) for g in finished.groups]


# ---- which calls ---------------------------------------------------------------------------------


def test_calls_that_states_do_not_reach() -> None:
    plan = fan(2)
    composer = composer_of(plan, "reader")
    names = [c.name for c in plan.classes]
    division = composer.division
    assert {names[c.kind] for c in division.before} == {"Each", "Sum", "Top"}
    assert [names[c.kind] for c in division.reached] == ["Mix", "Reader"]
    last = [c.y for c in division.before if names[c.kind] in ("Sum", "Top")]
    assert set(division.kept) == {max(last[:5]), max(last[5:])}  # the roots alone


def test_alike_calls_stand_together() -> None:
    """A series reads nothing of its own, and only what came before."""
    plan = fan(3)
    composer = composer_of(plan, "reader")
    found = series(composer.division.before, plan.classes)
    assert sorted(len(s) for s in found) == sorted([64, 16, 4, 1, 32, 16, 8, 4, 2, 1])
    made: set[int] = set()
    for alike in found:
        assert {k for c in alike for where, k in c.sources if where == "out"} <= made
        made |= {c.y for c in alike}


def test_what_reads_a_state_stays() -> None:
    plan = fan(1)
    form = composer_of(plan, "reader").form
    division = divide(form.calls, plan.classes, lambda call: False)
    assert division.before == ()
    assert division.reached == form.calls


# ---- what they compute ---------------------------------------------------------------------------


@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("name", ["reader", "last"])
def test_right_hand_side(name: str, lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bits with loops and without; in one lane, those of plain Python."""
    plan = fan(2)
    system = System(plan, parameter_vector(plan, {}))
    names = [family.name for family in plan.groups]
    (wiring,) = (w for w in wire(plan) if names[w.family] == name)
    place = int(wiring.places[0])
    first, n = int(system.elements.group_offsets[place]), wiring.form.states
    t, x = RNG.uniform(0, 5, lanes), RNG.normal(0, 1, (lanes, system.size))
    u = room(wiring.form.inputs, lanes)
    for k, (owner, channel) in enumerate(zip(wiring.owners[0], wiring.channels[0], strict=True)):
        start = int(system.elements.group_offsets[owner])
        states = int(system.elements.group_states[owner])
        if channel < states:
            u[k] = x[:, start + channel]
        else:  # what the reader publishes
            reader = int(next(e for e, node in enumerate(system.elements.home.tolist()) if node == owner))
            u[k] = [system.outs_of(reader, system.world_at(s, row))[0] for s, row in zip(t, x, strict=True)]
    own = room(n, lanes)
    own[:] = x.T[first : first + n]
    values = np.array([*system.values_of(wiring.values[0]), 0.0])
    results = []
    for many in (body.MANY, NEVER):
        monkeypatch.setattr(body, "MANY", many)
        before, rest = composer_of(plan, name, lanes), composer_of(plan, name, lanes)
        v, dx = room(before.saved, lanes), room(n, lanes)
        exported(before.unit, before.rhs_fixed)(t, u, values, v)
        exported(rest.unit, rest.rhs)(t, own, u, values, dx, v)
        results.append(dx)
    assert (results[0] == results[1]).all()
    expected = np.array([system.rhs(s, row)[first : first + n] for s, row in zip(t, x, strict=True)]).T
    if lanes == 1:
        assert (results[0] == expected).all()
    else:
        assert results[0] == pytest.approx(expected, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_run(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit: by loops, call by call, and with every element a block of its own."""
    plan = fan(2)
    looped = bits(run(a_model(plan), 3.0, method=method))
    assert looped == bits(run(a_model(one_by_one(plan)), 3.0, method=method))
    monkeypatch.setattr(body, "MANY", NEVER)
    monkeypatch.setenv("HIERC_CACHE", "")
    assert looped == bits(run(a_model(plan), 3.0, method=method))


@pytest.mark.parametrize("method", METHODS)
def test_against_another_solver(method: str) -> None:
    model = a_model(fan(3))
    reference = solve_ivp(
        model.rhs, (0.0, 4.0), model.initial(), "DOP853", rtol=1e-11, atol=1e-11, max_step=0.05
    ).y[-3:, -1]  # x and y of the reader, z of the last
    result = model.simulate(stop=4.0, rtol=1e-6, atol=1e-6, method=method)
    found = np.array([result["reader.x"][-1], result["last.z"][-1]])
    assert found == pytest.approx(reference[[0, 2]], rel=1e-5, abs=1e-5)


# ---- code ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fixed", "rhs", "publish", "factor"])
def test_code_does_not_grow(name: str) -> None:
    """Four times the oscillators, one layer more of sums and two of extremes: always the same few instructions more."""
    sizes = []
    for depth in (3, 4, 5):
        composer = composer_of(fan(depth), "reader")
        composer.publish()
        composer.factor((1.0,) * 8, 1)
        (function,) = (f for f in composer.unit.module.functions if f.name == f"fan_{name}")
        sizes.append(body.inlined_size(function, {}))
    assert sizes[2] - sizes[1] == sizes[1] - sizes[0]
    assert (sizes[1] > sizes[0]) == (name in ("fixed", "publish"))


def test_switches_of_inputs_leave_a_group_linear() -> None:
    """The largest of some inputs has a Jacobian that jumps; by the group's own states nothing does."""
    plan = fan(1)
    assert composer_of(plan, "last").linear()
    assert not composer_of(plan, "reader").linear()  # a state times a sum
