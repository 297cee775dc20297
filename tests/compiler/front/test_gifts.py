"""What an experiment gives, and what it sees: the parameters of the agent that runs; a value for each agent of an array."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import model_of

from hierc.compiler.driver import compile_source
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile
from hierc.loader import run_module
from hierc.runtime.model import Model

FILE = """
const real k = 7;
agent Link(real T [s] = 0.1, real y0 = 0) { read real u; write real y = y0; diff { y' = (u - y)/T; } }
agent Robot(real k [1/s] = 1, real x0 = 1, real p1 = 1, real p2 = 0, int n = 2, bool up = true) {
  read real u;
  write real[2] p = [p1, p2];
  write real x = x0;
  diff { p' = -k*p; x' = if up then u - k*x else 1; }
  agent link[j in 0..n] = Link(T = j + 1 [s]) [u := x];
}
"""
BODY = """
  read real push;
  let twice = 2*v0;
  const real half = 0.5;
  agent robot[i in 1..N] = Robot({}) [u := if i == 1 then push else robot[i - 1].x];
}}"""
TOP = FILE + "agent Top(int N = 5, real v0 = 2, real T [s] = 3, real k = 9) {" + BODY.format("")


def compiled(text: str, name: str, **given: object) -> Model:
    source = SourceFile("model.hier", text)
    model: Model = run_module(compile_source(source, name).text, "model.hier").MODEL
    return model.with_parameters(given)


def same(model: Model, other: Model) -> None:
    """Equal initial values, and derivatives at some state."""
    assert model.states == other.states
    np.testing.assert_array_equal(model.initial(), other.initial())
    x = np.random.default_rng(3).normal(size=len(model.states))
    np.testing.assert_array_equal(model.rhs(0.7, x), other.rhs(0.7, x))


@pytest.mark.parametrize(
    ("given", "init", "argument"),
    [
        ("robot.k = [1, 2, 3, 4, 5]", "", "k = i"),
        ("robot.k = [0.5, 2, 2, 1/4, 5]", "", "k = if i == 1 then 0.5 else if i <= 3 then 2 else if i == 4 then 0.25 else 5"),
        ("robot.k = [i/N for i in 1..N]", "", "k = i/N"),
        ("robot.k = [i/k for i in 2..N + 1]", "", "k = (i + 1)/9"),
        ("robot.k = v0", "", "k = v0"),
        ("robot.k = [v0*i + twice for i in 1..5]", "", "k = v0*i + 2*v0"),
        ("robot[2..N - 1].k = [v0, 2, half]", "", "k = if i == 2 then v0 else if i == 3 then 2 else if i == 4 then 0.5 else 1"),
        ("robot.k = 3, robot[2..3].k = [v0, 4], robot[3].k = 8", "", "k = if i == 2 then v0 else if i == 3 then 8 else 3"),
        ("robot.up = [mod(i, 2) == 0 for i in 1..N]", "", "up = mod(i, 2) == 0"),
        ("", "robot.x = [i*v0 for i in 1..N];", "x0 = i*v0"),
        ("", "robot.x = twice; robot[N].x = k;", "x0 = if i == N then 9 else 2*v0"),
        ("", "robot[1..2].x = [8, v0];", "x0 = if i == 1 then 8 else if i == 2 then v0 else 1"),
        ("", "robot.p = [[i, v0] for i in 1..N];", "p1 = i, p2 = v0"),
        ("", "robot.p = [k, half];", "p1 = 9, p2 = 0.5"),
        ("", "robot[1..2].p = [[1, 2], [v0, 4]];", "p1 = if i == 2 then v0 else 1, p2 = if i <= 2 then 2*i else 0"),
        ("", "robot.p[2] = [i^2 for i in 1..N];", "p2 = i^2"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("v0", [2.0, 3.25])
def test_as_if_the_agent_said_so(given: str, init: str, argument: str, v0: float) -> None:
    """The values that an experiment gives are those that arguments made of the index give."""
    run = "experiment run of Top({}) [push := v0*time] {{ init {{ {} }} }}"
    inside = f"{FILE} agent Top(int N = 5, real v0 = 2, real T [s] = 3, real k = 9) {{{BODY.format(argument)}"
    same(
        compiled(TOP + run.format(given, init), "run", v0=v0),
        compiled(inside + run.format("", ""), "run", v0=v0),
    )


@pytest.mark.parametrize(
    ("given", "init"),
    [
        ("robot.link.T = [[10*i + j for j in 0..2] for i in 1..N]", ""),
        ("robot.link.T = [[10, 11, 12], [20, 21, 22], [30, 31, 32], [40, 41, 42], [50, 51, 52]]", ""),
        ("robot.link[0].T = [10*i for i in 1..N], robot.link[1..2].T = [[10*i + 1, 10*i + 2] for i in 1..N]", ""),
        ("", "robot.link.y = [[10*i + j for j in 0..2] for i in 1..N];"),
        ("", "robot[1..4].link.y = [[10*i + j for j in 0..2] for i in 1..4]; robot[5].link.y = [50, 51, 52];"),
    ],
)  # fmt: skip
def test_arrays_in_arrays(given: str, init: str) -> None:
    run = f"experiment run of Top({given}) [push := 0] {{ init {{ {init} }} }}"
    model = compiled(TOP + run, "run")
    expected = [10 * i + j for i in range(1, 6) for j in range(3)]
    if init:
        at = dict(zip(model.states, model.initial(), strict=True))
        assert [at[f"robot[{i}].link[{j}].y"] for i in range(1, 6) for j in range(3)] == expected
    else:
        assert np.ravel(model.parameters["robot.link.T"].value).tolist() == expected


def test_names_of_the_agent_come_first_but_not_where_its_own_parameters_are_given() -> None:
    text = TOP + "experiment run of Top(v0 = k) [push := k] { init { robot.x = k; robot[1].x = v0; } }"
    model = compiled(text, "run")
    at = dict(zip(model.states, model.initial(), strict=True))
    assert (at["robot[1].x"], at["robot[2].x"]) == (7, 9)
    assert model.rhs(0.0, np.zeros(len(model.states)))[model.states.index("robot[1].x")] == 9


def test_what_settings_and_paths_use_is_structural() -> None:
    text = (
        TOP
        + "experiment run of Top() [push := 0] { stop = 5*T; interval = half*T; group robot[N] { max_step = T; } record robot[N - 1..N].p; }"
    )
    model = model_of(text, experiment="run")
    assert [p.path for p in model.parameters if p.structural and "." not in p.path] == ["N", "T"]
    assert model.experiment.settings.stop == 15
    assert model.experiment.record == ("robot[4..5].p",)
    model = model_of(text, experiment="run", overrides={"N": 3, "T": 0.5})
    assert (model.experiment.settings.stop, model.experiment.settings.interval) == (2.5, 0.25)
    assert model.experiment.record == ("robot[2..3].p",)
    assert [settings.max_step for _, settings in model.experiment.groups] == [0.5]


@pytest.mark.parametrize(
    ("given", "items", "code"),
    [
        ("robot.k = [1, 2]", "", "E802"),
        ("robot.k = [i for i in 1..N + 1]", "", "E802"),
        ("robot[1..2].k = [1, 2, 3]", "", "E802"),
        ("robot.link.T = [[1, 2, 3]]", "", "E802"),
        ("robot.link.T = [i for i in 1..N]", "", "E302"),
        ("robot[2].k = [1]", "", "E302"),
        ("robot.n = [1, 2, 3, 4, 5]", "", "E807"),
        ("robot[1].n = 3", "", "E807"),  # though it is coupled as no other
        ("robot[9..10].k = [1, 2]", "", "E801"),
        ("v0 = T", "", "E201"),
        ("robot.k = push", "", "E209"),
        ("robot.k = half*time", "", "E209"),
        ("robot.k = T", "", "E401"),
        ("", "init { robot.x = [1, 2, 3]; }", "E802"),
        ("", "init { robot.x = wrong; }", "E201"),
        ("", "stop = robot.x;", "E209"),
        ("", "record robot[v0].x;", "E305"),
        ("", "record robot[N + 1].x;", "E801"),
    ],
)
def test_what_is_refused(given: str, items: str, code: str) -> None:
    text = f"{TOP} experiment run of Top({given}) [push := 0] {{ {items} }}"
    with pytest.raises(ModelError) as caught:
        model_of(text, experiment="run")
    assert {p.code for p in caught.value.problems if p.severity == "error"} == {code}


def test_a_large_array_is_given_values_by_one_expression() -> None:
    text = TOP + "experiment run of Top(N = 200000, robot.k = [i/N for i in 1..N]) [push := 0] { }"
    first, others = (p for p in model_of(text, experiment="run").parameters if p.path == "robot[].k")
    assert (first.count, others.count, len(others.values)) == (1, 199_999, 1)
