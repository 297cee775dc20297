"""The public face of a generated module: names for its users, and functions that call the model's methods.

Names stand for whole blocks, so that the text does not grow with them: `car[1..9].{x, v}` is car[1].x, car[1].v, car[2].x and so on.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, column, expanded, taken
from hierc.compiler.arrays.elements import Elements, spelled
from hierc.compiler.emission.calls import Group
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
        "PARAMETERS": _alike((p.path, p.indices) for p in plan.parameters),
        "STATES": _states(plan),
        "GROUPS": _alike((group.name, group.indices) for group in plan.groups),
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


# ---- names ----------------------------------------------------------------------------------


def _alike(named: Iterable[tuple[str, tuple[Index, ...]]]) -> list[str]:
    """Names of several blocks, each path once."""
    found: dict[str, tuple[Index, ...]] = {}
    for path, indices in named:
        found[path] = _joined(found[path], indices) if path in found else indices
    return [spelled(path, indices) for path, indices in found.items()]


def _joined(first: Sequence[Index], second: Sequence[Index]) -> tuple[Index, ...]:
    """The indices of elements of two blocks."""
    sizes = [max((len(i) for i in some if isinstance(i, Column)), default=1) for some in (first, second)]
    return tuple(
        column(np.concatenate([expanded(a, sizes[0]), expanded(b, sizes[1])]))
        for a, b in zip(first, second, strict=True)
    )


@dataclass(frozen=True, slots=True)
class _Elements:
    """Elements in a row, with the names of what each of them has."""

    path: str
    indices: tuple[Index, ...]
    names: tuple[str, ...]

    def followed(self, other: _Elements) -> _Elements | None:
        """Both as one, if they are elements of one array in the order of its index."""
        match self.indices, other.indices:
            case (before,), (after,) if (self.path, self.names) == (other.path, other.names):
                if np.max(expanded(before, 1)) < np.min(expanded(after, 1)):
                    return replace(self, indices=_joined(self.indices, other.indices))
        return None

    def shown(self) -> list[str]:
        """A name for each state of a single element; one name for all of several."""
        path = spelled(self.path, self.indices)
        if all(isinstance(i, int) for i in self.indices):
            return [f"{path}.{name}" if path else name for name in self.names]
        return [f"{path}.{self.names[0]}" if len(self.names) == 1 else f"{path}.{{{', '.join(self.names)}}}"]


def _states(plan: Plan) -> list[str]:
    """The names of all states, in the order of state vectors: group by group, element by element."""
    elements = Elements(block.first for block in plan.nodes)
    found: list[_Elements] = []
    for group in plan.groups:
        inside = [entry for members in group.nodes if (entry := _entry(plan, elements, members)).names]
        for some in inside if group.count == 1 or not inside else [_family(group, inside)]:
            joined = found[-1].followed(some) if found else None
            found[-1:] = [joined] if joined else [*found[-1:], some]
    return [name for some in found for name in some.shown()]


def _entry(plan: Plan, elements: Elements, members: Members) -> _Elements:
    """An entry of a group, or of the first group of a family."""
    match members:
        case Run(first=first, count=count, step=step):
            numbers = first + step * np.arange(count)
        case Column(values=values):
            numbers = values[:1]
        case number:
            numbers = np.array([number])
    block = plan.nodes[elements.block(int(numbers[0]))]
    indices = tuple(taken(index, numbers - block.first) for index in block.indices)
    return _Elements(block.path, indices, plan.symbolic.forms[block.kind].states)


def _family(group: Group, inside: Sequence[_Elements]) -> _Elements:
    """All groups of a family; what is in one of them is named without the family's own indices."""
    depth = len(group.indices)
    around = inside[0].path.split("[]", depth)[:depth]
    names = []
    for some in inside:
        rest = "".join(some.path.split("[]", depth)[depth:]).lstrip(".")
        names += _Elements(rest, some.indices[depth:], some.names).shown()
    return _Elements("".join(f"{part}[]" for part in around), group.indices, tuple(names))
