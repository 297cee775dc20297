"""Hierarchies of any depth: random ones against a search of all ways, and each rule by hand."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from helpers import groups, model_of, node, reads
from interpreter import Interpreter

from hierc.compiler.model import Model
from hierc.grammar.problems import ModelError

LAG = """
agent Lag(real T = 1) {
  read real u;
  write real y = 0;
  diff { y' = (u - y)/T; }
}
"""

# ---- random worlds ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Member:
    """A sub-agent in a level of its agent, given as the path of levels from the outside; it reads the sum of `sources`."""

    name: str
    kind: str
    level: tuple[str, ...]
    sources: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """An agent: its members, and what its observer `out` is the sum of. `levels`: every level, each after the one around it."""

    levels: tuple[tuple[str, ...], ...]
    members: tuple[Member, ...]
    out: tuple[str, ...]

    def divided(self, level: tuple[str, ...]) -> bool:
        return any(inner[:-1] == level for inner in self.levels)

    def text(self, name: str) -> str:
        return f"agent {name}() {{ read real u; write real out; alge {{ out = {sum_of(self.out)}; }} {self.inside(())} }}"

    def inside(self, level: tuple[str, ...]) -> str:
        members = (
            f"agent {m.name} = {m.kind}() [u := {sum_of(m.sources)}];"
            for m in self.members
            if m.level == level
        )
        inner = (
            f"level {path[-1]} {{ {self.inside(path)} }}"
            for path in self.levels
            if path and path[:-1] == level
        )
        return " ".join([*members, *inner])


def sum_of(names: tuple[str, ...]) -> str:
    return " + ".join(names) or "0"


@dataclass(frozen=True)
class State:
    """A lag of the model: by its path, with the levels around it from the outside, as (agent or level with levels, which of its levels)."""

    path: str
    levels: tuple[tuple[tuple[str, ...], int], ...]
    reads: frozenset[str]


def random_plan(pick: random.Random, kinds: list[str], *, flat: bool = False) -> Plan:
    """Two or three levels, some of which have levels, and one or two members in each innermost one."""
    levels: list[tuple[str, ...]] = []

    def divide(around: tuple[str, ...], depth: int) -> Iterator[tuple[str, ...]]:
        for index in range(pick.choice((2, 2, 3)) if depth == 0 else 2):
            here = (*around, f"{around[-1] if around else 'l'}{index}")
            levels.append(here)
            yield from divide(here, depth + 1) if depth < 2 and pick.random() < 0.4 else (here,)

    places = [()] if flat else list(divide((), 0))
    named = [
        (f"m{i}", place) for i, place in enumerate(p for p in places for _ in range(pick.choice((1, 2, 3))))
    ]
    chosen = [(name, place, pick.choice(kinds)) for name, place in named]
    outputs = {name: f"{name}.{'y' if kind == 'Lag' else 'out'}" for name, _, kind in chosen}

    def sources(reader: int) -> tuple[str, ...]:
        """Mostly of earlier members, so that many worlds are in order."""
        before = [outputs[name] for name, _, _ in chosen[:reader]] + ["u"]
        anywhere = [source for name, source in outputs.items() if name != chosen[reader][0]]
        return tuple(
            pick.choice(anywhere if anywhere and pick.random() < 0.04 else before)
            for _ in range(pick.choice((1, 2)))
        )

    members = tuple(Member(name, kind, place, sources(i)) for i, (name, place, kind) in enumerate(chosen))
    return Plan(tuple(levels), members, tuple(pick.choices(list(outputs.values()), k=pick.choice((1, 2)))))


def random_world(seed: int) -> dict[str, Plan]:
    pick = random.Random(seed)
    arm = random_plan(pick, ["Lag"])
    pair = random_plan(pick, ["Lag"], flat=True)
    robot = random_plan(pick, ["Lag", "Lag", "Arm", "Pair"])
    return {
        "Arm": arm,
        "Pair": pair,
        "Robot": robot,
        "World": random_plan(pick, ["Lag", "Robot", "Arm", "Pair"]),
    }


def states_of(plans: dict[str, Plan]) -> dict[str, State]:
    """Every lag of the world."""
    found: dict[str, State] = {}

    def behind(source: str, plan: Plan, path: str, given: frozenset[str]) -> frozenset[str]:
        """The lags that a name in an agent stands for."""
        if source == "u":
            return given
        name, variable = source.split(".")
        if variable == "y":
            return frozenset({path + name})
        (member,) = (m for m in plan.members if m.name == name)
        inner = plans[member.kind]
        return frozenset().union(*(behind(s, inner, f"{path}{name}.", frozenset()) for s in inner.out))

    def enter(
        plan: Plan, path: str, given: frozenset[str], around: tuple[tuple[tuple[str, ...], int], ...]
    ) -> None:
        for member in plan.members:
            levels = list(around)
            for depth in range(1, len(member.level) + 1):
                outer, here = member.level[: depth - 1], member.level[:depth]
                beside = [level for level in plan.levels if level[:-1] == outer]
                levels.append(((path, *outer), beside.index(here)))
            read = frozenset().union(*(behind(s, plan, path, given) for s in member.sources))
            name = path + member.name
            if member.kind == "Lag":
                found[name] = State(name, tuple(levels), read)
            else:
                enter(plans[member.kind], f"{name}.", read, tuple(levels))

    enter(plans["World"], "", frozenset(), ())
    return found


def reached(states: dict[str, State]) -> dict[str, set[str]]:
    """For each lag all that it depends on."""
    found = {}
    for name in states:
        seen: set[str] = set()
        waiting = [name]
        while waiting:
            new = states[waiting.pop()].reads - seen
            seen |= new
            waiting += new
        found[name] = seen
    return found


def breaks_order(states: dict[str, State]) -> bool:
    """Whether a level depends on a later one beside it, by any way."""
    for name, others in reached(states).items():
        here = dict(states[name].levels)
        for other in others:
            if any(block in here and here[block] < index for block, index in states[other].levels):
                return True
    return False


def groups_of(states: dict[str, State]) -> dict[tuple[object, ...], set[str]]:
    """The lags of each innermost level."""
    found: dict[tuple[object, ...], set[str]] = {}
    for state in states.values():
        found.setdefault(state.levels, set()).add(state.path)
    return found


def closes_circle(states: dict[str, State]) -> bool:
    """Whether groups depend on each other."""
    edges = {
        (states[r].levels, s.levels) for s in states.values() for r in s.reads if states[r].levels != s.levels
    }
    left = {s.levels for s in states.values()}
    while True:
        ready = {g for g in left if not any(b == g and a in left for a, b in edges)}
        if not ready:
            return bool(left)
        left -= ready


def outcome(text: str) -> tuple[list[str], Model | None]:
    try:
        model = model_of(text, experiment="World")
    except ModelError as error:
        return [problem.code for problem in error.problems], None
    return [], model


def text_of(plans: dict[str, Plan]) -> str:
    unbound = "experiment World of Top() {} agent Top() { agent w = World() [u := 0]; }"
    return LAG + " ".join(plan.text(name) for name, plan in plans.items()) + unbound


def expected_codes(states: dict[str, State]) -> set[str]:
    if breaks_order(states):
        return {"E601"}
    return {"E603"} if closes_circle(states) else set()


@pytest.mark.parametrize("seed", range(150))
def test_random_worlds(seed: int) -> None:
    plans = random_world(seed)
    states = states_of(plans)
    codes, model = outcome(text_of(plans))
    assert set(codes) == expected_codes(states)
    if model is None:
        return
    made = {frozenset(path.removeprefix("w.") for path in paths) for paths in groups(model).values()}
    assert made == {frozenset(names) for names in groups_of(states).values()}
    place = {path.removeprefix("w."): i for i, paths in enumerate(groups(model).values()) for path in paths}
    assert all(place[read] <= place[name] for name, state in states.items() for read in state.reads)


def test_the_worlds_are_of_all_kinds() -> None:
    kinds = [frozenset(expected_codes(states_of(random_world(seed)))) for seed in range(150)]
    assert kinds.count(frozenset()) >= 20
    assert kinds.count(frozenset({"E601"})) >= 20
    assert kinds.count(frozenset({"E603"})) >= 5


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
        "left.f": 0.5,
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


# ---- hiding, parameters, experiments ------------------------------------------------------------------------------------------------


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
    ("item", "title"),
    [
        ("record b.lc.a.q;", "`record b.lc.a.q` matches nothing"),
        ("record b.a.q[1];", "`b.a.q` is `real` and takes no index"),
        ("record b.a.u.*;", "`record b.a.u.*` matches nothing"),
        ("init { b.a.q = 1; }", "there is no state `b.a.q`"),
        ("init { b.c.lag.y = 1; }", "there is no agent `c`"),
        ("group b.lc.a { rtol = 1e-3; }", "there is no group `b.lc.a`"),
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
        ("arm[1].q = [1, 2, 3];", "E910"),
        ("arm.q[x] = 1;", "E201"),
    ],
)
def test_initial_values_of_elements_that_are_wrong(init: str, code: str) -> None:
    assert codes(f"{VECTORS} experiment e of Robot() {{ init {{ {init} }} }}") == [code]


def test_elements_are_recorded() -> None:
    text = f"{VECTORS} const int n = 2; experiment e of Robot() {{ record arm.q[n], arm.M[1, 1..2], arm.q[3..3]; }}"
    assert model_of(text).experiment.record == ("arm.q[2]", "arm.M[1,1]", "arm.M[1,2]", "arm.q[3]")
    assert codes(text.replace("arm.q[n]", "arm.q[n + 2]")) == ["E303"]


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
