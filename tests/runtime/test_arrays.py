"""Arrays of agents: the same equations, the same steps and the same names as the agents written one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from array_models import a_model, chain, one_by_one, platoon, robots
from numpy.typing import NDArray
from running import METHODS, run
from scipy.integrate import solve_ivp

import hierc
from hierc.runtime import kernel, layout, simulation
from hierc.runtime.contract import Plan
from hierc.runtime.errors import SettingError
from hierc.runtime.model import Model
from hierc.runtime.result import Result, SimulationError
from hierc.runtime.run import FinishedRun

Floats = NDArray[np.float64]
RNG = np.random.default_rng(11)

PLANS: dict[str, Callable[[], Plan]] = {
    "platoon": lambda: platoon(9),
    "platoon, numbered backwards": lambda: platoon(9, order=True),
    "platoon of one": lambda: platoon(2),
    "chain": lambda: chain(7, one_group=True),
    "robots": lambda: robots(3, 4),
}
each_plan = pytest.mark.parametrize("name", PLANS)


def pair(name: str) -> tuple[Model, Model]:
    plan = PLANS[name]()
    return a_model(plan), a_model(one_by_one(plan))


def same(a: FinishedRun, b: FinishedRun) -> bool:
    return len(a.groups) == len(b.groups) and all(
        x.name == y.name
        and x.knots.tobytes() == y.knots.tobytes()
        and x.coefficients.tobytes() == y.coefficients.tobytes()
        and x.stats == y.stats
        for x, y in zip(a.groups, b.groups, strict=True)
    )


# ---- equations ---------------------------------------------------------------------------------


@each_plan
def test_the_same_equations(name: str) -> None:
    array, single = pair(name)
    assert array.states == single.states
    assert array.initial().tobytes() == single.initial().tobytes()
    for _ in range(3):
        t, x = float(RNG.uniform(0, 9)), RNG.normal(0, 1, len(array.states))
        assert array.rhs(t, x).tobytes() == single.rhs(t, x).tobytes()
        assert array.jacobian(t, x).tobytes() == single.jacobian(t, x).tobytes()


@each_plan
def test_jacobians_are_derivatives(name: str) -> None:
    model, _ = pair(name)
    x = RNG.normal(0, 1, len(model.states))
    columns = []
    for k in range(len(x)):
        d = np.zeros(len(x))
        d[k] = 1e-5
        columns.append((model.rhs(1.0, x + d) - model.rhs(1.0, x - d)) / 2e-5)
    assert model.jacobian(1.0, x) == pytest.approx(np.stack(columns, axis=1), rel=1e-6, abs=1e-6)


def test_state_names() -> None:
    model = a_model(robots(2, 2))
    assert model.states[2:] == tuple(
        f"robot[{i}].link[{j}].q[{k}]" for i in (1, 2) for j in (1, 2) for k in (1, 2)
    )


# ---- runs --------------------------------------------------------------------------------------


@each_plan
@pytest.mark.parametrize("method", METHODS)
def test_the_same_run(name: str, method: str) -> None:
    """Bit for bit, groups and all."""
    array, single = pair(name)
    finished = run(array, 8.0, 1e-6, method=method)
    assert finished.status.ok
    assert same(finished, run(single, 8.0, 1e-6, method=method))


def test_numbering_changes_nothing() -> None:
    """The cascade's order decides, whatever the numbers of its groups."""
    assert same(
        run(a_model(platoon(9)), 8.0, method="auto"), run(a_model(platoon(9, order=True)), 8.0, method="auto")
    )


def test_one_form_a_pattern() -> None:
    """A thousand cars are wired like ten, and share their code."""
    few, many = (a_model(platoon(n)).engine.wiring for n in (10, 1000))
    assert len(few) == len(many) == 3
    assert [w.form for w in few] == [w.form for w in many]
    assert few[2].form.inputs == 3
    assert few[2].runs == ((0, 1), (1, 2))  # the leader's speed; place and speed of the car ahead
    assert [len(w.places) for w in many] == [1, 1, 999]


