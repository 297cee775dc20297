"""A group's functions, composed from its nodes', against the same equations in plain Python and by differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from machine_code import Floats, exported, room
from scipy.integrate import solve_ivp
from small_models import ARM, DECAY, MIXER, OSCILLATOR, At, Source, a_class, a_plan

from hierc.runtime.contract import Plan
from hierc.runtime.machine import body, compose
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.forms import Wiring, wire
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.methods.radau_tables import RADAU5, RADAU9
from hierc.runtime.model import Model
from hierc.runtime.parameters import parameter_vector
from hierc.runtime.system import System

RNG = np.random.default_rng(5)

#: osc -> arm1 <-> arm2, through outs and through a node without states; arm3 reads an out of arm2 that itself needs an input.
NODES = {
    "osc": At(OSCILLATOR, (), 1),
    "arm1": At(ARM, ((0, "state", 0), (3, "out", 0)), 2),
    "mix": At(MIXER, ((1, "out", 0), (0, "state", 1))),
    "arm2": At(ARM, ((2, "out", 0), (2, "out", 1)), 2),
    "arm3": At(ARM, ((3, "out", 1), (1, "state", 2)), 2),
}
PARAMETERS = {
    "osc.w": 1.3,
    "arm1.k": 0.7,
    "arm1.d": 0.4,
    "arm2.k": 1.9,
    "arm2.d": -0.2,
    "arm3.k": 0.1,
    "arm3.d": 2.0,
}
GROUPINGS: Sequence[Mapping[str, Sequence[str]]] = (
    {"all": ["osc", "arm1", "arm2", "arm3"]},
    {"osc": ["osc"], "arms": ["arm1", "arm2", "arm3"]},
    {"osc": ["osc"], "pair": ["arm1", "arm2"], "last": ["arm3"]},
    {"front": ["osc", "arm2", "arm1"], "last": ["arm3"]},
)


def string_of_arms(count: int) -> Plan:
    """Behind an oscillator a group of arms, each of which moves its neighbours by outs of nodes between them. No two arms are equal in numbers."""
    nodes = {"osc": At(OSCILLATOR, (), 1)}
    parameters = {"osc.w": 1.3}
    for k in range(1, count + 1):
        before, after = 2 * k - 2, 2 * k
        ahead: Source = (before, "out", 0) if k > 1 else (0, "state", 0)
        behind: Source = (after, "out", 1) if k < count else (0, "state", 1)
        nodes[f"arm{k}"] = At(ARM, (ahead, behind), 2)
        if k < count:
            nodes[f"mix{k}"] = At(MIXER, ((2 * k - 1, "out", 0), (2 * k + 1, "state", 1)))
        parameters |= {f"arm{k}.k": 0.7 + 0.01 * k, f"arm{k}.d": 0.4 - 0.02 * k}
    return a_plan(nodes, {"osc": ["osc"], "arms": [f"arm{k}" for k in range(1, count + 1)]}, parameters)


def cases() -> list[tuple[Plan, int]]:
    plans = [a_plan(NODES, groups, PARAMETERS) for groups in GROUPINGS]
    return [*((plan, g) for plan in plans for g in range(len(plan.groups))), (string_of_arms(9), 1)]


CASES = pytest.mark.parametrize(
    ("plan", "g"), cases(), ids=lambda v: v if isinstance(v, int) else "+".join(x.name for x in v.groups)
)


def published(wiring: Wiring) -> list[tuple[int, int]]:
    """(element, out) of what a single group publishes."""
    return list(zip(wiring.published[0].tolist(), wiring.outs, strict=True))


def outs(system: System, t: Floats, x: Floats, node: int, out: int) -> list[float]:
    """An out by plain Python, at times t (count,) and states x (count, n)."""
    return [system.outs_of(node, system.world_at(s, row))[out] for s, row in zip(t, x, strict=True)]


class Group:
    """One group of a plan as machine code, and what it reads and computes according to `System`."""

    def __init__(self, plan: Plan, g: int, lanes: int) -> None:
        self.plan, self.g, self.lanes = plan, g, lanes
        self.system = System(plan, parameter_vector(plan, {}))
        self.wiring: Wiring = wire(plan)[g]
        self.n = self.wiring.form.states
        self.values = np.array([*self.system.values_of(self.wiring.values[0]), 0.0])
        first = self.system.offsets[plan.groups[g].nodes[0]]
        self.own = slice(first, first + self.n)

    def composer(self) -> Composer:
        return Composer(
            Unit("group"), "group", self.wiring.form, self.plan.classes, parse_function, self.lanes
        )

    def inputs(self, t: Floats, x: Floats) -> Floats:
        """What the group's channels hold, (inputs, lanes), where all states are x (lanes, n)."""
        wirings = wire(self.plan)
        into = room(self.wiring.form.inputs, self.lanes)
        pairs = zip(self.wiring.owners[0].tolist(), self.wiring.channels[0].tolist(), strict=True)
        for k, (owner, channel) in enumerate(pairs):
            other = Group(self.plan, owner, self.lanes)
            if channel < other.n:
                into[k] = x[:, other.own.start + channel]
            else:
                node, out = published(wirings[owner])[channel - other.n]
                into[k] = outs(self.system, t, x, node, out)
        return into

    def states(self, x: Floats) -> Floats:
        into = room(self.n, self.lanes)
        into[:] = x.T[self.own]
        return into


