"""Levels, groups, hiding and paths at any depth: each rule by hand, with what breaks it."""

from __future__ import annotations

import pytest
from helpers import groups, model_of, node, reads
from interpreter import Interpreter

from hierc.grammar.problems import ModelError

LAG = """
agent Lag(real T = 1) {
  read real u;
  write real y = 0;
  diff { y' = (u - y)/T; }
}
"""

# ---- levels -----------------------------------------------------------------------------------------------------------------------

NESTED = (
    LAG
    + """
agent Drive(real T = 0.1) {
  read real u;
  level current {
    level coil { agent coil = Lag(T = T) [u := u]; }
    level flux { write real f = 0.5; private real g; diff { f' = coil.y - f; } alge { g = 2*f; } }
    write real ripple;
    alge { ripple = coil.y - f; }
  }
  level sensor { agent sensor = Lag(T = T/10) [u := g]; }
  write real y;
  alge { y = sensor.y + ripple; }
}
agent Machine(real T0 = 0.2) {
  level gross { agent wish = Lag() [u := 1]; }
  level fine {
    level drives { agent left = Drive(T = T0) [u := wish.y]; agent other = Lag() [u := left.ripple]; }
    level grip { agent hand = Lag(T = T0/100) [u := left.y + other.y]; }
  }
}
"""
)


def codes(text: str, **choice: object) -> list[str]:
    with pytest.raises(ModelError) as caught:
        model_of(text, **choice)
    return [problem.code for problem in caught.value.problems]


def test_levels_in_levels_are_groups_in_the_order_of_the_text() -> None:
    model = model_of(NESTED)
    assert groups(model) == {
        "gross": ["wish"],
        "left.coil": ["left.coil"],
        "left.flux": ["left.flux"],
        "drives": ["other"],
        "left.sensor": ["left.sensor"],
        "grip": ["hand"],
    }
    assert node(model, "left.flux").levels == ("fine", "drives", "left.current", "left.flux")
    assert node(model, "hand").levels == ("fine", "grip")


def test_observers_are_computed_by_whoever_reads_them() -> None:
    """`ripple` stands in a level with levels, `y` in an agent: both depend on what they are made of, and are in no group."""
    model = model_of(NESTED)
    assert reads(model, "other") == ["left.coil.y", "left.flux.f"]
    assert set(reads(model, "hand")) == {"left.sensor.y", "left.coil.y", "left.flux.f", "other.y"}
    values = {
        "wish.y": 1.0,
        "left.coil.y": 3.0,
        "left.flux.f": 0.5,
        "other.y": 4.0,
        "left.sensor.y": 7.0,
        "hand.y": 0.0,
    }
    rates = Interpreter(model).rates(0, values)
    assert rates["other.y"] == 3.0 - 0.5 - 4.0
    assert rates["hand.y"] == pytest.approx((7.0 + 3.0 - 0.5 + 4.0) / 0.002, rel=1e-14)
    assert rates["left.sensor.y"] == pytest.approx((2 * 0.5 - 7.0) / 0.02, rel=1e-14)
    assert rates["left.coil.y"] == pytest.approx((1.0 - 3.0) / 0.2, rel=1e-14)


@pytest.mark.parametrize(
    ("first", "code"),
    [("arm.slow", None), ("arm.fast", "E601"), ("arm.both", "E601"), ("arm.unused", "E601")],
)
def test_what_an_observer_reads_counts_for_its_reader(first: str, code: str | None) -> None:
    """`Arm` is split by levels of the agent around it; `unused` is of a later level even though it multiplies by nothing known when compiling."""
    text = (
        LAG
        + f"""
    agent Arm(real k = 0) {{
      level one {{
        level slow {{ agent a = Lag() [u := 1]; }}
        level middle {{ agent b = Lag() [u := seen]; }}
        write real seen;
        alge {{ seen = {first.removeprefix("arm.")}; }}
      }}
      level two {{ agent c = Lag() [u := b.y]; }}
      write real slow, fast, both, unused;
      alge {{ slow = a.y; fast = c.y; both = a.y + c.y; unused = k*c.y; }}
    }}
    """
    )
    if code is None:
        assert reads(model_of(text, experiment="Arm"), "b") == ["a.y"]
    else:
        assert set(codes(text, experiment="Arm")) == {code}


