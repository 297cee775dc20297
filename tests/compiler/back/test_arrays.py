"""Arrays of agents: blocks give what the same model gives element by element, and no more text when they are longer."""

import ast
import math
import sys
from dataclasses import replace
from functools import partial

import hand_arrays as models
import numpy as np
import pytest
from hand_arrays import unrolled
from oracle import Interpreter, System, generate, integers, ulps

from hierc.compiler.arrays.columns import Column, taken
from hierc.runtime import contract
from hierc.runtime.contract import Run, Steps

MODELS = {
    "platoon": lambda: models.platoon(6),
    "platoon of two": lambda: models.platoon(2),
    "platoon in one group": lambda: models.platoon(6, each=False),
    "rod": lambda: models.rod(7),
    "train": lambda: models.train(6),
    "train, back to front": lambda: models.train(6, back=True),
    "robots": lambda: models.robots(4),
    "one robot": lambda: models.robots(1),
    "mean": lambda: models.mean(5),
    "sensed": lambda: models.sensed(6),
    "swarm": lambda: models.swarm(12),
    "queue": lambda: models.queue(5),
    "mixed": lambda: models.mixed(5),
    "ladder": lambda: models.ladder(6),
    "relay": lambda: models.relay(7),
    **{f"lottery {k}": partial(models.lottery, k) for k in range(40)},
}


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]()


def some_states(system):
    return [
        [0.3 + 0.1 * math.sin(n + 2 * k) for k in range(len(system.form(n).states))]
        for n in range(len(system.nodes))
    ]


def test_blocks_give_what_single_agents_give(model):
    blocks, plain = System(generate(model)), Interpreter(unrolled(model), 0.7, [], [])
    singles = System(generate(unrolled(model)))
    plain.q, plain.states = singles.q, some_states(blocks)
    assert blocks.q == singles.q
    for n in range(len(blocks.nodes)):
        expected = plain.rates(n)
        assert all(ulps(a, b) <= 4 for a, b in zip(blocks.rates(0.7, plain.states, n), expected, strict=True))
    assert blocks.initial() == singles.initial()


def test_calls_set_every_out_before_it_is_read(model):
    blocks, singles = System(generate(model)), unrolled(model)
    states = some_states(blocks)
    plain = Interpreter(singles, 0.7, states, System(generate(singles)).q)
    seen = []
    for g, group in enumerate(blocks.groups):
        assert len(set(group.calls)) == len(group.calls)
        found = blocks.group(g, 0.7, states)
        seen += group.nodes
        assert sorted(found) == sorted(group.nodes)
        for n, rates in found.items():
            assert all(ulps(a, b) <= 4 for a, b in zip(rates, plain.rates(n), strict=True))
    assert sorted(seen) == [n for n in range(len(blocks.nodes)) if blocks.form(n).states]


def test_groups_keep_their_order(model):
    system = System(generate(model))
    order = system.plan.order
    count = len(system.groups)
    cascade = [system.groups[g].nodes for g in (range(count) if order is None else integers(order, count))]
    assert cascade == [group.nodes for group in unrolled(model).groups]


def test_elements_of_an_entry_belong_to_one_block(model):
    p = System(generate(model)).plan
    ends = [sum(node.count for node in p.nodes[: k + 1]) for k in range(len(p.nodes))]

    def block(number):
        return next(k for k, end in enumerate(ends) if number < end)

    for family in p.groups:
        for entry in (*family.nodes, *(e for e, _ in family.calls)):
            if isinstance(entry, Run):
                numbers = [
                    entry.first + k * entry.step + g * entry.shift
                    for k in range(entry.count)
                    for g in range(family.count)
                ]
            else:
                numbers = integers(entry, family.count)
            assert len({block(n) for n in numbers}) == 1


def test_results_name_what_elements_have(model):
    blocks, singles = System(generate(model)), System(generate(unrolled(model)))
    states = some_states(blocks)

    def value(system, node, kind, index):
        return states[node][index] if kind == "state" else system.observed(0.7, states, node)[index]

    expected = {v.path: [value(singles, *e) for e in v.elements] for v in singles.plan.variables}
    found = {}
    for v in blocks.plan.variables:
        at = [(integers(n, v.count), kind, integers(i, v.count)) for n, kind, i in v.elements]
        for k in range(v.count):
            path = v.path
            for index in v.indices:
                path = path.replace("[]", f"[{integers(index, v.count)[k]}]", 1)
            found[path] = [value(blocks, n[k], kind, i[k]) for n, kind, i in at]
    assert found.keys() == expected.keys()
    for path, values in found.items():
        assert values == pytest.approx(expected[path], rel=1e-15)


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4, 5], [0, 2, 4, 1, 3, 5], [5, 4, 3, 2, 1, 0]])
def test_the_order_of_groups_outlives_the_division_of_families(order):
    model = replace(models.sensed(6), order=Column(order))
    p = System(generate(model)).plan
    assert len(p.groups) == 3
    assert integers(p.order, 6) == order if p.order is not None else order == sorted(order)


def test_single_agents_that_are_called_alike_need_no_family():
    """Groups whose calls differ only in some of them stay in their order among the others."""
    model = models.sensed(7)
    shuffled = [3, 1, 4, 2, 0]
    head, family = model.groups
    mixed = replace(
        family,
        nodes=(taken(family.nodes[0], np.array([*shuffled, 5])),),
        indices=(taken(family.indices[0], np.array([*shuffled, 5])),),
    )
    system = System(generate(replace(model, groups=(head, mixed))))
    order = integers(system.plan.order, 7)
    assert [system.groups[g].nodes for g in order] == [(0,), *((int(n),) for n in mixed.nodes[0].values)]
    assert sorted(order) == list(range(7))