@pytest.mark.parametrize("count", [10, 100])
def test_against_another_solver(count: int) -> None:
    model = a_model(platoon(count))
    t = np.linspace(0.0, 12.0, 61)
    reference = solve_ivp(
        model.rhs, (0.0, 12.0), model.initial(), "LSODA", t, rtol=1e-10, atol=1e-10, min_step=0.0
    )
    assert reference.success
    result = model.simulate(stop=12.0, rtol=1e-7)
    names = list(model.states)
    for k in (1, 2, count // 2, count):
        for variable in ("x", "v"):
            expected = reference.y[names.index(f"car[{k}].{variable}")]
            assert result(f"car[{k}].{variable}", t) == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert result("car.v", t)[:, -1].tolist() == result(f"car[{count}].v", t).tolist()


def test_chain_against_another_solver() -> None:
    model = a_model(chain(12, one_group=True))
    assert [g.states for g in model.simulate(stop=0.1).families] == [(24,)]
    t = np.linspace(0.0, 5.0, 41)
    reference = solve_ivp(model.rhs, (0.0, 5.0), model.initial(), "DOP853", t, rtol=1e-11, atol=1e-11)
    found = model.simulate(stop=5.0, rtol=1e-8)("mass.x", t)
    names = list(model.states)
    expected = reference.y[[names.index(f"mass[{k}].x") for k in range(1, 13)]].T
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("budget", [1, 7, 1000])
def test_calls_of_any_length(budget: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model = a_model(platoon(12))
    whole = run(model, 10.0)
    take = simulation.Simulation._slice

    def slice_of_fixed_size(self: simulation.Simulation) -> float:
        self._pace.budget = budget
        return take(self)

    monkeypatch.setattr(simulation.Simulation, "_slice", slice_of_fixed_size)
    assert same(whole, run(model, 10.0))


def test_windows_of_any_length(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = run(a_model(platoon(12)), 10.0)
    monkeypatch.setenv("HIERC_CACHE", "")
    monkeypatch.setattr(kernel, "WINDOW_STEPS", 2.5)
    assert same(usual, run(a_model(platoon(12)), 10.0))


@pytest.mark.parametrize("method", ["radau13", "tsit5"])
def test_growing_memory(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All groups leave the memory they share, some for a mapping of their own."""
    usual = run(a_model(platoon(12)), 10.0, 1e-8, method=method)
    monkeypatch.setattr(layout, "_ROOM", 2)
    monkeypatch.setattr("hierc.runtime.track._MAPPED", 1 << 14)
    assert same(usual, run(a_model(platoon(12)), 10.0, 1e-8, method=method))


def test_little_room_for_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where all groups' room would be too much each begins with less."""
    usual = run(a_model(platoon(12)), 10.0)
    monkeypatch.setattr(layout, "_FIRST_BYTES", 1)
    assert same(usual, run(a_model(platoon(12)), 10.0))


def test_a_method_for_a_family_and_for_one() -> None:
    groups = {"car[3]": {"method": "tsit5", "max_step": 0.1}, "car": {"method": "radau5", "rtol": 1e-4}}
    finished = run(a_model(platoon(5)), 5.0, groups=groups)
    assert {g.name: g.method for g in finished.groups} == {
        "lead": "radau9", "car[1]": "radau5", "car[2]": "radau5", "car[3]": "tsit5", "car[4]": "radau5", "car[5]": "radau5",
    }  # fmt: skip
    assert np.diff(finished.groups[3].knots).max() <= 0.1 * (1 + 1e-12)
    some = run(a_model(platoon(5)), 5.0, groups={"car[2..3]": {"method": "radau5"}})
    assert [g.method for g in some.groups] == ["radau9", "radau9", "radau5", "radau5", "radau9", "radau9"]


def test_tolerances_follow_the_cascade() -> None:
    """Each reading edge tightens, down to a floor: far ahead of the last car all are alike."""
    model = a_model(platoon(20))
    finished = run(model, 1.0)
    assert finished.status.ok
    settings = {"rtol": 1e-6, "atol": 1e-6, "method": "radau9", "max_step": math.inf, "min_step": 0.0}
    rtol = model.engine.group_settings(settings, {}).numbers[0]
    assert rtol[-4:] / 1e-6 == pytest.approx([0.03, 0.09, 0.3, 1.0])
    assert rtol[:-3] / 1e-6 == pytest.approx([0.03] * 18)


def test_published_outs_are_those_that_are_read() -> None:
    """Cars read the gap of the car ahead: the last car's is read by nobody."""
    plan = platoon(6)
    reading = tuple(
        replace(node, sources=((*node.sources[0][:1], "out", 0), *node.sources[1:])) if k == 2 else node
        for k, node in enumerate(plan.nodes)
    )
    array = a_model(replace(plan, nodes=reading))
    assert [len(w.outs) for w in array.engine.wiring] == [0, 1, 0, 1]
    assert sorted(len(w.places) for w in array.engine.wiring) == [1, 1, 1, 4]
    finished = run(array, 8.0)
    assert finished.status.ok
    assert same(finished, run(a_model(one_by_one(array.plan)), 8.0))


def test_failures_name_the_agent() -> None:
    """One car's actuator is told to grow without bound."""
    model = a_model(platoon(5))
    with pytest.raises(SimulationError, match=r"`car\[4\]`"):
        model.simulate(stop=1e6, params={"car[4].ka": -50.0}, most_steps=3000)


# ---- parameters --------------------------------------------------------------------------------


def test_parameters_of_all_some_and_one() -> None:
    model = a_model(platoon(6))
    tau = model.parameters["car.tau"]
    assert tau.unit == "ms"
    assert tau.shown == "car[1..6].tau"
    assert np.asarray(tau.value) == pytest.approx([300.0 / (1 + k) for k in range(1, 7)])
    assert np.asarray(model.parameters["car.ka"].value) == pytest.approx([20 + 30 * k for k in range(1, 7)])

    def taus(params: dict[str, object]) -> list[float]:
        return [round(v, 9) for v in model.with_parameters(params).parameters["car.tau"].value]  # type: ignore[union-attr]

    usual = [round(300.0 / (1 + k), 9) for k in range(1, 7)]
    assert taus({"car.tau": 70}) == [70.0] * 6
    assert taus({"car[3].tau": 70}) == [*usual[:2], 70.0, *usual[3:]]
    assert taus({"car[2..4].tau": [7, 8, 9]}) == [usual[0], 7.0, 8.0, 9.0, *usual[4:]]
    assert taus({"car.tau": [1, 2, 3, 4, 5, 6]}) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert taus({"car[3].tau": 70, "car.tau": 50}) == [50.0, 50.0, 70.0, 50.0, 50.0, 50.0]


def test_nested_parameters() -> None:
    model = a_model(robots(3, 4))
    assert np.asarray(model.parameters["robot.link.k"].value).shape == (3, 4)
    set_one = model.with_parameters({"robot[2].link[3].k": 99.0, "robot[1].link.k": 1.0})
    found = np.asarray(set_one.parameters["robot.link.k"].value)
    assert found[0].tolist() == [1.0] * 4
    assert found[1].tolist() == [10.0, 11.0, 99.0, 13.0]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("car[7].tau", 1.0, "`car` goes from 1 to 6"),
        ("car[0].tau", 1.0, "`car` goes from 1 to 6"),
        ("car[4..9].tau", 1.0, "`car` goes from 1 to 6"),
        ("car.tao", 1.0, "did you mean `car[1..6].tau`?"),
        ("lead[1].v_max", 1.0, "no array of agents"),
        ("car.tau", [1.0, 2.0], r"a number, or (6,) for one each; got shape (2,)"),
        ("car[2].tau", [1.0, 2.0], r"is a number; got shape (2,)"),
        ("car[x].tau", 1.0, "a subscript is a number"),
    ],
)
def test_wrong_parameters(name: str, value: object, said: str) -> None:
    with pytest.raises(SettingError) as caught:
        a_model(platoon(6)).with_parameters({name: value})
    assert said in str(caught.value)


# ---- results -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result() -> Result:
    return a_model(platoon(6)).simulate(stop=5.0, interval=0.5)


def test_results_by_name(result: Result) -> None:
    v = result["car.v"]
    assert v.shape == (11, 6)
    assert result["car[3].v"].tolist() == v[:, 2].tolist()
    assert result["car[2..4].v"].tolist() == v[:, 1:4].tolist()
    assert result("car.v", 2.5).tolist() == v[5].tolist()
    assert result("car[6].v", 2.5) == v[5, 5]
    assert result("car.v", [[0.0], [2.5]]).shape == (2, 1, 6)
    assert "car[6].x" in result
    assert "car[7].x" not in result
    assert result.names == ("lead.v", "car.x", "car.v", "car.gap", "car.power")
    assert result.unit("car[3].x") is None


def test_observed_variables_by_name(result: Result) -> None:
    ahead = np.concatenate([result("car.x", 3.0)[:-1]])
    assert result("car.gap", 3.0)[1:] == pytest.approx(ahead - result("car.x", 3.0)[1:], rel=1e-15)
    assert result["car[3].gap"].tolist() == result["car.gap"][:, 2].tolist()
    lead = result("lead.v", 3.0)
    assert result("car.power", 3.0) == pytest.approx(lead * result("car.v", 3.0), rel=1e-15)


def test_nested_results() -> None:
    result = a_model(robots(3, 4)).simulate(stop=1.0, interval=0.25)
    q = result["robot.link.q"]
    assert q.shape == (5, 3, 4, 2)
    assert result["robot[2].link.q"].tolist() == q[:, 1].tolist()
    assert result["robot.link[4].q"].tolist() == q[:, :, 3].tolist()
    assert result["robot[2..3].link[1].q[2]"].tolist() == q[:, 1:, 0, 1].tolist()
    assert result["robot[3].link[4].q[1]"].shape == (5,)
    told = result["robot.link.told"]
    assert told[:, :, 1:] == pytest.approx(2 * q[:, :, :-1, 0], rel=1e-15)


def test_columns_have_names_of_their_own(result: Result) -> None:
    assert list(result.columns(["car[2..3].v", "lead.v"])) == ["car[2].v", "car[3].v", "lead.v"]
    nested = a_model(robots(2, 2)).simulate(stop=1.0, interval=0.5)
    assert list(nested.columns(["robot[2].link.q"])) == [
        f"robot[2].link[{k}].q[{i}]" for k in (1, 2) for i in (1, 2)
    ]
    assert list(nested.columns(["robot[2].link.q[2]"])) == ["robot[2].link[1].q[2]", "robot[2].link[2].q[2]"]
    assert len(result.columns()) == 1 + 3 * 6  # private ones are left out
    for name, column in result.columns(["car.gap"]).items():
        assert column.tolist() == result[name].tolist()


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (("car[1..2].v",), ["car[1].v", "car[2].v"]),
        (("lead.v", "car[3].*"), ["lead.v", "car[3].x", "car[3].v", "car[3].gap"]),
        (("car[5..6].*",), [f"car[{k}].{v}" for v in ("x", "v", "gap") for k in (5, 6)]),
    ],
)
def test_records(record: tuple[str, ...], expected: list[str]) -> None:
    plan = platoon(6)
    chosen = replace(plan, experiment=replace(plan.experiment, record=record))
    assert list(a_model(chosen).simulate(stop=1.0, interval=0.5).columns()) == expected


