"""Small generated-style models, written out: classes from lines of text, nodes, groups, and the plan around them."""

from __future__ import annotations

import itertools
import linecache
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from hierc.runtime.contract import CONTRACT, Class, Experiment, Group, Node, Parameter, Part, Plan, Variable
from hierc.runtime.elements import Elements, expand
from hierc.runtime.model import Model

_NUMBERS = itertools.count()
Source = tuple[int, Literal["state", "out"], int]


def function(name: str, arguments: str, lines: Sequence[str]) -> Callable[..., None]:
    """A function whose text `inspect` finds, as that of a module's function."""
    body = "".join(f"    {line}\n" for line in lines) or "    pass\n"
    text = f"def {name}({arguments}):\n{body}"
    file = f"<model {next(_NUMBERS)}>"
    linecache.cache[file] = (len(text), None, text.splitlines(True), file)
    names: dict[str, Any] = {"math": math}
    exec(compile(text, file, "exec"), names)
    made: Callable[..., None] = names[name]
    return made


def stores(output: str, values: Sequence[str], first: Sequence[str] = ()) -> list[str]:
    """Lines that set the entries of an array."""
    return [*first, *(f"{output}[{k}] = {value}" for k, value in enumerate(values))]


def a_class(
    name: str,
    rhs: Mapping[str, str],
    jac: Mapping[tuple[int, int], str] | None = None,
    *,
    start: Sequence[str] | None = None,
    inputs: int = 0,
    values: Sequence[str] = (),
    outs: Sequence[tuple[str, tuple[int, ...]]] = (),
    observed: Sequence[str] = (),
    nominal: Sequence[str] | None = None,
    first: Sequence[str] = (),
    flops: int = 10,
) -> Class:
    """A class from expressions: `rhs` by state; `jac` by (row, column); each out with the inputs that it reads, a part of its own.

    `first` are lines before those of `rhs` and `jac`; `values` are expressions of q.
    """
    jac = dict(sorted((jac or {}).items()))
    signature = "t, x, u, d, p, "
    parts = tuple(
        Part(function(f"{name}_out{k}", signature + "y", [f"y[{k}] = {value}"]), (k,), reads)
        for k, (value, reads) in enumerate(outs)
    )
    n = len(rhs)
    return Class(
        name=name,
        states=tuple(rhs),
        inputs=inputs,
        parameters=0,
        values=len(values),
        outs=len(outs),
        observed=len(observed),
        rhs=function(f"{name}_rhs", signature + "dx", stores("dx", list(rhs.values()), first)),
        parts=parts,
        observe=function(f"{name}_observe", signature + "y", stores("y", observed)) if observed else None,
        jac=function(f"{name}_jac", signature + "J", stores("J", list(jac.values()), first)),
        pattern=tuple(jac),
        start=function(f"{name}_start", "t, u, p, x", stores("x", start or ["0.0"] * n)),
        fill=function(f"{name}_values", "q, p", stores("p", values)),
        nominal=function(f"{name}_nominal", "p, w", stores("w", nominal or ["1.0"] * n)),
        flops=flops,
        lines=tuple(range(10, 10 + n)),
    )


@dataclass(frozen=True, slots=True)
class At:
    """A node in the making: its class, what its inputs read, and how many parameters it has of its own."""

    kind: Class
    sources: tuple[Source, ...] = ()
    parameters: int = 0


