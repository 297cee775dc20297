"""What a generated module contains: the contract between compiler and runtime.

A generated module is plain Python. It defines scalar functions (three-address assignments, `if`s, `math` calls) and the tables below, and
ends with a `Model`. The functions take these arguments; all arrays are of floats, indexed by integer constants:

    t   time                                  x   states of the node (n)        u   its inputs (m)
    d   discrete variables (none yet)         p   the class's values (k)        q   the node's parameters (l)

    rhs(t, x, u, d, p, dx)     derivatives of the states
    out(t, x, u, d, p, y)      one part of what other nodes read (`Part.outs` of y); a part needs only the inputs `Part.inputs`
    observe(t, x, u, d, p, y)  every algebraic variable of the node, for results
    jac(t, x, u, d, p, J)      nonzeros of d(rhs, outs)/d(x, u), in the order of `Class.pattern`
    values(q, p)               everything that depends on parameters alone
    start(t, u, p, x)          initial values of the states; `u` holds the inputs' initial values

The same text runs under CPython and, lowered to machine code, in the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

#: Version of this contract; a module made for another one is refused with a message.
CONTRACT = 1

Function = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Part:
    """One `out` function: it sets outputs `outs` of the class and needs only the inputs `inputs`."""

    function: Function
    outs: tuple[int, ...]
    inputs: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Class:
    """The functions that nodes of equal form share.

    `pattern` lists the Jacobian's nonzeros as (row, column): rows are the n states' derivatives, then the outs; columns the n states, then
    the m inputs. `flops` counts operations of rhs (elementary functions count 20). `lines` gives the source line of each state's
    differential equation.
    """

    name: str
    states: tuple[str, ...]
    inputs: int
    parameters: int
    values: int
    outs: int
    observed: int
    rhs: Function
    parts: tuple[Part, ...]
    observe: Function | None
    jac: Function
    pattern: tuple[tuple[int, int], ...]
    start: Function
    fill: Function  # the `values` function
    nominal: Function  # nominal(p, w): error scale of each state
    flops: int
    lines: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Node:
    """An instance of a class. `sources[k]` says where input k comes from: (node, "state" | "out", index)."""

    path: str
    kind: int  # index into Model.classes
    parameters: tuple[int, ...]  # indices into the parameter vector: the node's q
    sources: tuple[tuple[int, Literal["state", "out"], int], ...]


@dataclass(frozen=True, slots=True)
class Group:
    """A subsystem with its own step size.

    `nodes` have the group's states, concatenated in this order. `calls` are what one evaluation does, in order: (node, part) for an out
    part, (node, -1) for a right-hand side. Calls may name nodes without states, which belong to no group.
    """

    name: str
    nodes: tuple[int, ...]
    calls: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of one agent instance; scalars `first`, `first + 1`, … of the parameter vector, row by row.

    The vector is in SI. Values given by path are in `unit`, one of which is `scale` in SI.
    """

    path: str
    shape: tuple[int, ...]
    first: int
    unit: str | None = None
    doc: str = ""
    structural: bool = False
    kind: Literal["real", "int", "bool"] = "real"
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable that results know by name: its scalars as (node, "state" | "observed", index), row by row.

    The scalars are in SI. Results show values in `unit`, one of which is `scale` in SI.
    """

    path: str
    shape: tuple[int, ...]
    elements: tuple[tuple[int, Literal["state", "observed"], int], ...]
    unit: str | None = None
    doc: str = ""
    access: Literal["write", "private", "read"] = "write"
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Experiment:
    """Default settings of a run. Keys of `settings` and of each group's: stop start rtol atol interval max_step min_step method."""

    name: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    groups: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    record: tuple[str, ...] = ()
    save: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """All tables of a generated module.

    `parameters_function(q)` replaces each NaN in the parameter vector by its default (in dependency order), so values given by the user stay.
    `start_passes`: how often the `start` functions run over all nodes in order until every initial value is final (1 unless initial values
    refer to each other across nodes against the order).
    """

    contract: int
    hierc: str
    name: str
    doc: str
    source: str  # file name of the model
    digest: str  # sha256 of the source text(s)
    classes: tuple[Class, ...]
    nodes: tuple[Node, ...]  # in execution order
    groups: tuple[Group, ...]  # in cascade order
    parameters: tuple[Parameter, ...]
    parameter_count: int
    parameters_function: Function
    variables: tuple[Variable, ...]
    start_passes: int
    experiment: Experiment
