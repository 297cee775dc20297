"""The public face of a generated module: names for its users, and functions that call the model's methods.

Names stand for whole blocks, so that the text does not grow with them: `car[1..9].{x, v}` is car[1].x, car[1].v, car[2].x and so on.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from hierc.compiler.columns import Column, Integers, taken
from hierc.compiler.elements import Elements, spelled
from hierc.compiler.emission.calls import Block
from hierc.compiler.emission.plan import Plan
from hierc.compiler.emission.runs import Members, Run
from hierc.compiler.emission.target import (
    Assign,
    Blank,
    Call,
    Constant,
    Function,
    Name,
    Return,
    Statement,
    Tuple,
)

_SIMULATE = """Simulates the model; what is not given is as in its experiment.

stop      end time [s]
rtol      relative tolerance
atol      absolute tolerance, times each state's nominal value
params    parameters by path (PARAMETERS) in their declared units, replacing their defaults
settings  start, interval, max_step, min_step, method

Returns a `hierc.runtime.result.Result`.
"""

_RHS = """The derivatives of all states, shape ({states},), at time t [s], for scipy.integrate.solve_ivp and the like.

x       states, shape ({states},), in the order of STATES, in SI units
params  parameters by path (PARAMETERS) in their declared units, replacing their defaults

NaN where an equation is not defined."""

_JACOBIAN = (
    """The derivatives of `rhs` by the states, shape ({states}, {states}), exact; arguments as for `rhs`."""
)

#: Said where a name of STATES stands for several states.
_BRACES = """

`car[1..9].{x, v}` in STATES is car[1].x, car[1].v, car[2].x, car[2].v and so on; MODEL.states lists them one by one."""

#: Names that a docstring lists; beyond that the constants have them all.
LISTED = 40


def face(plan: Plan) -> list[Statement]:
    """Names of parameters, states and groups, and what users call."""
    names = {
        "PARAMETERS": [spelled(p.path, p.indices) for p in plan.parameters],
        "STATES": _states(plan),
        "GROUPS": [spelled(group.name, group.indices) for group in plan.groups],
    }
    simulate = "\n".join([_SIMULATE, *(_listing(title, listed) for title, listed in names.items())])
    count = sum(len(plan.symbolic.forms[block.kind].states) * block.count for block in plan.nodes)
    more = _BRACES if any("{" in name for name in names["STATES"]) else ""
    return [
        *(Assign(Name(name), Tuple(tuple(map(Constant, listed)))) for name, listed in names.items()),
        *_method("simulate", ("stop", "rtol", "atol", "params"), 0, simulate, rest="settings"),
        *_method("rhs", ("t", "x", "params"), 2, _RHS.format(states=count) + more),
        *_method("jacobian", ("t", "x", "params"), 2, _JACOBIAN.format(states=count)),
    ]


def _listing(title: str, names: Sequence[str]) -> str:
    shown = ", ".join(names[:LISTED]) or "none"
    more = f", and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return textwrap.fill(
        f"{title.capitalize()}: {shown}{more}", 100, subsequent_indent="    ", break_on_hyphens=False
    )


def _method(name: str, arguments: Sequence[str], required: int, doc: str, rest: str = "") -> list[Statement]:
    """A function that calls the model's method of the same name."""
    parameters = [a if k < required else f"{a}=None" for k, a in enumerate(arguments)]
    if rest:
        parameters.append(f"**{rest}")
    call = Call(f"MODEL.{name}", tuple(Name(a) for a in arguments), rest=rest)
    return [Blank(2), Function(name, tuple(parameters), doc, (Return(call),))]


# ---- names of states --------------------------------------------------------------------------


def _states(plan: Plan) -> list[str]:
    """The names of all states, in the order of state vectors: group by group, element by element."""
    elements = Elements(block.first for block in plan.nodes)
    names: list[str] = []
    for group in plan.groups:
        entries = [_entry(plan, elements, members) for members in group.nodes]
        if group.count == 1:
            names += [name for block, inner, states in entries for name in _in_group(block, inner, states, 0)]
        else:
            depth = len(group.indices)
            inside = [
                name for block, inner, states in entries for name in _in_group(block, inner, states, depth)
            ]
            around = "[]".join(entries[0][0].path.split("[]", depth)[:depth]) + "[]" * (depth > 0)
            names.append(_joined(spelled(around, group.indices), inside))
    return names


def _entry(plan: Plan, elements: Elements, members: Members) -> tuple[Block, Integers, tuple[str, ...]]:
    """The block of an entry, where its elements in the first group stand there, and the names of their states."""
    match members:
        case Run(first=first, count=count, step=step):
            numbers = first + step * np.arange(count)
        case Column(values=values):
            numbers = values[:1]
        case number:
            numbers = np.array([number])
    block = plan.nodes[elements.block(int(numbers[0]))]
    return block, numbers - block.first, plan.symbolic.forms[block.kind].states


def _in_group(block: Block, places: Integers, states: Sequence[str], depth: int) -> list[str]:
    """The states of elements in a row; the first `depth` indices are said already."""
    rest = "".join(block.path.split("[]", depth)[depth:]).lstrip(".") if depth else block.path
    path = spelled(rest, [taken(index, places) for index in block.indices[depth:]])
    if len(places) > 1:
        return [_joined(path, states)]
    return [f"{path}.{state}" if path else state for state in states]


def _joined(path: str, names: Sequence[str]) -> str:
    """One name for several states of each element."""
    return f"{path}.{names[0]}" if len(names) == 1 else f"{path}.{{{', '.join(names)}}}"