# ---- tables --------------------------------------------------------------------------------------


def test_a_platoon():
    p = System(generate(models.platoon(9))).plan
    assert [(node.path, node.count, node.indices) for node in p.nodes] == [
        ("lead", 1, ()),
        ("car[]", 1, (1,)),
        ("car[]", 8, (Steps(2),)),
    ]
    assert p.nodes[2].sources == ((Steps(1), "state", 0), (Steps(1), "state", 1), (Steps(1), "out", 0))
    assert [(g.name, g.nodes, g.calls, g.count) for g in p.groups] == [
        ("lead", (0,), ((0, -1),), 1),
        ("car[]", (1,), ((1, -1),), 1),
        ("car[]", (Steps(2),), ((Steps(2), -1),), 8),
    ]
    assert p.groups[2].indices == (Steps(2),)


def test_chains_of_outs_are_called_element_by_element():
    p = System(generate(models.train(9))).plan
    assert p.groups[0].nodes == (0, Run(1, 8))
    assert p.groups[0].calls == ((0, 0), (Run(1, 7), 0), (0, -1), (Run(1, 8), -1))
    p = System(generate(models.train(9, back=True))).plan
    assert p.groups[0].calls[:2] == ((0, 0), (Run(8, 7, -1), 0))


def test_chains_through_two_blocks_take_turns():
    p = System(generate(models.relay(4))).plan
    assert p.groups[0].calls == ((0, 0), (4, 0), (1, 0), (5, 0), (2, 0), (6, 0), (3, 0), (Run(4, 4), -1))


def test_families_of_groups_of_several_elements():
    p = System(generate(models.robots(5))).plan
    arm = p.groups[1]
    assert (arm.count, arm.indices) == (5, (Steps(1),))
    assert arm.nodes[-1] == Steps(25)
    assert (Steps(20), 0) in arm.calls  # the sum has no states: whoever reads it calls it


def test_a_family_that_calls_other_blocks_is_divided():
    p = System(generate(models.sensed(6))).plan
    assert [(g.count, g.indices) for g in p.groups] == [(1, (1,)), (1, (2,)), (4, (Steps(3),))]


def test_initial_values_run_against_the_order():
    p = System(generate(models.queue(6))).plan
    assert (p.start_passes, p.start_order, p.order) == (1, Steps(5, -1), Steps(5, -1))


def test_initial_values_of_elements_that_need_each_other_take_passes():
    system = System(generate(models.ladder(6)))
    x, y, z = [3.0], [4.0], [8.0]
    for _ in range(5):
        x.append(z[-1])
        y.append(x[-1] + 1)
        z.append(2 * y[-1])
    assert system.initial() == [*([a, b] for a, b in zip(x, z, strict=True)), *([b] for b in y)]
    assert system.plan.start_passes == 7  # a rung more in each, and the first post before the first rung's z


def test_the_public_face_names_blocks():
    names = System(generate(models.platoon(9))).names
    assert names["STATES"] == ("lead.v", "lead.x", "car[1..9].{x, v}")
    assert names["GROUPS"] == ("lead", "car[1..9]")
    assert names["PARAMETERS"] == ("lead.w", "car[1..9].tau", "car[1..9].k")
    assert "shape (20,)" in names["rhs"].__doc__
    assert "car[1].x, car[1].v, car[2].x" in names["rhs"].__doc__
    assert System(generate(models.swarm(5))).names["GROUPS"] == ("swarm",)
    names = System(generate(models.platoon(1 + 1, each=False))).names
    assert names["STATES"] == ("lead.v", "lead.x", "car[1..2].{x, v}")
    names = System(generate(models.robots(5))).names
    assert names["STATES"] == (
        "robot[1..5].q",
        "robot[1..5].{joint[1].z, joint[2].z, joint[3].z, tool.y}",
    )


def test_users_values_of_single_elements_stay():
    text = generate(models.platoon(4))
    tau = next(p for p in System(text).plan.parameters if p.path == "car[].tau" and p.count == 3)
    k = next(p for p in System(text).plan.parameters if p.path == "car[].k" and p.count == 3)
    q = System(text, {tau.first + 1: 0.25, k.first: 7.0}).q
    assert q[tau.first : tau.first + 3] == [0.5, 0.25, 0.5]
    assert q[k.first : k.first + 3] == [7.0, 8.0, 4.0]


# ---- size ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make", [models.platoon, models.rod, models.train, lambda n: models.platoon(n, each=False)]
)
def test_the_text_does_not_grow_with_the_elements(make):
    few, many = generate(make(10)), generate(make(1000))
    assert len(many) < 1.1 * len(few)
    assert ast.dump(ast.parse(few)).count("FunctionDef(") == ast.dump(ast.parse(many)).count("FunctionDef(")


def calls(model):
    """How many functions are called to generate a model's code."""
    count = 0

    def note(_frame, event, _argument):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        generate(model)
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize(
    "make", [models.platoon, models.rod, models.train, models.robots, lambda n: models.platoon(n, each=False)]
)
def test_the_work_does_not_grow_with_the_elements(make):
    """Apart from operations on whole columns."""
    few, many = make(10), make(10_000)
    generate(few)  # what is done once a process
    assert calls(many) < 1.1 * calls(few)


def test_columns_without_a_rule_are_packed():
    text = generate(models.swarm(400))
    p = System(text).plan
    assert isinstance(p.nodes[1].sources[0][0], contract.Packed)
    assert text == generate(models.swarm(400))
