"""Plans: order of calls, parts, shared classes, initial values."""

import math

import pytest
from hand import TIME, Agent, build, ring, toy
from oracle import Interpreter, System, generate, ulps

from hierc.compiler import expression as e
from hierc.compiler.emission.sequence import ordered
from hierc.runtime.contract import Steps


def test_a_toy_cascade():
    system = System(generate(toy()))
    dx = system.rates(2.0, [[1.5], [0.25]], 1)
    assert dx == [20.0 * (1.5 - 0.25)]
    assert system.rates(2.0, [[1.5], [0.25]], 0) == [-0.5 * 1.5 + math.sin(2.0)]
    assert system.initial() == [[1.0], [0.0]]


def test_a_ring_is_called_in_order_of_its_parts():
    model = ring()
    system = System(generate(model))
    left, stateless, right = range(3)
    calls = system.plan.groups[0].calls
    parts = {n: system.form(n).parts for n in range(3)}
    assert [p.inputs for p in parts[left]] == [(), (0,)]  # `free` needs nothing, `h` needs b.g
    assert calls == ((left, 0), (stateless, 0), (right, 0), (left, 1), (left, -1), (right, -1))


def test_a_group_sets_every_out_before_it_reads_it():
    model = ring()
    system = System(generate(model))
    t, states = 0.7, [[0.3], [], [-0.2]]
    found = system.group(0, t, states)
    plain = Interpreter(model, t, states, system.q)
    assert set(found) == {0, 2}
    for n, rates in found.items():
        assert [ulps(a, b) <= 2 for a, b in zip(rates, plain.rates(n), strict=True)] == [True]


def test_stateless_nodes_are_observed():
    system = System(generate(ring()))
    assert system.observed(0.7, [[0.3], [], [-0.2]], 1) == [3 * (2 * 0.3) + 0.7]


def test_outs_of_other_groups_are_channels():
    a = Agent("a", "A")
    a.diff("x", -a.state("x", 1.0))
    speed = Agent("speed", "Speed")
    speed.alge("v", 2 * speed.read("a", "x", "rate"))
    b = Agent("b", "B")
    y = b.state("y", 0.0)
    b.diff("y", b.read("speed", "v", "local") - y)
    system = System(generate(build("M", [a, speed, b], {"a": ["a"], "b": ["b"]})))
    # `b` evaluates the stateless `speed` itself, which reads the channel of a's rate: a's part is not called.
    assert [g.calls for g in system.plan.groups] == [((0, -1),), ((1, 0), (2, -1))]
    assert system.group(1, 0.0, [[0.5], [], [0.1]]) == {2: [2 * -0.5 - 0.1]}


def test_what_is_just_a_state_is_read_as_a_state():
    a = Agent("a", "A")
    x, v = a.state("x", 0.0), a.state("v", 1.0)
    a.diff("x", v)
    a.diff("v", -x)
    a.alge("same", 1.0 * x)
    b = Agent("b", "B")
    y = b.state("y")
    b.diff("y", b.read("a", "x", "rate") - y + b.read("a", "same", "local"))
    system = System(generate(build("M", [a, b], {"a": ["a"], "b": ["b"]})))
    assert system.plan.nodes[1].sources == ((0, "state", 1), (0, "state", 0))
    assert system.plan.classes[0].outs == 0
    assert next(v for v in system.plan.variables if v.path == "a.same").elements == ((0, "state", 0),)


@pytest.mark.parametrize(("second", "kinds"), [("Car", [0, 0]), ("Truck", [0, 1])])
def test_classes_are_agents_with_equal_equations(second, kinds):
    agents = []
    for path, template in (("one", "Car"), ("two", second)):
        a = Agent(path, template)
        k = a.parameter("k", len(agents) + 1.0)
        a.diff("x", -k * a.state("x", k))
        agents.append(a)
    system = System(generate(build("M", agents, {"g": ["one", "two"]})))
    assert [node.kind for node in system.plan.nodes] == kinds
    assert system.initial() == [[1.0], [2.0]]
    assert [c.rhs.__name__ for c in system.plan.classes] == [
        f"{c}_rhs" for c in ["Car", "Truck"][: len(set(kinds))]
    ]


def test_classes_of_one_agent_with_other_equations():
    agents = []
    for k, path in enumerate(("one", "two", "three")):
        a = Agent(path, "Car")
        a.diff("x", -(1.0 + k % 2) * a.state("x", 1.0))  # a structural parameter is built in
        agents.append(a)
    system = System(generate(build("M", agents, {"g": ["one", "two", "three"]})))
    assert [node.kind for node in system.plan.nodes] == [0, 1, 0]
    assert [system.rates(0.0, [[1.0]] * 3, n) for n in range(3)] == [[-1.0], [-2.0], [-1.0]]


