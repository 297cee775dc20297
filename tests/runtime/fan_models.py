"""Fan-ins as hand-written plans: many oscillators, joined by trees of nodes without states, and two groups that read these trees."""

from __future__ import annotations

from array_models import plan_of
from small_models import OSCILLATOR, a_class, function

from hierc.runtime.contract import Group, Index, Members, Node, Parameter, Plan, Run, Steps, Variable

#: Each is worth something else: a value of its own, its own input, and the time.
_EACH = a_class(
    "Each",
    {},
    {(0, 0): "2.0*p[0]*u[0]"},
    inputs=1,
    values=["q[0]"],
    outs=[("p[0]*u[0]*u[0] + math.sin(t + p[0])", (0,))],
)
_SUM = a_class(
    "Sum",
    {},
    {(0, k): "1.0" for k in range(4)},
    inputs=4,
    outs=[("u[0] + u[1] + (u[2] + u[3])", (0, 1, 2, 3))],
)
_TOP = a_class(
    "Top",
    {},
    {(0, 0): "1.0 if u[0] > u[1] else 0.0", (0, 1): "0.0 if u[0] > u[1] else 1.0"},
    inputs=2,
    outs=[("u[0] if u[0] > u[1] else u[1]", (0, 1))],
)
#: Joins a state with a fan-in: not of inputs alone.
_MIX = a_class("Mix", {}, {(0, 0): "u[1]", (0, 1): "u[0]"}, inputs=2, outs=[("u[0]*u[1]", (0, 1))])
_READER = a_class(
    "Reader",
    {"x": "0.05*u[0] - 2.0*x[0]", "y": "u[1] - x[1]"},
    {(0, 0): "-2.0", (0, 2): "0.05", (1, 1): "-1.0", (1, 3): "1.0", (2, 0): "u[1]", (2, 3): "x[0]"},
    start=["1.0", "0.0"],
    inputs=2,
    outs=[("x[0]*u[1]", (1,))],
)
_LAST = a_class(
    "Last",
    {"z": "p[0]*(u[0] + 0.01*u[1] - x[0])"},
    {(0, 0): "-p[0]", (0, 1): "p[0]", (0, 2): "0.01*p[0]"},
    start=["0.3"],
    inputs=2,
    values=["q[0]"],
)


def fan(depth: int, *, shared: bool = False) -> Plan:
    """4**depth oscillators; `reader` joins what each is worth and finds the largest, `last` joins the same and reads what the reader publishes.

    Where they are `shared`, both are groups of their own, without states. Parameters: each oscillator's frequency and worth, then the last one's rate.
    """
    count = 4**depth
    nodes = [
        Node("osc[]", 0, (Steps(0),), (), count, (Steps(1),)),
        Node("each[]", 1, (Steps(count),), ((Steps(0), "state", 0),), count, (Steps(1),)),
    ]
    total = _layers(nodes, 2, 4, count, "out")
    summing: list[tuple[Members, int]] = [(Run(node[0], node[1]), 0) for node in _ranges(nodes)[1:]]
    top = _layers(nodes, 3, 2, 0, "state")
    finding: list[tuple[Members, int]] = [
        (Run(first, many), 0) for first, many in _ranges(nodes)[1 + len(summing) :]
    ]
    mix, reader, last = top + 1, top + 2, top + 3
    nodes += [
        Node("mix", 4, (), ((reader, "state", 0), (total, "out", 0))),
        Node("reader", 5, (), ((mix, "out", 0), (top, "out", 0))),
        Node("last", 6, (2 * count,), ((reader, "out", 0), (total, "out", 0))),
    ]
    numbers: Index = Steps(1)
    made = (
        Group("reader", (reader,), (*summing, *finding, (mix, 0), (reader, -1))),
        Group("last", (last,), (*summing, (last, -1))),
    )
    if shared:
        made = (
            Group("total", (total,), tuple(summing)),
            Group("largest", (top,), tuple(finding)),
            Group("reader", (reader,), ((mix, 0), (reader, -1))),
            Group("last", (last,), ((last, -1),)),
        )
    return plan_of(
        (OSCILLATOR, _EACH, _SUM, _TOP, _MIX, _READER, _LAST),
        nodes,
        (
            Group("osc[]", (Steps(0),), ((Steps(0), -1),), count, (numbers,)),
            *made,
        ),
        parameters=(
            Parameter("osc[].w", (), 0, count=count, indices=(numbers,)),
            Parameter("each[].k", (), count, count=count, indices=(numbers,)),
            Parameter("last.rate", (), 2 * count),
        ),
        parameter_count=2 * count + 1,
        parameters_function=function(
            "defaults",
            "q",
            [
                *(f"q[{k}] = {1.0 + 0.37 * (k % 5)} if q[{k}] != q[{k}] else q[{k}]" for k in range(count)),
                *(
                    f"q[{k}] = {0.3 + 0.11 * (k % 7)} if q[{k}] != q[{k}] else q[{k}]"
                    for k in range(count, 2 * count)
                ),
                f"q[{2 * count}] = 40.0 if q[{2 * count}] != q[{2 * count}] else q[{2 * count}]",
            ],
        ),
        variables=(
            Variable("reader.x", (), ((reader, "state", 0),)),
            Variable("last.z", (), ((last, "state", 0),)),
        ),
    )


def _layers(nodes: list[Node], kind: int, width: int, first: int, what: str) -> int:
    """Add layers of nodes that join `width` each of what the elements from `first` on have; the last one's number."""
    count = _ranges(nodes)[0][1]
    while count > 1:
        sources = tuple((Steps(first + k, width), what, 0) for k in range(width))
        here = sum(node.count for node in nodes)
        count //= width
        nodes.append(Node("join[]", kind, (), sources, count, (Steps(1),)))  # type: ignore[arg-type]
        first, what = here, "out"
    return first


def _ranges(nodes: list[Node]) -> list[tuple[int, int]]:
    """(first element, count) of each block."""
    found, first = [], 0
    for node in nodes:
        found.append((first, node.count))
        first += node.count
    return found