def a_plan(
    nodes: Mapping[str, At],
    groups: Mapping[str, Sequence[str]] | None = None,
    parameters: Mapping[str, float] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Plan:
    """The plan of some nodes, in execution order; without `groups`, one group for each node that has states.

    `parameters` are taken by the nodes in turn, each as many as it has.
    """
    parameters = dict(parameters or {})
    kinds = list(dict.fromkeys(at.kind for at in nodes.values()))
    index = {path: k for k, path in enumerate(nodes)}
    free = itertools.count()
    made = tuple(
        Node(path, kinds.index(at.kind), tuple(itertools.islice(free, at.parameters)), at.sources)
        for path, at in nodes.items()
    )
    if groups is None:
        groups = {path: [path] for path, at in nodes.items() if at.kind.states}
    lines = [
        line
        for k, value in enumerate(parameters.values())
        for line in (f"if q[{k}] != q[{k}]:", f"    q[{k}] = {value!r}")
    ]
    variables = tuple(
        Variable(f"{path}.{name}", (), ((index[path], what, k),))
        for path, at in nodes.items()
        for what, names in (
            ("state", at.kind.states),
            ("observed", [f"y{k}" for k in range(at.kind.observed)]),
        )
        for k, name in enumerate(names)
    )
    plan = Plan(
        contract=CONTRACT,
        hierc="0",
        name="Small",
        doc="",
        source="small.hier",
        digest="0",
        classes=tuple(kinds),
        nodes=made,
        groups=tuple(Group(name, tuple(index[p] for p in paths), ()) for name, paths in groups.items()),
        parameters=tuple(Parameter(path, (), k) for k, path in enumerate(parameters)),
        parameter_count=len(parameters),
        parameters_function=function("defaults", "q", lines),
        variables=variables,
        start_passes=1,
        experiment=Experiment(settings=settings or {}),
    )
    home = {n for g in plan.groups for n in g.nodes}
    elements = expand(plan)
    return replace(plan, groups=tuple(_with_calls(plan, elements, g, home) for g in plan.groups))


def _with_calls(plan: Plan, elements: Elements, group: Group, home: set[int]) -> Group:
    """The group with its calls: the outs of its own or of stateless nodes that it needs, and of those of them that it has, then its right-hand sides."""
    own = set(group.nodes)
    moving = [n for n in group.nodes if plan.classes[plan.nodes[n].kind].states]

    def inside(node: int) -> bool:
        return node in own or node not in home

    wanted = [
        (n, k) for m in group.nodes for n, what, k in plan.nodes[m].sources if what == "out" and inside(n)
    ]
    wanted += [(n, k) for n in own.difference(moving) for k in range(plan.classes[plan.nodes[n].kind].outs)]
    calls = elements.order_parts(wanted, inside)
    return replace(group, calls=(*calls, *((n, -1) for n in moving)))


def a_model(*args: Any, **kwargs: Any) -> Model:
    """The runnable model of `a_plan`."""
    return Model(a_plan(*args, **kwargs))


# ---- classes that several tests use ------------------------------------------------------------

DECAY = a_class("Decay", {"x": "-p[0]*x[0]"}, {(0, 0): "-p[0]"}, start=["1.0"], values=["q[0]"])
OSCILLATOR = a_class(
    "Oscillator",
    {"c": "-p[0]*x[1]", "s": "p[0]*x[0]"},
    {(0, 1): "-p[0]", (1, 0): "p[0]"},
    start=["1.0", "0.0"],
    values=["q[0]"],
)
#: Follows its input: x' = rate (u - x).
FOLLOWER = a_class(
    "Follower",
    {"x": "p[0]*(u[0] - x[0])"},
    {(0, 0): "-p[0]", (0, 1): "p[0]"},
    start=["0.0"],
    inputs=1,
    values=["q[0]"],
)
PENDULUM = a_class(
    "Pendulum",
    {"angle": "x[1]", "rate": "-math.sin(x[0])"},
    {(0, 1): "1.0", (1, 0): "-math.cos(x[0])"},
    start=["2.0", "0.0"],
)
VAN_DER_POL = a_class(
    "VanDerPol",
    {"x": "x[1]", "v": "p[0]*((1.0 - x[0]*x[0])*x[1]) - x[0]"},
    {(0, 1): "1.0", (1, 0): "-2.0*p[0]*x[0]*x[1] - 1.0", (1, 1): "p[0]*(1.0 - x[0]*x[0])"},
    start=["2.0", "0.0"],
    values=["q[0]"],
)
#: A driven, nonlinear arm whose outs go through each other: y0 from the states, y1 from the states and an input.
ARM = a_class(
    "Arm",
    {
        "a": "x[1] + 0.1*math.sin(x[2])",
        "b": "-p[0]*x[0] - p[1]*x[1]*math.fabs(x[1]) + u[0]*math.cos(t)",
        "c": "(u[1] - x[2])*(1.0 + x[0]*x[0])",
    },
    {
        (0, 1): "1.0",
        (0, 2): "0.1*math.cos(x[2])",
        (1, 0): "-p[0]",
        (1, 1): "-2.0*p[1]*math.fabs(x[1])",
        (1, 3): "math.cos(t)",
        (2, 0): "2.0*x[0]*(u[1] - x[2])",
        (2, 2): "-(1.0 + x[0]*x[0])",
        (2, 4): "1.0 + x[0]*x[0]",
        (3, 0): "math.cos(x[0])*x[1]",
        (3, 1): "math.sin(x[0])",
        (4, 2): "u[1]",
        (4, 4): "x[2]",
    },
    start=["0.3", "0.1", "-0.2"],
    inputs=2,
    values=["q[0]", "q[0]*q[1]"],
    outs=[("math.sin(x[0])*x[1]", ()), ("x[2]*u[1]", (1,))],
    observed=["x[0]*x[1]"],
)
#: Without states: the sum and the product of its inputs.
MIXER = a_class(
    "Mixer",
    {},
    {(0, 0): "1.0", (0, 1): "1.0", (1, 0): "u[1]", (1, 1): "u[0]"},
    inputs=2,
    outs=[("u[0] + u[1]", (0, 1)), ("u[0]*u[1]", (0, 1))],
)
