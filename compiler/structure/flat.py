"""The flat model: every scalar of every agent in whole-model tables, before nodes are put in order.

Expressions are those of `expression.py` with indices into the tables here: `State` and `Rate` into `Flat.states`, `Local` into
`Flat.definitions`, `Parameter` into the parameter vector; `Input` does not occur yet. An entry of these tables stands for all elements of a block, and what
uses it belongs to the same element, unless there is but one; scalars of other elements are named by `Gather`. `nodes.py` turns all of them
into the nodes' own indices.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, assert_never

from hierc.compiler.arrays.columns import Index
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.expression import (
    Apply,
    Choose,
    Expr,
    Gather,
    Input,
    Local,
    Number,
    Parameter,
    Rate,
    State,
    Time,
)
from hierc.compiler.structure.instances import Instance, Place, Standing
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class FlatNode:
    """A node of grouping. `observer`: algebraic variables that stand beside levels, of their agent or in a level of it."""

    instance: Instance
    level: str | None
    observer: bool
    path: str
    template: str
    span: Span
    levels: tuple[Standing, ...]  # the levels around it, from the outside
    place: Place

    @property
    def made(self) -> bool:
        """Whether the compiler made it, for a sum or the like: its path is no name."""
        return " " in self.path


@dataclass(frozen=True, slots=True)
class FlatState:
    node: int
    name: str
    rate: Expr
    initial: Expr
    nominal: Expr
    span: Span
    rate_span: Span
    first: int  # number of its first element's among the scalar states of all elements


@dataclass(frozen=True, slots=True)
class FlatDefinition:
    """A scalar that is computed once. `owner` is the node of an algebraic variable; None where it goes to whoever uses it."""

    name: str
    path: str  # the same in the whole model, for messages
    value: Expr
    span: Span
    owner: int | None
    hidden: bool  # made by the compiler: never shown to users
    domain: Domain
    first: int = -1  # for algebraic variables: number of its first element's among those of all elements


@dataclass(frozen=True, slots=True)
class FlatVariable:
    """A variable for results, of a single agent or all of an array; `elements` are leaves, None for a `read` that is bound to an expression."""

    path: str
    shape: tuple[int, ...]
    unit: str | None
    doc: str
    access: Literal["write", "private", "read"]
    elements: tuple[State | Local | Gather, ...] | None
    span: Span
    scale: float  # one of the declared unit in SI
    count: int
    indices: tuple[Index, ...]


@dataclass(frozen=True, slots=True)
class Flat:
    instances: tuple[Instance, ...]
    nodes: tuple[FlatNode, ...]  # in text order
    states: tuple[FlatState, ...]
    definitions: tuple[FlatDefinition, ...]
    variables: tuple[FlatVariable, ...]

    def copied(self, definition: FlatDefinition) -> bool:
        """Whether every node that uses a definition has its own copy: `let`s, couplings, and observers, which nothing integrates."""
        return definition.owner is None or self.nodes[definition.owner].observer


Leaf = State | Rate | Local | Parameter | Input | Time | Number | Gather


def leaves(expr: Expr) -> Iterator[Leaf]:
    """The leaves of an expression, from left to right, as often as they stand there."""
    stack = [expr]
    while stack:
        here = stack.pop()
        match here:
            case Apply(args=args):
                stack.extend(reversed(args))
            case Choose(condition=condition, then=then, other=other):
                stack.extend((other, then, condition))
            case Number() | Time() | State() | Rate() | Input() | Parameter() | Local() | Gather():
                yield here
            case _ as never:
                assert_never(never)
