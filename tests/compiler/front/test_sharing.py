"""What has no states and is read by many: which of it gets a group, what that is called, and that reads grow in proportion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import model_of

from hierc.compiler.arrays.elements import spelled
from hierc.compiler.driver import compile_source
from hierc.grammar.source import SourceFile
from hierc.runtime.contract import Plan
from hierc.runtime.elements import expand
from hierc.runtime.machine.forms import wire
from hierc.runtime.parameters import parameter_vector
from hierc.runtime.system import System

AGENTS = """
agent Car(real w = 1) {
  read real u;
  write real x = 1, v = 0;
  diff { x' = v; v' = -w^2*(x + u); }
}
agent Lag(real T = 1) {
  read real u;
  write real y = 0;
  diff { y' = (u - y)/T; }
}
"""


def crowd(cars: int, readers: int, read: str = "sum(car.x)/N", between: str = "") -> str:
    """Cars, and readers of what is made of them."""
    return f"""{AGENTS}
agent Road(int N = {cars}, int R = {readers}) {{
  level cars {{ agent car[i in 1..N] = Car(w = 1 + i/N) [u := 0]; }}
  group each car;
  {between}
  level readers {{ agent lag[i in 1..R] = Lag(T = i/R) [u := {read}]; }}
  group each lag;
}}
experiment run of Road() {{ stop = 1 [s]; }}
"""


def named(text: str) -> list[str]:
    """The groups of a model."""
    return [spelled(g.name, g.indices) for g in model_of(text).groups]


def plan_of(text: str) -> Plan:
    names: dict[str, Any] = {"__name__": "made", "__file__": "made.py"}
    exec(compile_source(SourceFile("test.hier", text), None, {}).text, names)
    plan: Plan = names["MODEL"].plan
    return plan


def read_channels(plan: Plan) -> int:
    """How many channels all groups read, together."""
    return sum(len(w.places) * w.form.inputs for w in wire(plan))


# ---- which -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cars", "readers", "shared"),
    [(64, 2, False), (65, 2, True), (40, 2, False), (40, 3, True), (33, 3, True), (33, 40, True)],
)
def test_what_spares_reads_is_shared(cars: int, readers: int, *, shared: bool) -> None:
    middle = ["sum(car.x)"] if shared else []
    assert named(crowd(cars, readers)) == [f"car[1..{cars}]", *middle, f"lag[1..{readers}]"]


def test_one_reader_sums_for_itself() -> None:
    assert named(crowd(40, 1)) == ["car[1..40]", "lag[1]"]


def test_extremes_and_sums_over_expressions_are_shared_apart() -> None:
    let = "let all = sum([car[j].x*car[j].v for j in 1..N]);"
    found = named(crowd(40, 50, "sum(car.x) + max(car.x) + min(car.v) + all", between=let))
    made = ["max(car.x)", "min(car.v)", "sum([car[j].x*car[j].v for j in 1..N])", "sum(car.x)"]
    assert sorted(found[1:-1]) == made


def test_a_sum_within_a_sum_is_computed_by_the_one_that_reads_it() -> None:
    """Who reads the variance reads the mean only by way of it."""
    let = "let mean = sum(car.x)/N; let spread = sum([(car[j].x - mean)^2 for j in 1..N])/N;"
    variance = "sum([(car[j].x - mean)^2 for j in 1..N])"
    assert named(crowd(40, 50, "spread", between=let)) == ["car[1..40]", variance, "lag[1..50]"]
    both = named(crowd(40, 50, "spread + mean", between=let))
    assert both == ["car[1..40]", "sum(car.x)", variance, "lag[1..50]"]


def test_a_long_text_is_cut() -> None:
    let = "let all = sum([car[j].x*car[j].v\n    + car[j].x*car[j].x + car[j].v*car[j].v for j in 1..N]);"
    (name,) = named(crowd(40, 50, "all", between=let))[1:-1]
    assert name == "sum([car[j].x*car[j].v + car[j].x*car[j].x +…)"


METER = """
agent Meter() {
  read real a, b, c, d, e;
  write real far;
  MORE
  alge { far = a*b + sin(c*d); ALSO }
}
"""


def metered(more: str = "", also: str = "", e: str = "0", read: str = "meter.far") -> str:
    agent = METER.replace("MORE", more).replace("ALSO", also)
    reads = ", ".join(f"{name} := car[{k}].x" for k, name in enumerate("abcd", start=1))
    between = f"level meter {{ agent meter = Meter() [{reads}, e := {e}]; }}"
    return agent + crowd(4, 30, read, between=between)


def test_an_agent_without_states_is_shared_under_its_name() -> None:
    model = model_of(metered())
    assert [g.name for g in model.groups] == ["car[]", "meter", "lag[]"]
    assert not model.warnings  # its level has a group


def test_an_agent_of_which_more_is_read_is_computed_by_its_readers() -> None:
    text = metered("write real near;", "near = a + b;", read="meter.far + meter.near")
    model = model_of(text)
    assert [g.name for g in model.groups] == ["car[]", "lag[]"]
    assert [w.code for w in model.warnings] == ["W611"]


def test_what_nobody_reads_makes_no_loop() -> None:
    """The meter's other variable shows a reader of the first one."""
    agent = METER.replace("MORE", "write real late;").replace("ALSO", "late = e;")
    text = f"""{AGENTS}{agent}
    agent Road() {{
      agent car[i in 1..4] = Car() [u := 0];
      agent meter = Meter() [a := car[1].x, b := car[2].x, c := car[3].x, d := car[4].x, e := lag[1].y];
      agent lag[i in 1..30] = Lag() [u := meter.far];
    }}
    experiment run of Road() {{ stop = 1 [s]; }}"""
    assert named(text) == ["car[1..4]", "meter", "lag[1..30]"]


# ---- loops -----------------------------------------------------------------------------------------

LOOP = (
    AGENTS
    + """
agent Road(int N = 40) {
  agent car[i in 1..N] = Car(w = 1 + i/N) [u := 0.1*sum(car.x)/N];
  agent lag[i in 1..50] = Lag(T = i) [u := sum(car.x)/N];
}
experiment run of Road() { stop = 1 [s]; }
"""
)


def test_who_is_among_what_he_reads_keeps_it_for_all() -> None:
    """The cars move by their mean, so they are one group; the mean is a part of it that others read."""
    plan = plan_of(LOOP)
    elements = expand(plan)
    assert [g.name for g in plan.groups] == ["car", "lag[]"]
    cars = elements.families[0]
    sizes = [len(elements.kind(e).states) for e in cars.nodes[0].tolist()]
    assert sorted(sizes) == [0, *[2] * 40]
    assert [(w.form.states, w.form.inputs) for w in wire(plan)] == [(80, 0), (1, 1)]


def test_the_jacobian_of_such_a_group() -> None:
    plan = plan_of(LOOP)
    system = System(plan, parameter_vector(plan, {}))
    x = np.random.default_rng(3).normal(0.0, 1.0, system.size)
    found = system.jacobian_of(system.elements.nodes_of(0), 0.0, x)
    steps = np.eye(system.size)[:80] * 1e-3
    expected = [(system.rhs(0.0, x + s) - system.rhs(0.0, x - s))[:80] / 2e-3 for s in steps]
    assert found == pytest.approx(np.array(expected).T, abs=1e-9)


# ---- arrays of sums --------------------------------------------------------------------------------

PLATOONS = (
    AGENTS
    + """
agent Platoon(int N = 40) {
  level slow { agent car[i in 1..N] = Car(w = 1 + i/N) [u := 0]; }
  group each car;
  level fast { agent lag[i in 1..N] = Lag(T = i/N) [u := sum(car.x)/N]; }
  group each lag;
}
agent Road(int P = 3) { agent p[i in 1..P] = Platoon(); }
experiment run of Road() { stop = 1 [s]; }
"""
)


def test_sums_in_an_array_are_groups_of_an_array() -> None:
    assert "p[1..3].sum(car.x)" in named(PLATOONS)
    plan = plan_of(PLATOONS)
    assert read_channels(plan) == 3 * (40 + 40)


def test_slices_share_their_parts() -> None:
    """Each lag sums over the cars up to its own: a few parts each, themselves groups, numbered."""
    text = crowd(300, 300, "sum(car[1..i].x)")
    names = [g.name for g in model_of(text).groups]
    assert {"car[]", "lag[]"} < set(names)
    assert set(names) - {"car[]", "lag[]"} == {"sum(car[1..i].x)[]"}
    plan = plan_of(text)
    numbers = [n for f in expand(plan).families if f.name.startswith("sum") for n in f.indices[:, 0].tolist()]
    assert sorted(numbers) == list(range(1, len(numbers) + 1))
    assert read_channels(plan) < 300 * 16  # alone they would read 45,150


# ---- how much is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("read", ["sum(car.x)/N", "max(car.x)", "max(car.x) - min(car.x)", "all"])
def test_reads_grow_in_proportion(read: str) -> None:
    """One read a term and one a reader, of each fan-in; and nobody's calls hold a fan-in but its own group's."""
    let = "let all = sum([car[j].x*car[j].v for j in 1..N]);"
    fans = 2 if "-" in read else 1
    terms = 2 if read == "all" else 1  # of each agent
    for count in (50, 100, 200):
        plan = plan_of(crowd(count, count, read, between=let))
        assert read_channels(plan) == count * (terms + 1) * fans
        elements = expand(plan)
        for family in elements.families:
            states = [len(elements.kind(e).states) for e in family.calls[0].tolist()]
            assert (0 in states) == (elements.group_states[family.places[0]] == 0)
