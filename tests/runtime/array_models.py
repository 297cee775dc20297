"""Arrays of agents as hand-written plans, and the same models written agent by agent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from small_models import OSCILLATOR, a_class, function

from hierc.runtime.contract import (
    CONTRACT,
    Class,
    Defaults,
    Experiment,
    Group,
    Index,
    Members,
    Node,
    Parameter,
    Plan,
    Run,
    Steps,
    Variable,
)
from hierc.runtime.elements import Elements, expand, expanded, numbered
from hierc.runtime.model import Model

#: A car behind another: reads its place and speed, and the leader's speed; its own actuator has a time constant and a gain.
CAR = a_class(
    "Car",
    {
        "x": "x[1]",
        "v": "x[2]",
        "a": "(x[3] - x[2])*p[0]",
        "u": "p[1]*(1.0*(u[0] - x[0] - 10.0) + 1.5*(u[1] - x[1]) + 0.2*(u[2] - x[1]) - x[3])",
    },
    {
        (0, 1): "1.0",
        (1, 2): "1.0",
        (2, 2): "-p[0]",
        (2, 3): "p[0]",
        (3, 0): "-1.0*p[1]",
        (3, 1): "-1.7*p[1]",
        (3, 3): "-p[1]",
        (3, 4): "p[1]",
        (3, 5): "1.5*p[1]",
        (3, 6): "0.2*p[1]",
        (4, 0): "1.0",
        (4, 4): "-1.0",
    },
    start=["p[2]", "0.0", "0.0", "0.0"],
    inputs=3,
    values=["1.0/q[0]", "q[1]", "-20.0*q[2]"],
    outs=[("u[0] - x[0]", (0,))],
    observed=["u[0] - x[0]", "u[2]*x[1]"],
)
LEADER = a_class(
    "Leader",
    {"x": "x[1]", "v": "(p[0]*(1.0 - math.exp(-t/20.0)) - x[1])/5.0"},
    {(0, 1): "1.0", (1, 1): "-1.0/5.0"},
    start=["0.0", "0.0"],
    values=["q[0]"],
)


def plan_of(
    classes: Sequence[Class], nodes: Sequence[Node], groups: Sequence[Group], **tables: object
) -> Plan:
    """A plan around some tables; parameters without a default stay as given."""
    given = {
        "parameters": (),
        "parameter_count": 0,
        "parameters_function": function("defaults", "q", []),
        "variables": (),
        "start_passes": 1,
        "experiment": Experiment(settings={"stop": 10.0}),
    }
    return Plan(
        contract=CONTRACT,
        hierc="0",
        name="Array",
        doc="",
        source="array.hier",
        digest="0",
        classes=tuple(classes),
        nodes=tuple(nodes),
        groups=tuple(groups),
        **{**given, **tables},  # type: ignore[arg-type]
    )


def platoon(count: int, *, order: bool = False) -> Plan:
    """A leader and `count` cars in two blocks, each a group: `car[1]`, which follows the leader, and the others.

    The parameter vector: the leader's speed, then tau and ka of each car, then the cars' indices as constants.
    """
    cars = 3 * count
    rest = count - 1

    def parameters(first: int) -> tuple[Index, ...]:
        return Steps(1 + first, 1), Steps(1 + count + first, 1), Steps(1 + 2 * count + first, 1)

    ahead = Steps(1, 1)
    second = (
        (ahead, "state", 0),
        (ahead, "state", 1),
        (0, "state", 1),
    )
    nodes = (
        Node("lead", 0, (0,), ()),
        Node("car[]", 1, parameters(0), ((0, "state", 0), (0, "state", 1), (0, "state", 1)), 1, (1,)),
        Node("car[]", 1, parameters(1), second, rest, (Steps(2),)),
    )
    groups = (
        Group("lead", (0,), ((0, -1),)),
        Group("car[]", (1,), ((1, -1),), 1, (1,)),
        Group("car[]", (Steps(2),), ((Steps(2), -1),), rest, (Steps(2),)),
    )
    own = ((Steps(1), "state"), (Steps(1), "state"), (Steps(1), "observed"), (Steps(1), "observed"))
    variables = (
        Variable("lead.v", (), ((0, "state", 1),)),
        *(
            Variable(f"car[].{name}", (), ((*where, k),), None, "", access, 1.0, count, (Steps(1),))
            for (name, k, access), where in zip(
                (("x", 0, "write"), ("v", 1, "write"), ("gap", 0, "write"), ("power", 1, "private")),
                own,
                strict=True,
            )
        ),
    )
    # ka = 20 + 180 i/count, where it is not given, from the index.
    gains = function("gains", "a, v", ["if v[0] != v[0]:", f"    v[0] = 20.0 + 180.0*a[0]/{count}.0"])
    lags = function("lags", "a, v", ["if v[0] != v[0]:", "    v[0] = 0.3/(1.0 + math.fmod(a[0], 7.0))"])
    permuted = None
    if order:  # the same cascade, its groups numbered the other way round
        groups = (groups[2], groups[1], groups[0])
        permuted = (count, count - 1, *range(count - 1)) if count > 1 else None
    return plan_of(
        (LEADER, CAR),
        nodes,
        groups,
        parameters=(
            Parameter("lead.v_max", (), 0),
            Parameter("car[].tau", (), 1, "ms", scale=1e-3, count=count, indices=(Steps(1),)),
            Parameter("car[].ka", (), 1 + count, count=count, indices=(Steps(1),)),
        ),
        parameter_count=1 + cars,
        parameters_function=function("defaults", "q", ["if q[0] != q[0]:", "    q[0] = 25.0"]),
        constants=((1 + 2 * count, count, Steps(1)),),
        defaults=(
            Defaults(lags, (Steps(1 + 2 * count),), (Steps(1),), count),
            Defaults(gains, (Steps(1 + 2 * count),), (Steps(1 + count),), count),
        ),
        variables=variables,
        order=permuted,
    )


def chain(count: int, *, one_group: bool) -> Plan:
    """Masses on springs, each pulled by both neighbours, the ends fixed: one group of `count` elements."""
    kinds = [
        a_class(
            f"Mass{left}{right}",
            {"x": "x[1]", "v": f"p[0]*({_pull(left, right)} - 2.0*x[0]) - 0.1*x[1]"},
            {
                (0, 1): "1.0",
                (1, 0): "-2.0*p[0]",
                (1, 1): "-0.1",
                **{(1, 2 + k): "p[0]" for k in range(left + right)},
            },
            start=["p[1]", "0.0"],
            inputs=left + right,
            values=["q[0]", "math.sin(q[1])"],
        )
        for left, right in ((0, 1), (1, 1), (1, 0))
    ]
    inner = count - 2
    own: Members = Run(0, count)
    assert one_group
    nodes = (
        Node("mass[]", 0, (0, 1), ((1, "state", 0),), 1, (1,)),
        Node(
            "mass[]", 1, (0, Steps(2)), ((Steps(0), "state", 0), (Steps(2), "state", 0)), inner, (Steps(2),)
        ),
        Node("mass[]", 2, (0, count), ((count - 2, "state", 0),), 1, (count,)),
    )
    return plan_of(
        kinds,
        nodes,
        (Group("mass", (own,), ((own, -1),)),),
        parameters=(Parameter("k", (), 0),),
        parameter_count=1 + count,
        parameters_function=function("defaults", "q", ["if q[0] != q[0]:", "    q[0] = 30.0"]),
        constants=((1, count, Steps(1)),),
        variables=(
            Variable("mass[].x", (), ((Steps(0), "state", 0),), count=count, indices=(Steps(1),)),
            Variable("mass[].v", (), ((Steps(0), "state", 1),), count=count, indices=(Steps(1),)),
        ),
    )


def _pull(left: int, right: int) -> str:
    return " + ".join(f"u[{k}]" for k in range(left + right))


def robots(arms: int, links: int) -> Plan:
    """`arms` robots of `links` links each, a link turned by the one before it, the first by an oscillator; a group a robot.

    `robot[].link[].q` is a vector of two: the angle, and what it follows.
    """
    link = a_class(
        "Link",
        {"q[1]": "p[0]*(u[0] - x[0])", "q[2]": "x[0] - x[1]"},
        {(0, 0): "-p[0]", (0, 2): "p[0]", (1, 0): "1.0", (1, 1): "-1.0"},
        start=["0.0", "1.0"],
        inputs=1,
        values=["q[0]"],
        observed=["2.0*u[0]"],
    )
    total = arms * links
    robot = tuple(np.repeat(np.arange(1, arms + 1), links).tolist())
    number = tuple(np.tile(np.arange(1, links + 1), arms).tolist())
    before = tuple(0 if k == 1 else e for e, k in enumerate(number))  # element e + 1 follows element e
    indices = (robot, number)
    nodes = (
        Node("base", 0, (0,), ()),
        Node("robot[].link[]", 1, (Steps(1),), ((before, "state", 0),), total, indices),
    )
    members = Run(1, links, 1, links)
    return plan_of(
        (OSCILLATOR, link),
        nodes,
        (
            Group("base", (0,), ((0, -1),)),
            Group("robot[]", (members,), ((members, -1),), arms, (Steps(1),)),
        ),
        parameters=(
            Parameter("base.w", (), 0),
            Parameter("robot[].link[].k", (), 1, count=total, indices=indices),
        ),
        parameter_count=1 + total,
        parameters_function=function(
            "defaults",
            "q",
            [
                "if q[0] != q[0]:",
                "    q[0] = 2.0",
                *(
                    line
                    for k in range(1, 1 + total)
                    for line in (f"if q[{k}] != q[{k}]:", f"    q[{k}] = {5.0 + k}")
                ),
            ],
        ),
        variables=(
            Variable("base.c", (), ((0, "state", 0),)),
            Variable(
                "robot[].link[].q",
                (2,),
                ((Steps(1), "state", 0), (Steps(1), "state", 1)),
                "rad",
                count=total,
                indices=indices,
            ),
            Variable("robot[].link[].told", (), ((Steps(1), "observed", 0),), count=total, indices=indices),
        ),
    )


def one_by_one(plan: Plan) -> Plan:
    """The same model with every element a block and every group an entry of its own, in cascade order."""
    known = expand(plan)
    nodes = tuple(_single(known, e) for e in range(known.count))
    groups = []
    for place in range(known.groups):
        family = known.families[known.family[place]]
        row = int(np.flatnonzero(family.places == place)[0])
        calls = zip(family.calls[row].tolist(), family.parts.tolist(), strict=True)
        groups.append(Group(known.group_name(place), tuple(family.nodes[row].tolist()), tuple(calls)))
    variables = [v for each in plan.variables for v in _singles(each)]
    parameters = [
        replace(
            p,
            path=numbered(p.path, (int(column[k]) for column in _table(p.indices, p.count))),
            first=p.first + k * int(np.prod(p.shape, dtype=int)),
            count=1,
            indices=(),
        )
        for p in plan.parameters
        for k in range(p.count)
    ]
    order = None
    if plan.start_order is not None:
        order = tuple(expanded(plan.start_order, known.count).tolist())
    return replace(
        plan,
        nodes=nodes,
        groups=tuple(groups),
        variables=tuple(variables),
        parameters=tuple(parameters),
        order=None,
        start_order=order,
    )


def _single(known: Elements, element: int) -> Node:
    block, row = known.row(element)
    sources = tuple((e, what, k) for e, what, k in known.read_by(element, -1))
    node = known.plan.nodes[int(known.block[element])]
    path = numbered(node.path, (int(column[row]) for column in _table(node.indices, node.count)))
    return Node(path, block.kind, tuple(block.parameters[row].tolist()), sources)  # type: ignore[arg-type]


def _singles(v: Variable) -> list[Variable]:
    found = []
    for k in range(v.count):
        elements = tuple(
            (int(expanded(e, v.count)[k]), what, int(expanded(i, v.count)[k])) for e, what, i in v.elements
        )
        path = numbered(v.path, (int(column[k]) for column in _table(v.indices, v.count)))
        found.append(replace(v, path=path, elements=elements, count=1, indices=()))
    return found


def _table(indices: Sequence[Index], count: int) -> list[NDArray[np.int64]]:
    return [expanded(index, count) for index in indices]


def a_model(plan: Plan) -> Model:
    """The runnable model of a plan."""
    return Model(plan)
