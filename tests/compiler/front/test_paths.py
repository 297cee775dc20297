"""What paths name, at any depth: parameters, states and their elements, groups, variables for results."""

from __future__ import annotations

import pytest
from helpers import model_of
from interpreter import Interpreter

from hierc.grammar.problems import ModelError

LAG = """
agent Lag(real T = 1) {
  read real u;
  write real y = 0;
  diff { y' = (u - y)/T; }
}
"""


def codes(text: str, **choice: object) -> list[str]:
    with pytest.raises(ModelError) as caught:
        model_of(text, **choice)
    return [problem.code for problem in caught.value.problems]


def test_children_see_what_their_parent_has() -> None:
    text = (
        LAG
        + """
    agent Parent(real k = 3) {
      read real r;
      const real c = 5;
      write real s = 7;
      private real a;
      let l = 11;
      alge { a = 13*s; }
      diff { s' = child.y; }
      agent child = Lag(T = k*c) [u := r + k + c + s + a + l + s' + time];
    }
    agent Top() { agent p = Parent() [r := 17]; }
    """
    )
    rates = Interpreter(model_of(text, experiment="Top")).rates(19.0, {"p.s": 2.0, "p.child.y": 23.0})
    assert rates == {"p.s": 23.0, "p.child.y": (17 + 3 + 5 + 2 + 13 * 2 + 11 + 23 + 19 - 23) / 15}


CHAIN = (
    LAG
    + """
agent A(real k = 1) { read real u; level la { agent lag = Lag(T = k) [u := u]; } private real q; alge { q = 2*lag.y; } }
agent B(real k0 = 2) { read real u; level lb { level lc { agent a = A(k = k0 + 1) [u := u]; } } }
agent C(real k1 = 3) { level ld { agent b = B(k0 = 2*k1) [u := 1]; } }
"""
)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("", 7.0),
        ("k1 = 5", 11.0),
        ("b.k0 = 5", 6.0),
        ("b.a.k = 5", 5.0),
        ("b.a.lag.T = 5", 5.0),
        ("k1 = 5, b.a.k = 4", 4.0),
    ],
)
def test_parameters_come_down(given: str, expected: float) -> None:
    model = model_of(f"{CHAIN} experiment e of C({given}) {{}}")
    rates = Interpreter(model).rates(0.0, {"b.a.lag.y": 0.0})
    assert rates["b.a.lag.y"] == pytest.approx(1 / expected, rel=1e-15)


def test_results_and_experiments_name_any_depth() -> None:
    model = model_of(
        f"{CHAIN} experiment e of C() {{ init {{ b.a.lag.y = 4; }} record b.a.q, b.*; group b.a {{ rtol = 1e-3; }} }}"
    )
    assert {v.path: v.access for v in model.variables} == {"b.a.q": "private", "b.a.lag.y": "write"}
    assert model.experiment.record == ("b.a.q", "b.a.lag.y")
    assert [name for name, _ in model.experiment.groups] == ["b.a.la"]


@pytest.mark.parametrize(
    ("item", "help_"),
    [
        ("record ld.b.lc.a.q;", "b.a.q"),
        ("record b.lb.a.lag.y;", "b.a.lag.y"),
        ("init { b.lc.a.lag.y = 1; }", "b.a.lag.y"),
        ("group b.lb.a.la { rtol = 1e-3; }", "b.a.la"),
    ],
)
def test_levels_are_no_part_of_paths(item: str, help_: str) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(f"{CHAIN} experiment e of C() {{ {item} record b.a.q; }}")
    (problem,) = caught.value.problems
    assert problem.help() == (f"did you mean `{help_}`? Levels are no part of a path",)


def test_levels_are_no_part_of_parameters() -> None:
    with pytest.raises(ModelError) as caught:
        model_of(CHAIN, experiment="C", overrides={"ld.b.lc.a.k": 2})
    assert caught.value.problems[0].help() == ("did you mean `b.a.k`? Levels are no part of a path",)


@pytest.mark.parametrize(
    ("item", "title"),
    [
        ("record b.lc.a.q;", "`record b.lc.a.q` matches nothing"),
        ("record b.a.q[1];", "`b.a.q` is `real` and takes no index"),
        ("record b.a.u.*;", "`record b.a.u.*` matches nothing"),
        ("init { b.a.q = 1; }", "there is no state `b.a.q`"),
        ("init { b.c.lag.y = 1; }", "there is no agent `c`"),
        ("group b.lc.a { rtol = 1e-3; }", "there is no group `b.lc.a`"),
        ("group b.q { rtol = 1e-3; }", "there is no group `b.q`"),
    ],
)
def test_paths_that_name_nothing(item: str, title: str) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(f"{CHAIN} experiment e of C() {{ {item} record b.a.q; }}")
    (problem,) = caught.value.problems
    assert title in problem.title()


VECTORS = """
agent Arm() {
  write real[3] q = [1, 2, 3];
  private real[2,2] M = [[1, 2], [3, 4]];
  diff { q' = -q; M' = -M; }
}
agent Robot() { level body { agent arm = Arm(); } }
"""


@pytest.mark.parametrize(
    ("init", "q", "matrix"),
    [
        ("", [1, 2, 3], [1, 2, 3, 4]),
        ("arm.q[2] = 9;", [1, 9, 3], [1, 2, 3, 4]),
        ("arm.q[2..3] = [8, 9]; arm.q[1] = 7;", [7, 8, 9], [1, 2, 3, 4]),
        ("arm.M[2,1] = 9; arm.M[1,1..2] = [7, 8];", [1, 2, 3], [7, 8, 9, 4]),
        ("arm.M[1..2,2] = [7, 8];", [1, 2, 3], [1, 7, 3, 8]),
        ("arm.q = [4, 5, 6];", [4, 5, 6], [1, 2, 3, 4]),
    ],
)
def test_initial_values_of_elements(init: str, q: list[float], matrix: list[float]) -> None:
    initial = Interpreter(model_of(f"{VECTORS} experiment e of Robot() {{ init {{ {init} }} }}")).start()
    assert [initial[f"arm.q[{i}]"] for i in (1, 2, 3)] == q
    assert [initial[f"arm.M[{i},{j}]"] for i in (1, 2) for j in (1, 2)] == matrix


@pytest.mark.parametrize(
    ("init", "code"),
    [
        ("arm.q[4] = 1;", "E303"),
        ("arm.q[1,1] = 1;", "E307"),
        ("arm.q[1..2] = 1;", "E302"),
        ("arm.q[1] = 1; arm.q[1..2] = [1, 2];", "E214"),
        ("arm.q[1] = 1; arm.q = [1, 2, 3];", "E214"),
        ("arm[1].q = [1, 2, 3];", "E806"),
        ("arm.q[x] = 1;", "E201"),
    ],
)
def test_initial_values_of_elements_that_are_wrong(init: str, code: str) -> None:
    assert codes(f"{VECTORS} experiment e of Robot() {{ init {{ {init} }} }}") == [code]


def test_elements_are_recorded() -> None:
    text = f"{VECTORS} const int n = 2; experiment e of Robot() {{ record arm.q[n], arm.M[1, 1..2], arm.q[3..3]; }}"
    assert model_of(text).experiment.record == ("arm.q[2]", "arm.M[1,1]", "arm.M[1,2]", "arm.q[3]")
    assert codes(text.replace("arm.q[n]", "arm.q[n + 2]")) == ["E303"]
