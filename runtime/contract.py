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

They may call tables and externs of the module by name, with floats, each call the whole of an assignment to a local name.

The same text runs under CPython and, lowered to machine code, in the kernel.

An array of agents is never expanded in the text: a `Node` is a *block* of `count` elements, which differ only in what they read and in their
parameters. Those are columns (`Index`): an integer for all, or one for each element. Elements are numbered through all blocks, in the order of
`Plan.nodes`; wherever a table names a node, it means such a number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from hierc.runtime.externs import Extern
    from hierc.runtime.tables import Table

#: Version of this contract; a module made for another one is refused with a message.
CONTRACT = 2

Function = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Steps:
    """The integers first, first + step, …: as many as there are elements."""

    first: int
    step: int = 1


@dataclass(frozen=True, slots=True)
class Packed:
    """Integers as base64 of their little-endian 32-bit differences (the first from 0), compressed by zlib: for long columns without a rule."""

    text: str


#: One integer for each element: the same for all, evenly spaced, listed, or packed.
Index = int | Steps | tuple[int, ...] | Packed


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
    differential equation, and `file` their file, if it is not the model's main one.
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
    file: str = ""


@dataclass(frozen=True, slots=True)
class Node:
    """A block of instances of a class. `sources[k]` says where input k comes from: (element, "state" | "out", index).

    `path` has a `[]` wherever `indices` has a column: `car[].engine`.
    """

    path: str
    kind: int  # index into Plan.classes
    parameters: tuple[Index, ...]  # indices into the parameter vector: the node's q
    sources: tuple[tuple[Index, Literal["state", "out"], Index], ...]
    count: int = 1
    indices: tuple[Index, ...] = ()


@dataclass(frozen=True, slots=True)
class Run:
    """Elements first, first + step, …, `count` of them, one after the other in each group; the next group's begin `shift` further."""

    first: int
    count: int
    step: int = 1
    shift: int = 0


#: Elements of each group: one for each group (`Index`), or several in a row.
Members = Index | Run


@dataclass(frozen=True, slots=True)
class Group:
    """`count` subsystems of equal form, each with its own step size.

    `nodes` have the group's states, concatenated in this order; one without states stands among them if the group publishes what it computes, which is all
    that a group without states does. `calls` are what one evaluation does, in order: (element, part) for an out part, (element, -1) for a right-hand
    side. Calls may name nodes without states that belong to no group. An entry with a `Run` stands for as
    many entries as it has elements, all of one block. `name` has a `[]` wherever `indices` has a column: `car[]`; a family whose groups differ in
    what they call is divided, so several may have one name.
    """

    name: str
    nodes: tuple[Members, ...]
    calls: tuple[tuple[Members, int], ...]
    count: int = 1
    indices: tuple[Index, ...] = ()


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a block of agents; scalars `first`, `first + 1`, … of the parameter vector, element by element, each row by row.

    `path` has a `[]` wherever `indices` has a column: `car[].tau`. The vector is in SI. Values given by path are in `unit`, one of which is `scale` in SI.
    """

    path: str
    shape: tuple[int, ...]
    first: int
    unit: str | None = None
    doc: str = ""
    structural: bool = False
    kind: Literal["real", "int", "bool"] = "real"
    scale: float = 1.0
    count: int = 1
    indices: tuple[Index, ...] = ()


@dataclass(frozen=True, slots=True)
class Defaults:
    """The defaults of a block's parameters: `function(a, v)` replaces each NaN of an element's scalars `v` by its default.

    `given`: the entries of the parameter vector that make `a`; `entries`: those that make `v`. All earlier defaults are known.
    """

    function: Function
    given: tuple[Index, ...]
    entries: tuple[Index, ...]
    count: int


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable that results know by name: the scalars of one element as (element, "state" | "observed", index), row by row.

    `path` has a `[]` wherever `indices` has a column: `car[].x` is the x of all cars. The scalars are in SI. Results show
    values in `unit`, one of which is `scale` in SI.
    """

    path: str
    shape: tuple[int, ...]
    elements: tuple[tuple[Index, Literal["state", "observed"], Index], ...]
    unit: str | None = None
    doc: str = ""
    access: Literal["write", "private", "read"] = "write"
    scale: float = 1.0
    count: int = 1
    indices: tuple[Index, ...] = ()


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

    `parameters_function(q)` replaces each NaN in the parameter vector by its default (in dependency order), so values given by the user stay; those of
    arrays follow, by `defaults`. `constants` are entries of the parameter vector that differ from element to element and never change, such as
    indices: (first, how many, integers; or all numbers as floats). `start_passes`: how often the `start` functions run over all elements, in the
    order `start_order` (None: by number), until every initial value is final (1 unless initial values refer to each other across nodes against the
    order). `order`: the cascade order of all single groups, numbered through `groups` (None: as they are numbered).
    """

    contract: int
    hierc: str
    name: str
    doc: str
    source: str  # file name of the model
    digest: str  # sha256 of the source text(s)
    classes: tuple[Class, ...]
    nodes: tuple[Node, ...]  # in execution order
    groups: tuple[Group, ...]  # in cascade order of their first ones
    parameters: tuple[Parameter, ...]
    parameter_count: int
    parameters_function: Function
    variables: tuple[Variable, ...]
    start_passes: int
    experiment: Experiment
    constants: tuple[tuple[int, int, Index | tuple[float, ...]], ...] = ()
    defaults: tuple[Defaults, ...] = ()
    order: Index | None = None
    start_order: Index | None = None
    tables: tuple[Table, ...] = ()  # that functions call by name, without derivatives
    externs: tuple[Extern, ...] = ()
