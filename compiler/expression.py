"""The scalar expression IR: what remains of the user's expressions once names, shapes and units are resolved.

Everything refers to the *node* (see `model.py`) whose equation it stands in: its own states, the inputs it reads from other nodes, its
parameters, and its own shared definitions (`let`s and algebraic variables). Nothing refers to a global index, so two nodes that say the
same thing have equal expressions and share one class of generated functions. Spans never take part in comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from hierc.compiler.arrays.columns import Index
from hierc.compiler.callees.callee import Callee
from hierc.grammar.source import Span

Operator = Literal[
    "add", "sub", "mul", "div", "neg", "pow",
    "sqrt", "exp", "log", "log10",
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
    "abs", "sign", "floor", "ceil", "round", "mod", "quotient", "min", "max",
    "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not",
    "det",  # of a square matrix, row by row
    "call",  # of a table or an external function; vectors are given element by element
    "solve",  # one unknown of a system: its number (a literal, from 0), the matrix row by row, the right-hand side
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Expression:
    """Base: `span` is the user's text that this came from (None where the compiler made it)."""

    span: Span | None = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Number(Expression):
    """A literal in SI; booleans are 0.0 and 1.0."""

    value: float


@dataclass(frozen=True, slots=True)
class Time(Expression):
    pass


@dataclass(frozen=True, slots=True)
class State(Expression):
    """The node's own scalar state `index`."""

    index: int


@dataclass(frozen=True, slots=True)
class Rate(Expression):
    """The derivative of the node's own state `index` (`x'` inside the agent that owns x)."""

    index: int


@dataclass(frozen=True, slots=True)
class Input(Expression):
    """Input `index` of the node: a scalar of another node (see `Node.inputs`)."""

    index: int


@dataclass(frozen=True, slots=True)
class Parameter(Expression):
    """Entry `index` of `Node.parameters`: a scalar run-time parameter."""

    index: int


@dataclass(frozen=True, slots=True)
class Local(Expression):
    """The node's shared definition `index` (`Node.definitions`)."""

    index: int


@dataclass(frozen=True, slots=True)
class Gather(Expression):
    """What each element of a block takes from other elements, before nodes are made: `at` numbers the scalars, one for each element.

    `state`, `rate`, `algebraic`: of any element; `parameter`: entries of the parameter vector; `index`: the integers `at` themselves, which are known
    when compiling.
    """

    kind: Literal["state", "rate", "algebraic", "parameter", "index"]
    at: Index


@dataclass(frozen=True, slots=True)
class Apply(Expression):
    """An operator or built-in function on scalars. Conditions are 0/1-valued; `and`, `or` take two arguments."""

    op: Operator
    args: tuple[Expr, ...]
    callee: Callee | None = None  # of `call`


@dataclass(frozen=True, slots=True)
class Choose(Expression):
    """A run-time `if`: only the chosen branch is evaluated."""

    condition: Expr
    then: Expr
    other: Expr


Expr = Number | Time | State | Rate | Input | Parameter | Local | Apply | Choose | Gather