SIZES = """
agent Tip(int n) { write real[n] q = [k for k in 1..n]; diff { q' = zeros(n); } }
agent Row(int n) { agent tip[j in 1..n] = Tip(n = 2); write real sum; alge { sum = 1; } }
agent Grid() { agent row[i in 1..2] = Row(n = i); agent tip[i in 1..2] = Tip(n = i); }
"""


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ("", ["row.sum", "row[1].tip.q", "row[2].tip.q", "tip[1].q", "tip[2].q"]),
        ("record row.tip.q;", ["row[1].tip.q", "row[2].tip.q"]),
        ("record row.*;", ["row.sum", "row[1].tip.q", "row[2].tip.q"]),
        ("record row[1..2].tip[1].q, tip.*;", ["row[1..2].tip[1].q", "tip[1].q", "tip[2].q"]),
        ("record row[2].tip.q;", ["row[2].tip.q"]),
    ],
)
def test_records_of_arrays_that_differ_in_size_or_shape(record: str, expected: list[str]) -> None:
    r = hierc.load(
        f"{SIZES} experiment e of Grid() {{ stop = 1 [s]; interval = 1 [s]; {record} }}"
    ).simulate()
    assert list(r.recorded) == expected
    assert all(r[name].size for name in r.recorded)
    assert r["row[2].tip[2].q"].tolist() == [[1, 2], [1, 2]]
    for name in ("row.tip.q", "tip.q"):
        with pytest.raises(KeyError, match=r"has no shape: .*give more indices"):
            _ = r[name]


