"""Instances, couplings, levels, groups and their order."""

from __future__ import annotations

import pytest
from helpers import form, groups, model_of, node, reads
from interpreter import Interpreter

from hierc.compiler.model import Source
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
    return [p.code for p in caught.value.problems]


def test_couplings_are_substituted_through_all_levels() -> None:
    model = model_of(
        LAG
        + """
        agent Inner() { read real a; agent lag = Lag() [u := 2*a]; write real out; alge { out = lag.y; } }
        agent Outer() { read real b; agent inner = Inner() [a := b + 1]; write real out; alge { out = inner.out; } }
        agent Top() {
          write real s = 3;
          agent outer = Outer() [b := s];
          agent last  = Lag(T = 0.5) [u := outer.out];
          diff { s' = last.y; }
        }
        """
    )
    assert reads(model, "outer.inner.lag") == ["s"]
    assert reads(model, "last") == ["outer.out"]
    assert {v.path for v in model.variables} >= {
        "outer.b",
        "outer.inner.a",
        "outer.inner.lag.y",
        "last.u",
    } - {"outer.inner.a"}
    values = {"s": 3.0, "outer.inner.lag.y": 0.25, "last.y": 1.0}
    assert Interpreter(model).rates(0, values) == {
        "s": 1.0,
        "outer.inner.lag.y": 2 * (3 + 1) - 0.25,
        "last.y": 2 * (0.25 - 1),
    }


def test_an_unused_read_makes_no_dependence() -> None:
    model = model_of(
        LAG
        + """
        agent Deaf() { read real u; write real y = 0; diff { y' = 1; } }
        agent Top() {
          level slow { agent a = Deaf() [u := b.y]; }
          level fast { agent b = Lag() [u := a.y]; }
        }
        """
    )
    assert reads(model, "a") == []
    assert groups(model) == {"slow": ["a"], "fast": ["b"]}


def test_an_initial_value_makes_no_dependence() -> None:
    model = model_of(
        """
        agent Starter() { read real u; write real y = u + 1; diff { y' = 1; } }
        agent Source() { write real y = 4; diff { y' = 1; } }
        agent Top() {
          level slow { agent a = Starter() [u := 2*b.y]; }
          level fast { agent b = Source(); }
        }
        """
    )
    assert reads(model, "a") == ["b.y"]
    assert Interpreter(model).start() == {"a.y": 9.0, "b.y": 4.0}


def test_conditions_on_constants_decide_dependence() -> None:
    text = (
        LAG
        + """
        agent Top(int n = %d) {
          level slow { agent a = Lag() [u := if n == 1 then 0 else b.y]; }
          level fast { agent b = Lag() [u := a.y]; }
        }
        """
    )
    model = model_of(text % 1)
    assert reads(model, "a") == []
    assert [(p.path, p.structural) for p in model.parameters] == [("n", True), ("a.T", False), ("b.T", False)]
    assert codes(text % 2) == ["E601"]
    assert codes(text % 1, overrides={"n": 2}) == ["E601"]


def test_a_flag_in_an_equation_stays_a_parameter() -> None:
    model = model_of("agent A(bool on = true) { write real x = 0; diff { x' = if on then 1 else 2; } }")
    assert not model.parameters[0].structural
    assert Interpreter(model).rates(0, {"x": 0.0}) == {"x": 1.0}
    assert Interpreter(model, {"on": 0.0}).rates(0, {"x": 0.0}) == {"x": 2.0}


def test_the_chosen_branch_alone_is_evaluated() -> None:
    model = model_of(
        "agent A(int n = 1) { write real[2] x = [0, 0]; diff { for i in 1..2 { x[i]' = if i == 1 then 5 else x[i - 1]; } } }"
    )
    assert Interpreter(model).rates(0, {"x[1]": 7.0, "x[2]": 0.0}) == {"x[1]": 5.0, "x[2]": 7.0}


def test_observers_stand_last_and_are_substituted() -> None:
    model = model_of(
        LAG
        + """
        agent Arm() {
          write real gap;
          level slow { agent a = Lag() [u := time]; }
          level fast { agent b = Lag() [u := a.y]; }
          alge { gap = a.y - b.y; }
        }
        agent Top() { agent arm = Arm(); agent after = Lag() [u := arm.gap]; }
        """
    )
    assert [n.path for n in model.nodes] == ["arm.a", "arm.b", "arm", "after"]
    assert groups(model) == {"arm.slow": ["arm.a"], "arm.fast": ["arm.b"], "after": ["after"]}
    assert reads(model, "after") == ["arm.a.y", "arm.b.y"]
    interpreter = Interpreter(model)
    interpreter.set(0, {"arm.a.y": 5.0, "arm.b.y": 2.0, "after.y": 0.0})
    assert interpreter.variable("arm.gap") == [3.0]


def test_robots_side_by_side_need_only_be_acyclic() -> None:
    model = model_of(
        LAG
        + """
        agent Robot() {
          read real goal;
          level plan  { agent plan = Lag() [u := goal]; }
          level motor { agent mot = Lag(T = 0.01) [u := plan.y]; }
          write real speed;
          alge { speed = mot.y; }
        }
        agent Team() {
          agent second = Robot() [goal := first.speed];
          agent first  = Robot() [goal := time];
        }
        """
    )
    assert list(groups(model)) == ["first.plan", "first.motor", "second.plan", "second.motor"]
    assert reads(model, "second.plan") == ["first.mot.y"]


