"""Results by name, at the output times and between them, over a run whose values are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from hierc.runtime.contract import CONTRACT, Class, Experiment, Group, Node, Plan, Variable
from hierc.runtime.elements import Elements, expand
from hierc.runtime.observation import Variables
from hierc.runtime.result import Floats, GroupStats, Result, output_times
from hierc.runtime.status import Status
from hierc.runtime.trajectory import GroupTrajectory


def nothing(*_: object) -> None:
    """Stands for generated functions, which results never call."""


def a_class(*states: str) -> Class:
    return Class(
        "C",
        states,
        0,
        0,
        0,
        0,
        0,
        nothing,
        (),
        None,
        nothing,
        (),
        nothing,
        nothing,
        nothing,
        1,
        tuple(0 for _ in states),
    )


#: name, shape, unit, access, node
VARIABLES = (
    ("plan.p", (2,), "m", "write", 0),
    ("plan.hidden", (), None, "private", 0),
    ("cart.M", (2, 2), None, "write", 1),
    ("cart.x", (), "m", "write", 1),
)


def a_plan(experiment: Experiment | None = None) -> Plan:
    variables = tuple(
        Variable(path, shape, tuple((node, "state", i) for i in range(math.prod(shape))), unit, "", access)
        for path, shape, unit, access, node in VARIABLES
    )
    nodes = (Node("plan", 0, (), ()), Node("cart", 1, (), ()))
    groups = (Group("plan", (0,), ((0, -1),)), Group("dyn", (1,), ((1, -1),)))
    classes = (a_class("p[1]", "p[2]", "hidden"), a_class("x"))
    experiment = experiment or Experiment()
    return Plan(
        CONTRACT,
        "0",
        "Two",
        "",
        "two.hier",
        "",
        classes,
        nodes,
        groups,
        (),
        0,
        nothing,
        variables,
        1,
        experiment,
    )


def steps(name: str, method: str, knots: list[float], **counters: int) -> GroupTrajectory:
    starts = np.array(
        [[start, end, 1.0 / (end - start), end - start] for start, end in pairwise(knots)]
    ).reshape(-1, 4)
    return GroupTrajectory(name, method, 0, 8, starts, knots[-1], np.zeros(0), counters, program=None)  # type: ignore[arg-type]


DONE = Status("DONE", "reached 2 s")
TRAJECTORIES = (
    steps("plan", "radau9", [0.0, 1.0, 2.0], steps=2, rejected=1, evaluations=30),
    steps("dyn", "dop853", [0.0, 0.5, 0.6, 2.0], steps=3, rejected=0, evaluations=36),
)


@dataclass
class FakeRun:
    """p = (t, 2t), hidden = -t, M = t*[[1, 2], [3, 4]], x = sin t."""

    plan: Plan = field(default_factory=a_plan)
    start: float = 0.0
    stop: float = 2.0
    t_reached: float = 2.0
    status: Status = DONE
    groups: Sequence[GroupTrajectory] = TRAJECTORIES
    variables: Variables = field(init=False)
    asked: list[tuple[str, ...]] = field(default_factory=list)
    joined: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.variables = Variables(expand(self.plan))

    @property
    def compiled(self) -> Elements:
        return self.variables.elements

    def evaluate(self, paths: Sequence[str], t: Floats) -> Mapping[str, Floats]:
        self.asked.append(tuple(paths))
        values = {
            "plan.p": np.stack([t, 2 * t], axis=1),
            "plan.hidden": -t,
            "cart.M": t[:, None, None] * np.array([[1.0, 2.0], [3.0, 4.0]]),
            "cart.x": np.sin(t),
        }
        return {path: values[path] for path in paths}


def a_result(run: FakeRun | None = None, interval: float | None = 0.5) -> Result:
    return Result(run or FakeRun(), interval=interval, settings={"rtol": 1e-6}, params={})


def test_values_at_the_output_times_have_the_variables_shape() -> None:
    r = a_result()
    assert r.t.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert r["cart.x"].tolist() == [math.sin(t) for t in r.t]
    assert r["plan.p"].shape == (5, 2)
    assert r["plan.p[2]"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert r["cart.M"].shape == (5, 2, 2)
    assert r["cart.M[2,1]"].tolist() == [0.0, 1.5, 3.0, 4.5, 6.0]
    assert r["plan.hidden"][2] == -1.0


def test_a_variable_is_computed_once() -> None:
    run = FakeRun()
    r = a_result(run)
    _ = r["plan.p"], r["plan.p[1]"], r["plan.p"]
    assert run.asked == [("plan.p",)]


def test_dense_values_follow_the_shape_of_the_times() -> None:
    r = a_result()
    x = r("cart.x", 1.25)
    assert isinstance(x, float)
    assert x == math.sin(1.25)
    assert np.array_equal(r("cart.x", [[0.1, 0.2], [0.3, 0.4]]), np.sin([[0.1, 0.2], [0.3, 0.4]]))
    assert r("plan.p", 1.5).tolist() == [1.5, 3.0]
    assert r("plan.p", [0.0, 1.5]).tolist() == [[0.0, 0.0], [1.5, 3.0]]
    assert r("cart.M[1,2]", np.array([0.5])).tolist() == [1.0]
    assert r("cart.x", []).shape == (0,)


@pytest.mark.parametrize(
    ("t", "named"),
    [(-0.1, "-0.1"), (2.1, "2.1"), (math.nan, "nan"), ([0.0, 3.0], "3.0"), (2 + 1e-9, "2.000000001")],
)
def test_times_outside_the_run_are_refused(t: float | list[float], named: str) -> None:
    with pytest.raises(ValueError, match=rf"t = {named} s .* from 0.0 to 2.0 s"):
        a_result()("cart.x", t)


def test_times_that_rounding_put_outside_are_the_end() -> None:
    r = a_result(FakeRun(stop=0.3, t_reached=0.3), interval=0.1)
    assert 0.1 * 3 > 0.3
    assert r("cart.x", 0.1 * 3) == math.sin(0.3)
    assert r("cart.x", [0.0, 0.1 * 3]).tolist() == [0.0, math.sin(0.3)]


def test_values_are_for_reading() -> None:
    r = a_result()
    for values in (r.t, r["time"], r["cart.x"], r["plan.p[1]"], r.columns()["cart.M[1,1]"]):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 99.0


def test_time_is_a_name() -> None:
    r = a_result()
    assert "time" in r
    assert r["time"].tolist() == r.t.tolist()
    assert r("time", 0.25) == 0.25
    assert r("time", [[0.25], [0.5]]).tolist() == [[0.25], [0.5]]
    assert list(r.columns(["time", "cart.x"])) == ["cart.x"]  # a table has it anyway


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("cart.y", "did you mean `cart.x`?"),
        ("zzz", "unknown variable `zzz`"),
        ("plan.p[0]", "indices start at 1"),
        ("plan.p[3]", "has the shape [2]"),
        ("plan.p[1,1]", "has the shape [2]"),
        ("cart.x[1]", "is a number"),
    ],
)
def test_unknown_names_are_explained(name: str, said: str) -> None:
    r = a_result()
    with pytest.raises(KeyError) as error:
        r[name]
    assert said in str(error.value)
    assert name not in r


def test_what_is_recorded_follows_the_experiment() -> None:
    assert a_result().recorded == ("plan.p", "cart.M", "cart.x")
    chosen = FakeRun(plan=a_plan(Experiment(record=("plan.hidden", "plan.p[2]"))))
    assert list(a_result(chosen).columns()) == ["plan.hidden", "plan.p[2]"]
    assert list(a_result().columns(["plan.p", "cart.M[1,2]"])) == ["plan.p[1]", "plan.p[2]", "cart.M[1,2]"]


def test_names_units_and_settings() -> None:
    r = a_result()
    assert r.names == ("plan.p", "plan.hidden", "cart.M", "cart.x")
    assert r.units == {"plan.p": "m", "plan.hidden": None, "cart.M": None, "cart.x": "m"}
    assert r.settings == {"rtol": 1e-6}
    assert "plan.p[2]" in r
    assert r.panels() == {"plan": ["plan.p"], "dyn": ["cart.M", "cart.x"]}


def test_statistics_of_each_group() -> None:
    r = a_result()
    assert r.stats["plan"] == GroupStats("radau9", 3, 2, 1, 30, 0, 0, 1.0, 1.0, 1.0)
    dyn = r.stats["dyn"]
    assert (dyn.states, dyn.steps, dyn.evaluations) == (1, 3, 36)
    assert (dyn.step_min, dyn.step_median, dyn.step_max) == pytest.approx((0.1, 0.5, 1.4))
    starts, sizes = r.steps("dyn")
    assert starts.tolist() == [0.0, 0.5, 0.6]
    assert sizes.sum() == pytest.approx(2.0)
    with pytest.raises(KeyError, match="did you mean `dyn`"):
        r.steps("dynn")
    with pytest.raises(KeyError, match="did you mean `dyn`"):
        r.stats["dynn"]


def test_a_run_that_failed_at_once_still_has_its_start() -> None:
    stuck = steps("plan", "radau9", [0.0])
    run = FakeRun(t_reached=0.0, status=Status("STEP_TOO_SMALL", "no step at 0 s"), groups=(stuck,))
    r = a_result(run, interval=None)
    assert r.t.tolist() == [0.0]
    assert r["cart.x"].tolist() == [0.0]
    assert r.stats["plan"].steps == 0
    assert math.isnan(r.stats["plan"].step_median)
    assert "no step at 0 s" in repr(r)


@pytest.mark.parametrize(
    ("interval", "expected"),
    [
        (0.25, [1.0, 1.25, 1.5, 1.75, 2.0]),
        (0.3, [1.0, 1.3, 1.6, 1.9, 2.0]),  # the end always stands in a result
        (5.0, [1.0, 2.0]),
    ],
)
def test_output_times(interval: float, expected: list[float]) -> None:
    assert output_times(1.0, 2.0, interval).tolist() == pytest.approx(expected, rel=1e-15)


def test_output_times_do_not_drift() -> None:
    times = output_times(0.0, 50.0, 0.1)  # 0.1 is not a binary fraction
    assert len(times) == 501
    assert times[333] == 333 * 0.1
    assert times[-1] == 50.0
    assert len(output_times(0.0, 0.3, 0.1)) == 4


@pytest.mark.parametrize("interval", [0.0, -1.0, math.nan, 1e-9])
def test_impossible_intervals(interval: float) -> None:
    with pytest.raises(ValueError, match="interval"):
        output_times(0.0, 1.0, interval)