def some_states(group: Group) -> tuple[Floats, Floats]:
    return RNG.uniform(0, 5, group.lanes), RNG.normal(0, 1, (group.lanes, group.system.size))


NEVER = 10**9


@pytest.fixture(params=["written out", "by table"])
def by_table(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """All groups are done in one way."""
    tables = request.param == "by table"
    for module, name, value in (
        (compose, "ALIKE", 1),
        (compose, "LARGE", -1),
        (body, "MANY", 2),
        (body, "COPIES", 2),
    ):
        monkeypatch.setattr(module, name, value if tables else NEVER)
    return tables


@pytest.mark.parametrize("lanes", [1, 8])
@CASES
def test_right_hand_side(plan: Plan, g: int, lanes: int, by_table: bool) -> None:
    group = Group(plan, g, lanes)
    t, x = some_states(group)
    u, p = group.inputs(t, x), group.values
    fixed, rest = group.composer(), group.composer()
    assert rest.large == by_table
    v, dx = room(fixed.saved, lanes), room(group.n, lanes)
    exported(fixed.unit, fixed.rhs_fixed)(t, u, p, v)
    exported(rest.unit, rest.rhs)(t, group.states(x), u, p, dx, v)
    expected = np.array([group.system.rhs(s, row)[group.own] for s, row in zip(t, x, strict=True)]).T
    if lanes == 1:
        assert (dx == expected).all()
    else:
        # Three outs in a row with sines within 2 ulp each.
        assert dx == pytest.approx(expected, rel=1e-14, abs=1e-14)


@CASES
def test_published_outs(plan: Plan, g: int, by_table: bool) -> None:
    group = Group(plan, g, 4)
    wirings = wire(plan)
    t, x = some_states(group)
    composer = group.composer()
    out = room(len(group.wiring.outs), 4)
    exported(composer.unit, composer.publish())(t, group.states(x), group.inputs(t, x), group.values, out)
    for k, (node, number) in enumerate(published(group.wiring)):
        wanted = outs(group.system, t, x, node, number)
        assert out[k] == pytest.approx(wanted, rel=1e-14, abs=1e-14)
    read = {int(c) for w in wirings for c in w.channels[w.owners == g] if c >= group.n}
    assert read == set(range(group.n, group.n + len(group.wiring.outs)))


@pytest.mark.parametrize("tables", [RADAU5, RADAU9], ids=["4 lanes", "8 lanes"])
@CASES
def test_newton_matrix(plan: Plan, g: int, tables, by_table: bool) -> None:
    """Solutions with lambda - h J satisfy the equations with J from plain Python, at the lane asked for."""
    lanes, half, middle = tables.lanes, tables.lanes // 2, 1
    group = Group(plan, g, lanes)
    t, x = some_states(group)
    h = 0.3
    factor, solve = group.composer(), group.composer()
    factors = room(factor.factor_size // lanes + 1, lanes)
    u = group.inputs(np.full(lanes, t[middle]), x)
    fixed = group.composer()
    v = room(fixed.saved, lanes)
    exported(fixed.unit, fixed.rhs_fixed)(np.full(lanes, t[middle]), u, group.values, v)
    exported(factor.unit, factor.factor(tables.eigenvalues, middle))(
        t[middle : middle + 1], np.array([h]), group.states(x), u, group.values, v, factors
    )
    b = room(group.n, lanes)
    b[:] = RNG.normal(size=b.shape)
    b[:, half] = 0.0
    right = b.copy()
    exported(solve.unit, solve.solve())(b, factors)
    jacobian = group.system.jacobian(t[middle], x[middle])[group.own, group.own]
    for k in range((tables.stages + 1) // 2):
        eigenvalue = complex(tables.eigenvalues[k], tables.eigenvalues[half + k])
        matrix = eigenvalue * np.eye(group.n) - h * jacobian
        solution = b[:, k] + 1j * b[:, half + k]
        assert matrix @ solution == pytest.approx(right[:, k] + 1j * right[:, half + k], rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("groups", GROUPINGS, ids="+".join)
def test_the_systems_jacobian_against_differences(groups: Mapping[str, Sequence[str]]) -> None:
    """Six-point differences, error about 1e-12; the block of each group also has its pattern from the form."""
    plan = a_plan(NODES, groups, PARAMETERS)
    system = System(plan, parameter_vector(plan, {}))
    x, t, h = np.random.default_rng(5).normal(0, 1, system.size), 0.8, 1e-2
    assert np.abs(x).min() > 3 * h  # arms have a kink at zero
    found = system.jacobian(t, x)
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    for k in range(system.size):
        step = np.zeros(system.size)
        step[k] = h
        column = (
            sum(w * (system.rhs(t, x + m * step) - system.rhs(t, x - m * step)) for m, w in weights.items())
            / h
        )
        assert found[:, k] == pytest.approx(column, abs=1e-9)
    for g in range(len(plan.groups)):
        group = Group(plan, g, 4)
        block = found[group.own, group.own]
        assert set(zip(*np.nonzero(block), strict=True)) <= set(group.composer().pattern)


def test_equal_groups_have_one_form() -> None:
    nodes = {f"d{k}": At(DECAY, (), 1) for k in range(5)}
    plan = a_plan(nodes, None, {f"d{k}.rate": float(k) for k in range(5)})
    assert len({w.form for w in wire(plan)}) == 1


def test_linear_systems_are_known_to_be_linear() -> None:
    plan = a_plan(NODES, GROUPINGS[2], PARAMETERS)
    assert [Group(plan, g, 4).composer().linear() for g in range(3)] == [True, False, False]


def test_what_only_a_published_out_reads() -> None:
    """The middle group's right-hand side needs nothing; its out needs, through a node without states, what the first group publishes."""
    teller = a_class(
        "Teller", {"x": "1.0"}, {(1, 0): "u[0]", (1, 1): "x[0]"}, inputs=1, outs=[("x[0]*u[0]", (0,))]
    )
    nodes = {
        "arm": At(ARM, ((0, "state", 0), (0, "state", 1)), 2),
        "mix": At(MIXER, ((0, "out", 0), (0, "state", 2))),
        "teller": At(teller, ((1, "out", 1),)),
        "reader": At(ARM, ((2, "out", 0), (2, "state", 0)), 2),
    }
    plan = a_plan(nodes, None, {"k": 1.0, "d": 2.0, "k2": 3.0, "d2": 4.0})
    # As a compiler leaves it that sees which inputs a right-hand side does not read.
    groups = [replace(g, calls=((2, -1),)) if g.name == "teller" else g for g in plan.groups]
    plan = replace(plan, groups=tuple(groups))
    assert [published(w) for w in wire(plan)] == [[(0, 0)], [(2, 0)], []]
    group = Group(plan, 1, 4)
    t, x = some_states(group)
    composer, out = group.composer(), room(1, 4)
    exported(composer.unit, composer.publish())(t, group.states(x), group.inputs(t, x), group.values, out)
    wanted = outs(group.system, t, x, 2, 0)
    assert out[0] == pytest.approx(wanted, rel=1e-14)


def test_a_switch_is_not_linear() -> None:
    """Its Jacobian, zero on either side, is constant; one Newton iteration would still not do. Switches of time and inputs alone do not matter."""
    relay = a_class("Relay", {"x": "-1.0 if x[0] > 0.0 else 1.0"})
    steps = a_class("Steps", {"x": "-float(math.floor(x[0]))"})
    clock = a_class("Clock", {"x": "(1.0 if t > 1.0 else 2.0) - x[0]"}, {(0, 0): "-1.0"})
    plan = a_plan({"relay": At(relay), "steps": At(steps), "clock": At(clock)})
    assert [Group(plan, g, 4).composer().linear() for g in range(3)] == [False, False, False]
    lines = ["if t > 1.0:", "    a = 1.0", "else:", "    a = 2.0"]
    timed = a_class("Timed", {"x": "a - x[0]"}, {(0, 0): "-1.0"}, first=lines)
    assert Group(a_plan({"timed": At(timed)}), 0, 4).composer().linear()


def test_a_large_group_is_called_and_computes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is too large to become part of every piece differs in nothing else."""
    plan = a_plan(NODES, GROUPINGS[0], PARAMETERS)
    group = Group(plan, 0, 8)
    t, x = some_states(group)
    u, p = group.inputs(t, x), group.values
    results = []
    for limit in (body.INLINED, 0):
        monkeypatch.setattr(body, "INLINED", limit)
        fixed, rest = group.composer(), group.composer()
        assert ("noinline" in rest.rhs.function.attributes) == (limit == 0)
        v, dx = room(fixed.saved, 8), room(group.n, 8)
        exported(fixed.unit, fixed.rhs_fixed)(t, u, p, v)
        exported(rest.unit, rest.rhs)(t, group.states(x), u, p, dx, v)
        results.append(dx)
    assert (results[0] == results[1]).all()
    assert (results[0] != 0.0).any()


def test_code_of_a_group_does_not_grow() -> None:
    """The second half of a string of agents adds nothing: calls, chain rule and linear algebra are loops."""
    sizes = []
    for count in (20, 40, 80):
        group = Group(string_of_arms(count), 1, 8)
        composer = group.composer()
        functions = [
            composer.rhs_fixed, composer.rhs, composer.factor(RADAU9.eigenvalues, 1),
            composer.solve(), composer.solve_real(), composer.solve_lanes(), composer.publish(),
        ]  # fmt: skip
        sizes.append([body.inlined_size(emitted.function, {}) for emitted in functions])
    assert sizes[0] == sizes[1] == sizes[2]


def test_a_run_of_a_large_group() -> None:
    """Thirty arms that move each other, against DOP853."""
    model = Model(string_of_arms(30))
    assert [w.form.states for w in model.engine.wiring] == [2, 90]
    wanted = solve_ivp(model.rhs, (0.0, 3.0), model.initial(), "DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
    for method in ("radau5", "radau9", "radau13", "tsit5"):
        result = model.simulate(stop=3.0, rtol=1e-7, atol=1e-7, method=method)
        found = np.array([result[name][-1] for name in result.names if not name.endswith(".y0")])
        assert found == pytest.approx(wanted, rel=1e-5, abs=1e-5)