def test_panels_by_array(result: Result) -> None:
    assert result.panels() == {"lead": ["lead.v"], "car": ["car.x", "car.v", "car.gap"]}


def test_wrong_names(result: Result) -> None:
    for name, said in (
        ("car[9].v", "`car` goes from 1 to 6"),
        ("car.pover", "did you mean `car[1..6].power`?"),
        ("car[2].v[1]", "is a number"),
        ("car[3..2].v", "is empty"),
        ("lead[2].v", "no array of agents"),
    ):
        with pytest.raises(KeyError) as caught:
            result[name]
        assert said in str(caught.value)


def test_statistics_of_families(result: Result) -> None:
    lead, cars = result.families
    assert (lead.name, lead.groups, lead.states) == ("lead", 1, (2,))
    assert (cars.name, cars.groups, cars.states) == ("car[1..6]", 6, (4,))
    each = [result.stats[f"car[{k}]"] for k in range(1, 7)]
    assert cars.steps == sum(s.steps for s in each)
    assert (cars.steps_min, cars.steps_max) == (min(s.steps for s in each), max(s.steps for s in each))
    assert cars.step_max == max(s.step_max for s in each)
    assert cars.evaluations == sum(s.evaluations for s in each)
    assert list(result.stats) == ["lead", *(f"car[{k}]" for k in range(1, 7))]
    starts, sizes = result.steps("car[6]")
    assert len(starts) == each[5].steps
    assert sizes.sum() == pytest.approx(5.0)
    with pytest.raises(KeyError, match="`car` goes from 1 to 6"):
        result.stats["car[61]"]


def test_what_a_model_says_of_itself() -> None:
    assert repr(a_model(platoon(6))) == "<Model Array: 26 states in groups lead, car[1..6]; 3 parameters>"