def test_an_observer_of_a_level_reads_no_later_one() -> None:
    text = (
        LAG
        + """
    agent A() {
      level one { level in { agent a = Lag() [u := 0]; } write real seen; alge { seen = a.y + SOURCE; } }
      level two { agent b = Lag() [u := a.y]; }
      write real all;
      alge { all = seen + b.y; }
    }
    """.replace("level in ", "level inner ")
    )
    assert codes(text.replace("SOURCE", "b.y")) == ["E601"]
    assert reads(model_of(text.replace("SOURCE", "1")), "") == ["a.y", "b.y"]


def test_names_of_levels_are_one_space_for_all_depths() -> None:
    text = (
        LAG
        + "agent A() { level a { level b { agent x = Lag() [u := 0]; } } level b { agent y = Lag() [u := 0]; } }"
    )
    assert codes(text) == ["E202"]
    model_of(text.replace("level b { agent y", "level c { agent y"))


def test_a_level_and_an_agent_may_have_one_name() -> None:
    text = (
        LAG
        + "agent A() { level a { level b { agent a = Lag() [u := 0]; } level c { agent b = Lag() [u := a.y]; } } }"
    )
    assert groups(model_of(text)) == {"b": ["a"], "c": ["b"]}


def test_a_variable_is_declared_and_defined_in_one_level() -> None:
    text = "agent A() { level a { level b { write real x = 0; } level c { diff { x' = 1; } write real y = 0; diff { y' = x; } } } }"
    assert codes(text) == ["E607"]
    model_of(
        text.replace("write real x = 0;", "write real x = 0; diff { x' = 1; }").replace(
            "level c { diff { x' = 1; }", "level c {"
        )
    )


@pytest.mark.parametrize(
    ("item", "code"),
    [
        ("write real x = 0; diff { x' = 1; }", "E605"),
        ("agent l = Lag() [u := 0];", "E605"),
        ("write real x; alge { x = a.y; }", None),
        ("private real x; alge { x = a.y + b.y; }", None),
        ("let x = 1;", None),
    ],
)
@pytest.mark.parametrize("depth", [0, 1, 2])
def test_only_observers_stand_beside_levels(item: str, code: str | None, depth: int) -> None:
    inner = f"level la {{ agent a = Lag() [u := 0]; }} level lb {{ agent b = Lag() [u := a.y]; }} {item}"
    for number in range(depth):
        inner = f"level around{number} {{ {inner} }}"
    text = f"{LAG} agent Lone() {{ {inner} }}"
    if code is None:
        model_of(text)
    else:
        assert set(codes(text)) == {code}


def test_a_level_without_states_is_named_once() -> None:
    text = (
        LAG
        + """
    agent Gain() { read real u; level inner { write real y; alge { y = 2*u; } } }
    agent A() {
      level a { agent x = Lag() [u := 0]; }
      level b { level c { agent g = Gain() [u := x.y]; } level d { write real z; alge { z = g.y; } } }
      level e { agent w = Lag() [u := z]; }
    }
    """
    )
    warnings = [w.title() for w in model_of(text, experiment="A").warnings if w.code == "W611"]
    assert warnings == ["level `b` has no states; it will be merged with `e`"]


# ---- groups -----------------------------------------------------------------------------------------------------------------------

SPLIT = (
    LAG
    + """
agent Two() { read real u; agent a = Lag() [u := u]; agent b = Lag() [u := a.y]; write real y; alge { y = b.y; } }
agent Arm() { read real u; level one { agent a = Lag() [u := u]; } level two { agent b = Lag() [u := a.y]; } }
agent Model() {
  level outer {
    level first { agent p = Lag() [u := 0]; agent q = Two() [u := p.y]; agent r = Lag() [u := 0]; GROUP }
    level second { agent s = Lag() [u := q.y]; agent arm = Arm() [u := s.y]; }
  }
}
"""
)


@pytest.mark.parametrize(
    ("group", "expected"),
    [
        ("", {"first": {"p", "q.a", "q.b", "r"}}),
        ("group g = p;", {"g": {"p"}, "first": {"q.a", "q.b", "r"}}),
        ("group g = p, q;", {"g": {"p", "q.a", "q.b"}, "first": {"r"}}),
        ("group g = p, q.*;", {"g": {"p", "q.a", "q.b"}, "first": {"r"}}),
        ("group g = q.a; group h = q.b, r;", {"g": {"q.a"}, "h": {"q.b", "r"}, "first": {"p"}}),
        ("group first = p, q, r;", {"first": {"p", "q.a", "q.b", "r"}}),
    ],
)
def test_groups_in_inner_levels(group: str, expected: dict[str, set[str]]) -> None:
    found = {
        name: set(paths)
        for name, paths in groups(model_of(SPLIT.replace("GROUP", group), experiment="Model")).items()
    }
    assert found == expected | {"second": {"s"}, "arm.one": {"arm.a"}, "arm.two": {"arm.b"}}