def test_equal_instances_are_equal_nodes() -> None:
    model = model_of(
        LAG
        + """
        agent Top(real k = 2) {
          let twice = k*first.y;
          agent first = Lag(T = 3) [u := time];
          agent a = Lag(T = 4) [u := twice + 1];
          agent b = Lag(T = 5) [u := twice + 1];
          agent c = Lag(T = 5) [u := twice + 2];
        }
        """
    )
    assert form(node(model, "a")) == form(node(model, "b")) != form(node(model, "c"))
    assert node(model, "a").parameters != node(model, "b").parameters


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("", {"c": ["c"], "a+b": ["a", "b"], "d": ["d"]}),
        ("group slow = c, a, b;", {"slow": ["c", "a", "b"], "d": ["d"]}),
        ("group fast = a, b, d;", {"c": ["c"], "fast": ["a", "b", "d"]}),
    ],
)
def test_groups_without_levels(statement: str, expected: dict[str, list[str]]) -> None:
    model = model_of(
        LAG
        + f"""
        agent Top() {{
          agent d = Lag() [u := a.y];
          agent a = Lag() [u := b.y + c.y];
          agent b = Lag() [u := a.y];
          agent c = Lag() [u := time];
          {statement}
        }}
        """
    )
    assert groups(model) == expected


def test_a_level_is_split_by_group() -> None:
    model = model_of(
        LAG
        + """
        agent Pair() { agent x = Lag() [u := 1]; agent y = Lag() [u := 2]; }
        agent Top() {
          level slow { agent a = Lag() [u := time]; }
          level fast { agent b = Lag() [u := a.y]; agent pair = Pair(); agent e = Lag() [u := pair_y]; }
          let pair_y = b.y;
          group own = pair.*;
        }
        """
    )
    assert groups(model) == {"slow": ["a"], "fast": ["b", "e"], "own": ["pair.x", "pair.y"]}


def test_levels_inside_levels_are_groups() -> None:
    model = model_of(
        LAG
        + """
        agent Arm() {
          read real r;
          level body  { agent body = Lag() [u := r]; }
          level motor { agent motor = Lag() [u := body.y]; }
        }
        agent Top() {
          level base { agent base = Lag() [u := time]; }
          level arms { agent left = Arm() [r := base.y]; agent right = Arm() [r := base.y]; agent fan = Lag() [u := base.y]; }
        }
        """
    )
    assert set(groups(model)) == {"base", "left.body", "left.motor", "right.body", "right.motor", "arms"}
    assert groups(model)["arms"] == ["fan"]


def test_agents_without_states_belong_to_no_group() -> None:
    model = model_of(
        LAG
        + """
        agent Mixer() { read real p, q; write real o1, o2; alge { o1 = 2*p; o2 = 3*q; } }
        agent Top() {
          agent mixer = Mixer() [p := a.y, q := b.y];
          agent a = Lag() [u := 1];
          agent b = Lag() [u := mixer.o1];
          agent c = Lag() [u := mixer.o2];
        }
        """
    )
    assert list(groups(model)) == ["a", "b", "c"]
    assert node(model, "b").inputs == (Source(node(model, "mixer").id, "local", 0),)
    values = {"a.y": 1.0, "b.y": 2.0, "c.y": 0.0}
    assert Interpreter(model).rates(0, values) == {"a.y": 0.0, "b.y": 0.0, "c.y": 6.0}


def test_a_cascade_broken_two_levels_up_is_found() -> None:
    assert codes(
        LAG
        + """
        agent Inner() { read real r; agent lag = Lag() [u := r]; }
        agent Top() {
          level slow { agent a = Inner() [r := b.y]; }
          level fast { agent b = Lag() [u := 1]; }
        }
        """
    ) == ["E601"]


def test_a_derivative_of_a_vector_couples() -> None:
    model = model_of(
        """
        agent Path() { write real[2] p = [1, 2]; diff { p' = [p[2], -p[1]]; } }
        agent Follow() { read real[2] v; write real x = 0; diff { x' = v[1]*v[2]; } }
        agent Top() { agent path = Path(); agent follow = Follow() [v := path.p']; }
        """
    )
    assert reads(model, "follow") == ["path.p[1]'", "path.p[2]'"]
    assert [v.path for v in model.variables] == ["path.p", "follow.x"]
    rates = Interpreter(model).rates(0, {"path.p[1]": 3.0, "path.p[2]": 4.0, "follow.x": 0.0})
    assert rates["follow.x"] == 4.0 * -3.0


def test_order_does_not_depend_on_the_order_of_declarations() -> None:
    agents = [f"agent a{i} = Lag() [u := {'time' if i == 0 else f'a{i - 1}.y'}];" for i in range(6)]
    there = model_of(LAG + f"agent Top() {{ {' '.join(agents)} }}")
    back = model_of(LAG + f"agent Top() {{ {' '.join(reversed(agents))} }}")
    assert [n.path for n in there.nodes] == [n.path for n in back.nodes] == [f"a{i}" for i in range(6)]