def test_what_one_instance_publishes_all_can():
    """An out is of the class: two of three cars are read, one by its rate."""
    agents = []
    for k in range(3):
        a = Agent(f"car{k}", "Car")
        x = a.state("x", a.parameter("x0", 1.0 * k))
        lead = a.read(f"car{k - 1}", "x", "rate") if k else None
        a.diff("x", (lead if lead is not None else 1.0 + TIME) - x)
        agents.append(a)
    system = System(generate(build("M", agents, {"g": [a.path for a in agents]})))
    assert [node.kind for node in system.plan.nodes] == [0, 1, 1]
    assert [c.outs for c in system.plan.classes] == [1, 1]
    assert system.plan.groups[0].calls == ((0, 0), (1, 0), (0, -1), (1, -1), (2, -1))


def initial_chain(order):
    """x_c starts at x_b + 1, x_b at twice x_a, x_a at 3, whatever their order in the model."""
    agents = {}
    for path, parent in (("a", None), ("b", "a"), ("c", "b")):
        agent = Agent(path, path.upper())
        value = agent.read(parent, "x") if parent else None
        start = {"a": lambda _: 3.0, "b": lambda v: 2 * v, "c": lambda v: v + 1}[path](value)
        agent.diff("x", -agent.state("x", start))
        agents[path] = agent
    return build("M", [agents[p] for p in order], {p: [p] for p in order})


@pytest.mark.parametrize(
    ("order", "start"), [("abc", None), ("acb", (0, 2, 1)), ("cba", Steps(2, -1)), ("bac", (1, 0, 2))]
)
def test_initial_values_settle_in_one_pass_in_the_order_planned(order, start):
    system = System(generate(initial_chain(order)))
    assert (system.plan.start_passes, system.plan.start_order) == (1, start)
    assert dict(zip(order, system.initial(), strict=True)) == {"a": [3.0], "b": [6.0], "c": [7.0]}


def test_initial_values_of_agents_that_need_each_other_take_passes():
    """b.y = a.x + 1 and a.z = 2 b.y: no order of the two agents will do."""
    a, b = Agent("a", "A"), Agent("b", "B")
    y = a.read("b", "y")
    a.diff("x", -a.state("x", 3.0))
    a.diff("z", -a.state("z", 2 * y))
    b.diff("y", -b.state("y", b.read("a", "x") + 1))
    system = System(generate(build("M", [a, b], {"g": ["a", "b"]})))
    assert (system.plan.start_passes, system.plan.start_order) == (2, None)
    assert system.initial() == [[3.0, 8.0], [4.0]]


def test_initial_values_of_states_and_lets_in_one_agent():
    a = Agent("a", "A")
    x = a.state("x", 2.0)
    double = a.let("double", 2 * x)
    y = a.state("y", double + 1)
    a.diff("x", -x)
    a.diff("y", -y)
    assert System(generate(build("M", [a], {"a": ["a"]}))).initial() == [[2.0, 5.0]]


def test_defaults_follow_from_earlier_parameters():
    a = Agent("a", "A")
    L = a.parameter("L", 2.0)
    k = a.parameter("k", 3 * L)
    a.diff("x", -k * a.state("x", 1.0))
    text = generate(build("M", [a], {"a": ["a"]}))
    assert System(text).q == [2.0, 6.0]
    assert System(text, {0: 5.0}).q == [5.0, 15.0]
    assert System(text, {1: 1.0}).q == [2.0, 1.0]


def test_order_of_needs():
    needs = {3: [1, 2], 2: [1], 1: [], 0: [3]}
    assert ordered([0], needs.__getitem__) == [1, 2, 3, 0]
    with pytest.raises(ValueError, match="need each other"):
        ordered([0], {0: [1], 1: [0]}.__getitem__)


def test_cyclic_definitions_are_a_bug_that_says_so():
    a = Agent("a", "A")
    a.diff("x", a.state("x"))
    a.let("l", a.rate("x"))
    a.states["x"][2] = a.let("m", a.definitions[0][1]) + 1
    a.definitions[0] = ("l", type(TIME)(e.Local(None, 1)))
    a.definitions[1] = ("m", type(TIME)(e.Local(None, 0)))
    with pytest.raises(ValueError, match="cyclic"):
        generate(build("M", [a], {"a": ["a"]}))