@pytest.mark.parametrize(
    ("group", "code", "title"),
    [
        ("group g = p, s;", "E609", "its members stand in different levels"),
        ("group g = arm;", "E609", "it has levels, which are groups already"),
        ("group g = arm.a, s;", "E609", "its members stand in different levels"),
        ("group g = second;", "E609", "`second` is a level, not an agent"),
        ("group g = q.c;", "E609", "`c` is no agent here"),
        ("group g = p; group h = p;", "E604", "`p` is in two groups, `g` and `h`"),
        ("group g = q; group h = q.*;", "E604", "`q.a` is in two groups, `g` and `h`"),
        ("group first = p;", "E602", "`first` is the name of another group too"),
        ("group g = p, q.b;", "E603", "depend on each other"),
    ],
)
def test_what_a_group_cannot_hold(group: str, code: str, title: str) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(SPLIT.replace("GROUP", group), experiment="Model")
    assert caught.value.problems[0].code == code
    assert title in caught.value.problems[0].title()


def test_members_deep_inside_may_be_of_one_level_there() -> None:
    """Of an agent with levels, agents of one of these may be split off from outside."""
    text = SPLIT.replace(
        "agent b = Lag() [u := a.y]; }\n", "agent b = Lag() [u := a.y]; agent c = Lag() [u := b.y]; }\n", 1
    )
    text = text.replace("GROUP", "").replace(
        "level two { agent b", "level two { agent c = Lag() [u := b.y]; agent b"
    )
    text = text.replace(
        "agent arm = Arm() [u := s.y]; }", "agent arm = Arm() [u := s.y]; group tip = arm.c; }"
    )
    assert {name: set(paths) for name, paths in groups(model_of(text, experiment="Model")).items() if name in ("tip", "arm.two")} == {
        "tip": {"arm.c"}, "arm.two": {"arm.b"},
    }  # fmt: skip


def test_without_levels_groups_are_circles_at_any_depth() -> None:
    text = (
        LAG
        + """
    agent Loop() { read real u; agent a = Lag() [u := b.y + u]; agent b = Lag() [u := a.y]; write real y; alge { y = b.y; } }
    agent Around() { read real u; agent in = Loop() [u := u]; agent out = Lag() [u := in.y]; write real y; alge { y = out.y; } }
    agent Top() { agent x = Around() [u := 0]; agent z = Around() [u := x.y + w.y]; agent w = Lag() [u := z.y]; }
    """.replace("agent in ", "agent inner ").replace("in.y", "inner.y")
    )
    assert groups(model_of(text, experiment="Top")) == {
        "x.inner.a+x.inner.b": ["x.inner.a", "x.inner.b"],
        "x.out": ["x.out"],
        "z.inner.a+z.inner.b+z.out+w": ["z.inner.a", "z.inner.b", "z.out", "w"],
    }


# ---- size ------------------------------------------------------------------------------------------------------------------------


def test_deep_nesting() -> None:
    """Sixty levels in one agent, and thirty agents each with two levels of levels."""
    opened = "".join(f"level l{i} {{ " for i in range(60))
    model = model_of(f"agent A() {{ {opened} write real x = 1; diff {{ x' = -x; }} {'}' * 60} }}")
    assert len(model.nodes[0].levels) == 60
    chain = " ".join(
        f"agent A{i}() {{ level a {{ level b {{ agent x = A{i + 1}(); }} }} }}" for i in range(31)
    )
    deep = f"{chain} agent A31() {{ write real x = 1; diff {{ x' = -x; }} }}"
    assert len(model_of(deep, experiment="A0").nodes[0].levels) == 62
    deeper = deep.replace(
        "agent A31()", "agent A31() { level a { level b { level c { agent x = A32(); } } } } agent A32()"
    )
    assert codes(deeper, experiment="A0") == ["E216"]
