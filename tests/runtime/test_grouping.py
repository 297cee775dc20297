"""The same model in other groups: the equations stay, results agree within the tolerance, names and settings follow."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from array_models import a_model, chain, platoon, robots
from fan_models import fan
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import hierc
from hierc.runtime import partitions
from hierc.runtime.elements import Elements
from hierc.runtime.errors import SettingError
from hierc.runtime.grouping import CLEARLY, Neighbours, _Arrays, decision, partition
from hierc.runtime.model import Model
from hierc.runtime.result import SimulationError
from hierc.runtime.system import System

Integers = NDArray[np.int64]

#: A cascade of three levels, two agents in the last one, of which one reads what the other computes.
LEVELS = """
agent Slow() { write real x = 1; diff { x' = -0.3*x + sin(1 [rad/s]*time); } }
agent Quick(real w) {
  read real goal;
  write real y = 0, f;
  alge { f = w*(goal - y); }
  diff { y' = f; }
}
agent Both() {
  level one { agent a = Slow(); }
  level two { agent b = Quick(w = 2) [goal := a.x]; }
  level three {
    agent c = Quick(w = 30) [goal := b.y + 0.1*b.f];
    agent d = Quick(w = 40) [goal := c.y + 0.1*c.f];
  }
}
experiment run of Both() { stop = 4 [s]; rtol = 1e-8; %s }
"""


@pytest.fixture(scope="module")
def levels() -> Model:
    return hierc.load(LEVELS % "")


def contiguous(elements: Elements) -> Iterator[Integers]:
    """The partitions that join neighbours in the cascade."""
    for cuts in itertools.product((0, 1), repeat=elements.groups - 1):
        labels = np.array([0, *itertools.accumulate(cuts)], np.int64)
        yield np.where(elements.home >= 0, labels[elements.home], -1)


def names(model: Model, elements: Elements) -> list[str]:
    return [elements.group_name(g) for g in range(elements.groups)]


def check_equations(model: Model, wanted: Integers) -> Elements:
    """The right-hand side and its Jacobian are the same, but for the order of states; every call comes after what it reads."""
    plain = model.system()
    engine = model.engine.with_groups(wanted)
    other = System(engine.plan, plain.parameters, engine.elements)
    rng = np.random.default_rng(1)
    x = plain.initial(0.0) + 0.1 * rng.standard_normal(plain.size)
    old = np.concatenate(
        [plain.elements.offsets[e] + np.arange(_states(plain, e)) for e in plain.elements.order]
    )
    new = np.concatenate(
        [other.elements.offsets[e] + np.arange(_states(plain, e)) for e in plain.elements.order]
    )
    y = np.empty_like(x)
    y[new] = x[old]
    assert (other.rhs(0.7, y)[new] == plain.rhs(0.7, x)[old]).all()
    jacobian = other.jacobian(0.7, y)[np.ix_(new, new)]
    np.testing.assert_allclose(jacobian, plain.jacobian(0.7, x)[np.ix_(old, old)], rtol=1e-12, atol=1e-12)
    _check_calls(engine.elements)
    assert len(engine.wiring) <= engine.elements.groups
    return engine.elements


def _states(system: System, element: int) -> int:
    return len(system.kind(int(element)).states)


def _check_calls(elements: Elements) -> None:
    for family in elements.families:
        for place, row in zip(family.places.tolist(), family.calls.tolist(), strict=True):
            done = set()
            for element, part in zip(row, family.parts.tolist(), strict=True):
                for source, what, index in elements.read_by(element, part):
                    if what == "out" and elements.home[source] in (place, -1):
                        owner = next(k for k, p in enumerate(elements.kind(source).parts) if index in p.outs)
                        assert (source, owner) in done
                assert (element, part) not in done
                done.add((element, part))
            states = [e for e in elements.nodes_of(place) if elements.kind(e).states]
            assert [e for e, part in zip(row, family.parts.tolist(), strict=True) if part < 0] == states


def test_equations_stay(levels: Model) -> None:
    for wanted in contiguous(levels.engine.elements):
        check_equations(levels, wanted)
    elements = check_equations(levels, partitions.agents(levels.engine.elements))
    assert names(levels, elements) == ["one", "two", "c", "d"]


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(a_model(platoon(6)), id="platoon"),
        pytest.param(a_model(platoon(6, order=True)), id="platoon in another order"),
        pytest.param(a_model(chain(5, one_group=True)), id="chain"),
        pytest.param(a_model(robots(2, 3)), id="robots"),
        pytest.param(a_model(fan(2)), id="fan"),
    ],
)
def test_equations_of_arrays_stay(model: Model) -> None:
    elements = model.engine.elements
    one = check_equations(model, partitions.one(elements))
    assert one.groups == 1
    check_equations(model, partitions.agents(elements))
    rng = np.random.default_rng(3)
    for share in (0.2, 0.5, 0.8):
        labels = np.cumsum(rng.random(elements.groups) < share)
        labels -= labels[0]
        check_equations(model, np.where(elements.home >= 0, labels[elements.home], -1))


def test_agents_that_need_each_other_stay_together() -> None:
    """A chain whose elements read both neighbours, before which stands one that reads nobody."""
    model = hierc.load(
        """
agent First() { write real x = 1; diff { x' = -x; } }
agent Link() { read real l, r; write real x = 0; diff { x' = l + r - 2*x; } }
agent All() {
  agent f = First();
  agent a = Link() [l := f.x, r := b.x];
  agent b = Link() [l := a.x, r := 0];
  agent c = Link() [l := b.x, r := 0];
  group everything = f, a, b, c;
}"""
    )
    elements = model.engine.elements
    assert names(model, elements) == ["everything"]
    split = check_equations(model, partitions.agents(elements))
    assert names(model, split) == ["f", "a+b", "c"]


def test_names_of_joined_arrays() -> None:
    model = a_model(platoon(6))
    elements = model.engine.elements
    assert names(model, elements) == ["lead", *(f"car[{k}]" for k in range(1, 7))]

    def joined(*labels: int) -> list[str]:
        wanted = np.where(elements.home >= 0, np.array(labels)[elements.home], -1)
        return names(model, model.engine.with_groups(wanted).elements)

    assert joined(0, 0, 0, 0, 0, 0, 0) == ["lead+car"]
    assert joined(0, 1, 1, 1, 1, 1, 1) == ["lead", "car"]
    assert joined(0, 0, 0, 1, 1, 2, 3) == ["lead+car[1..2]", "car[3..4]", "car[5]", "car[6]"]


def test_one_row_for_groups_that_are_joined_alike() -> None:
    """What belongs to one element of an array: such groups are a family again, with its index in their names."""
    model = hierc.load(
        """
agent Slow(real x0) { write real x = x0; diff { x' = -x; } }
agent Fast() { read real goal; write real y = 0; diff { y' = 9*(goal - y); } }
agent All() {
  level slow { agent a[i in 1..4] = Slow(x0 = i); }
  level fast { agent b[i in 1..4] = Fast() [goal := a[i].x]; }
  group each a; group each b;
}"""
    )
    elements = model.engine.elements
    kinds = np.arange(8) % 4  # which element each group is of
    wanted = np.where(elements.home >= 0, kinds[elements.home], -1)
    check_equations(model, wanted)
    made = model.engine.with_groups(wanted)
    assert [(g.name, g.count) for g in made.plan.groups] == [("a[]+b[]", 4)]
    assert names(model, made.elements) == [f"a[{k}]+b[{k}]" for k in range(1, 5)]
    assert len(made.wiring) == 1


def independent(model: Model, stop: float, t: NDArray[np.float64]) -> NDArray[np.float64]:
    solution = solve_ivp(model.rhs, (0.0, stop), model.initial(), "DOP853", t, rtol=1e-11, atol=1e-12)
    return np.asarray(solution.y)


@pytest.mark.parametrize("group", ["auto", "level", "agent", "one"])
def test_results_agree_with_an_independent_solution(levels: Model, group: str) -> None:
    result = levels.simulate(group=group)
    expected = independent(levels, 4.0, result.t)
    for name, wanted in zip(levels.states, expected, strict=True):
        assert np.abs(result[name] - wanted).max() < 1e-7
    assert result.settings["group"] == group


def test_statistics_go_by_joined_groups(levels: Model) -> None:
    result = levels.simulate(group="one")
    assert list(result.stats) == ["one+two+three"]
    assert result.stats["two"] == result.stats["one+two+three"]
    assert (result.steps("three")[0] == result.steps("one+two+three")[0]).all()
    with pytest.raises(KeyError, match="unknown group `four`"):
        result.stats["four"]
    assert [family.name for family in result.families] == ["one+two+three"]
    split = levels.simulate(group="agent")
    with pytest.raises(KeyError, match="unknown group `three`"):  # it is divided
        split.stats["three"]


def test_the_tightest_settings_hold_for_a_joined_group() -> None:
    model = hierc.load(
        LEVELS % "group two { rtol = 1e-10; } group three { rtol = 1e-4; max_step = 20 [ms]; }"
    )
    settings = {**BASE, "rtol": 1e-8, "atol": 1e-9}
    one = model.engine.with_groups(partitions.one(model.engine.elements))
    found = one.group_settings(settings, model.plan.experiment.groups)
    assert len(found.distinct) == 1
    assert (found[0].rtol, found[0].atol, found[0].max_step) == (1e-10, 1e-10, 0.02)
    result = model.simulate(group="one")
    assert np.diff(np.append(result.steps("three")[0], 4.0)).max() < 0.02 + 1e-12


def test_auto_joins_no_groups_that_are_set_apart() -> None:
    model = hierc.load(LEVELS % "group two { rtol = 1e-9; }")
    assert list(model.simulate(group="auto").stats) == ["one", "two", "three"]


def test_two_methods_for_one_group_are_refused() -> None:
    model = hierc.load(LEVELS % "group one { method = tsit5; } group three { method = radau5; }")
    with pytest.raises(
        SettingError, match="`one` and `three` would be in one group, but have methods of their own, tsit5"
    ):
        model.simulate(group="one")
    assert {s.method for s in model.simulate(group="auto").stats.values()} >= {"tsit5", "radau5"}


def test_one_method_holds_for_the_whole_group() -> None:
    model = hierc.load(LEVELS % "group three { method = radau5; }")
    assert [s.method for s in model.simulate(group="one").stats.values()] == ["radau5"]


def test_an_unknown_kind_is_refused(levels: Model) -> None:
    with pytest.raises(SettingError, match="unknown grouping `levels`; there are auto, level, agent, one"):
        levels.simulate(group="levels")


def test_a_joined_run_can_be_verified(levels: Model) -> None:
    result = levels.simulate(group="one", verify=True)
    assert result.verification is not None
    assert [group.name for group in result.verification.groups] == ["one+two+three"]
    assert 0.0 < result.verification.error < 10.0


BASE: Mapping[str, Any] = {
    "start": 0.0, "stop": 4.0, "rtol": 1e-6, "atol": 1e-6, "method": "auto", "max_step": np.inf, "min_step": 0.0,
}  # fmt: skip


def neighbours(model: Model, **settings: Any) -> Neighbours:
    found = decision(model.engine, model.system(), {**BASE, **settings}, {})
    assert found is not None
    return found.neighbours


def test_the_best_grouping_is_the_least_of_all(levels: Model) -> None:
    for model in (levels, hierc.load("cart"), hierc.load("quadrotor")):
        known = neighbours(model)
        count = model.engine.elements.groups
        every = [(0, *itertools.accumulate(cuts)) for cuts in itertools.product((0, 1), repeat=count - 1)]
        least = min(known.estimate(labels).seconds for labels in every)
        assert known.best().seconds == pytest.approx(least, rel=1e-12)
        assert known.estimate(known.best().labels).seconds == pytest.approx(least, rel=1e-12)


def test_like_groups_are_joined_and_unlike_ones_are_not() -> None:
    """Two oscillators one after the other: of one frequency, and of two that differ by a factor of 300."""
    text = """
agent Oscillator(real w) {{
  read real s;
  write real q = 1, p = 0;
  diff {{ q' = w*p; p' = w*(s + 0.2*sin(0.7*w*time/(1 [s])) - q - 0.6*p); }}
}}
agent Two() {{
  level first {{ agent a = Oscillator(w = 1) [s := 0]; }}
  level second {{ agent b = Oscillator(w = {w}) [s := a.q]; }}
}}
experiment run of Two() {{ stop = 20 [s]; }}"""
    assert list(hierc.load(text.format(w=1)).simulate(group="auto").stats) == ["first+second"]
    assert list(hierc.load(text.format(w=300)).simulate(group="auto").stats) == ["first", "second"]


def test_decisions_do_not_depend_on_a_run_s_parameters() -> None:
    model = hierc.load("cart")
    first = model.simulate(stop=5, group="auto")
    again = hierc.load("cart").simulate(stop=5, group="auto", params={"tail.kt": 300.0})
    assert list(first.stats) == list(again.stats)
    assert len(model.engine.groupings) == 1
    model.simulate(stop=5, group="auto", params={"tail.kt": 300.0})
    assert len(model.engine.groupings) == 1


def test_decisions_are_clear(levels: Model) -> None:
    for model in (levels, hierc.load("cart"), hierc.load("servo")):
        found = decision(model.engine, model.system(), BASE, {})
        assert found is not None
        kept = found.chosen == found.levels
        assert kept == (found.neighbours.best().seconds >= CLEARLY * found.levels.seconds)
        assert (
            partition(model.engine.elements, found.levels.labels).tolist()
            == model.engine.elements.home.tolist()
        )


def test_predicted_sizes_are_those_of_the_joined_groups() -> None:
    """What is joined is made, and its form counted."""
    from hierc.runtime.coupling import form_facts

    for name in ("cart", "quadrotor", "snake"):
        model = hierc.load(name)
        elements = model.engine.elements
        joined = neighbours(model)._coupling
        for first, last in ((0, 1), (1, 2), (0, elements.groups - 1)):
            labels = np.array([k - min(max(k - first, 0), last - first) for k in range(elements.groups)])
            engine = model.engine.with_groups(np.where(elements.home >= 0, labels[elements.home], -1))
            wiring = next(w for w in engine.wiring if first in w.places.tolist())
            facts = form_facts(wiring.form, model.plan.classes)
            sizes = [*joined.joined(first, last)][-1]
            assert sizes.states == wiring.form.states
            assert sizes.inputs == wiring.form.inputs
            assert sizes.published == len(wiring.form.published)
            assert sizes.chained == facts.chained
            assert sizes.flops == pytest.approx(
                facts.flops, rel=0.15
            )  # what two groups share is counted twice


def test_arrays_are_joined_whole_or_in_pieces_that_are_alike() -> None:
    arrays = _Arrays(a_model(platoon(6)).engine.elements)  # lead, car[1] to car[6]
    allowed = {(k, k + n) for k in range(7) for n, fits in enumerate(arrays.regular(k)) if fits}
    single = {(k, k) for k in range(7)}
    assert allowed - single == {(0, 6), (1, 6), (1, 2), (3, 4), (5, 6), (1, 4), (5, 6)}


def test_comparison_tries_every_grouping(levels: Model) -> None:
    rows = levels.compare_groups(rtol=1e-6)
    assert {row.groups for row in rows} == {
        ("one", "two", "three"), ("one+two", "three"), ("one", "two+three"), ("one+two+three",), ("one", "two", "c", "d"),
    }  # fmt: skip
    kinds = [kind for row in rows for kind in row.kinds]
    assert sorted(kinds) == ["agent", "auto", "level", "one"]
    measured = [row.measured for row in rows if row.measured is not None]
    assert len(measured) == len(rows)
    assert measured == sorted(measured)
    for row in rows:
        assert len(row.steps) == len(row.groups)
        assert (row.predicted is None) == (row.kinds == ("agent",))


def test_comparison_tells_what_fails() -> None:
    model = hierc.load("agent A() { write real x = 1; diff { x' = x^2; } }")
    (row,) = model.compare_groups(stop=3)
    assert row.measured is None
    assert "step of group `a`" in row.failure.lower()


@pytest.mark.parametrize("group", ["auto", "level", "agent", "one"])
@pytest.mark.parametrize("pull", ["x", "x'"])
def test_the_state_that_fails_is_named_in_any_groups(group: str, pull: str) -> None:
    """x' = x^2 has a pole at 1 s; what follows it moves as fast, or faster."""
    model = hierc.load(
        f"""
agent Bad() {{ write real x = 1, f; alge {{ f = x^2; }} diff {{ x' = f; }} }}
agent After() {{ read real goal; write real y = 0; diff {{ y' = 1000*({"goal - y" if pull == "x" else "goal"}); }} }}
agent All() {{
  level one {{ agent bad = Bad(); }}
  level two {{ agent after = After() [goal := bad.{"x" if pull == "x" else "f"}]; }}
}}"""
    )
    with pytest.raises(SimulationError, match=r"`bad\.x` \(line 2\)") as caught:
        model.simulate(2.0, group=group)
    assert caught.value.result.t_reached == pytest.approx(1.0, abs=1e-3)


def test_panels_follow_the_groups_as_written(levels: Model) -> None:
    shown = levels.simulate(group="level").panels()
    assert list(shown) == ["one", "two", "three"]
    for group in ("auto", "agent", "one"):
        assert levels.simulate(group=group).panels() == shown


def test_the_gain_of_joining_is_told(levels: Model) -> None:
    found = decision(levels.engine, levels.system(), {**BASE, "rtol": 1e-8, "atol": 1e-8}, {})
    assert found is not None
    joined = levels.simulate(group="auto")
    assert joined.settings["group"] == "auto"
    assert len(joined.stats) < 3
    assert joined.gain == found.levels.seconds / found.chosen.seconds > 1.0
    assert "two" in joined.stats
    assert levels.simulate(group="one").gain is None
    assert levels.simulate(group="level").gain is None


def test_runs_piece_by_piece_decide_once(levels: Model) -> None:
    levels.engine.groupings.clear()
    named = [
        [*levels.simulate(start=t, stop=t + 0.3, rtol=1e-5, group="auto").stats] for t in (0.0, 0.3, 0.6)
    ]
    assert len(levels.engine.groupings) == 1
    assert named[0] == named[1] == named[2]


@pytest.mark.parametrize("stop", ["soon", 0, float("nan"), True])
def test_a_wrong_stop_is_told_before_anything_is_decided(levels: Model, stop: Any) -> None:
    with pytest.raises(SettingError, match="stop"):
        levels.simulate(stop)
