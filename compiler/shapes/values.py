"""Shaped values: what an expression is while vectors and matrices are being split into scalars.

A `Value` knows its type and holds one scalar expression an element, row by row. A vector is a column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import prod
from typing import Literal

from hierc.compiler.arrays.columns import Index
from hierc.compiler.expression import Apply, Choose, Expr, Gather, Number, Operator
from hierc.compiler.shapes.folding import folded, folded_index
from hierc.grammar.source import Span

Scalar = Literal["real", "int", "bool"]
Shape = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Value:
    """`elements` are as many as `shape` says; a scalar has shape ()."""

    scalar: Scalar
    shape: Shape
    elements: tuple[Expr, ...]

    @property
    def type(self) -> str:
        """The type as it is declared: `real[2,2]`."""
        return type_text(self.scalar, self.shape)

    @property
    def single(self) -> Expr:
        """The only element of a scalar."""
        (element,) = self.elements
        return element

    def row(self, index: int) -> tuple[Expr, ...]:
        """Row `index` (from 0) of a matrix."""
        width = self.shape[1]
        return self.elements[index * width : (index + 1) * width]

    def column(self, index: int) -> tuple[Expr, ...]:
        """Column `index` (from 0) of a matrix."""
        return self.elements[index :: self.shape[1]]

    def at(self, span: Span) -> Value:
        """The same value with `span` as the place of its elements."""
        return Value(self.scalar, self.shape, tuple(replace(e, span=span) for e in self.elements))


def type_text(scalar: Scalar, shape: Shape) -> str:
    """A type as it is declared."""
    return f"{scalar}[{','.join(map(str, shape))}]" if shape else scalar


def number(value: float, scalar: Scalar = "real", span: Span | None = None) -> Value:
    """A scalar literal."""
    return Value(scalar, (), (Number(span, float(value)),))


def scalar_of(scalar: Scalar, element: Expr) -> Value:
    """A scalar."""
    return Value(scalar, (), (element,))


def size_of(shape: Shape) -> int:
    """How many scalars a shape has."""
    return prod(shape)


def joined(types: Sequence[Scalar]) -> Scalar:
    """The type of a number that is one of these: `int` only if all are."""
    return "int" if all(t == "int" for t in types) else "real"


def apply(op: Operator, *args: Expr, span: Span | None = None) -> Expr:
    """An operation on scalars; a literal where all arguments are, an index where they are indices and whole literals."""
    if any(isinstance(arg, Gather) for arg in args):
        return _of_elements(op, args, span)
    value = folded(op, args)
    return Apply(span, op, args) if value is None else Number(span, value)


def _of_elements(op: Operator, args: tuple[Expr, ...], span: Span | None) -> Expr:
    index = folded_index(op, args)
    return Apply(span, op, args) if index is None else index_value(index, span)


def index_value(index: Index, span: Span | None = None) -> Expr:
    """Integers that are known when compiling: a literal where all elements have the same."""
    return Number(span, float(index)) if isinstance(index, int) else Gather(span, "index", index)


@lru_cache(maxsize=4)  # an equation in a loop asks for all names of its variable once for each round
def element_names(name: str, shape: Shape) -> tuple[str, ...]:
    """The names of a variable's scalars, row by row: `p[1]`, `M[1,2]`, or just `x`."""
    if not shape:
        return (name,)
    indices: list[tuple[int, ...]] = [()]
    for size in shape:
        indices = [(*index, i) for index in indices for i in range(1, size + 1)]
    return tuple(f"{name}[{','.join(map(str, index))}]" for index in indices)


def is_leaf(expr: Expr) -> bool:
    """Whether repeating `expr` costs nothing."""
    return not isinstance(expr, Apply | Choose)


def fits(scalar: Scalar, wanted: Scalar) -> bool:
    """Whether a value of type `scalar` may be given where `wanted` is declared."""
    return scalar == wanted or (scalar == "int" and wanted == "real")
