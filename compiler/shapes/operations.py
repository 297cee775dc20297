"""Operators on shaped values: the shape rule and the scalars of each operator stand together.

In: shaped operands. Out: a shaped value, or `Rejected` with E301, E304 or E309. `share` names a scalar that is used more than once, so that
nothing is ever written out twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal

from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Apply, Expr, Number, Operator
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes.advice import of_operator
from hierc.compiler.shapes.errors import NotACondition, OperandNotNumeric, OperandsDiffer
from hierc.compiler.shapes.values import Scalar, Value, apply, is_leaf, joined, scalar_of
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Most multiplications of one product of matrices.
MAX_PRODUCT = 100_000


#: What makes one scalar of many.
Reduction = Literal["add", "min", "max"]


@dataclass(frozen=True, slots=True)
class Sharing:
    """How to name scalars for repeated use. `define(name, expr)` gives a leaf that stands for `expr`; `join(op, terms, span)` one that stands for many
    terms of other agents, joined, None where they are better written out.
    """

    define: Callable[[str, Expr], Expr]
    join: Callable[[Reduction, Sequence[Expr], Span], Expr | None] = lambda op, terms, span: None

    def value(self, value: Value, name: str) -> Value:
        """`value` with a leaf for each of its elements."""
        elements = tuple(e if is_leaf(e) else self.define(name, e) for e in value.elements)
        return Value(value.scalar, value.shape, elements)


def binary(node: tree.Binary, left: Value, right: Value, sharing: Sharing) -> Value:
    """`left op right`."""
    span = node.span
    match node.op:
        case "+" | "-":
            if left.shape == right.shape and _numeric(left, right):
                return _elementwise("add" if node.op == "+" else "sub", left, right, span)
        case ".*" | "./":
            if left.shape == right.shape and _numeric(left, right):
                return _elementwise("mul" if node.op == ".*" else "div", left, right, span)
        case "*":
            if _numeric(left, right) and (product := _product(left, right, span, sharing)) is not None:
                return product
        case "/":
            if right.shape == () and _numeric(left, right):
                divisor = sharing.value(right, "divisor").single if left.shape else right.single
                return Value(
                    "real", left.shape, tuple(apply("div", e, divisor, span=span) for e in left.elements)
                )
        case "^":
            if left.shape == right.shape == () and _numeric(left, right):
                return scalar_of(_power_type(left, right), apply("pow", left.single, right.single, span=span))
        case "and" | "or":
            condition(left, node.left)
            condition(right, node.right)
            return scalar_of("bool", apply(node.op, left.single, right.single, span=span))
        case _:
            if left.shape == right.shape == () and (
                _numeric(left, right) or _both_bool(node.op, left, right)
            ):
                return scalar_of("bool", apply(_COMPARISONS[node.op], left.single, right.single, span=span))
    raise Rejected(_differ(node, left, right))


_COMPARISONS: dict[str, Operator] = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}
_VERBS = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    ".*": "multiply",
    "./": "divide",
    "^": "raise",
}


def _differ(node: tree.Binary, left: Value, right: Value) -> OperandsDiffer:
    advice = of_operator(node, left, right)
    verb = _VERBS.get(node.op, "compare")
    return OperandsDiffer(
        node.op_span, verb=verb, left=left.type, right=right.type, text=_shortened(node.span.text),
        left_span=node.left.span, right_span=node.right.span, advice=advice,
    )  # fmt: skip


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 60 else f"{line[:57]}..."


def _numeric(*values: Value) -> bool:
    return all(v.scalar != "bool" for v in values)


def _both_bool(op: str, left: Value, right: Value) -> bool:
    return op in ("==", "!=") and left.scalar == right.scalar == "bool"


def _power_type(left: Value, right: Value) -> Scalar:
    """A power of an `int` is one only for a literal exponent that is not negative."""
    whole = left.scalar == right.scalar == "int" and isinstance(right.single, Number)
    return "int" if whole else "real"


def _elementwise(op: Operator, left: Value, right: Value, span: Span) -> Value:
    scalar: Scalar = "real" if op == "div" else joined((left.scalar, right.scalar))
    pairs = zip(left.elements, right.elements, strict=True)
    return Value(scalar, left.shape, tuple(apply(op, a, b, span=span) for a, b in pairs))


def _product(left: Value, right: Value, span: Span, sharing: Sharing) -> Value | None:
    """Scalar times anything, matrix times matrix or vector; None when the shapes do not fit."""
    scalar = joined((left.scalar, right.scalar))
    if left.shape == ():
        factor = left.single if right.shape == () else sharing.value(left, "factor").single
        return Value(scalar, right.shape, tuple(apply("mul", factor, e, span=span) for e in right.elements))
    if right.shape == ():
        factor = sharing.value(right, "factor").single
        return Value(scalar, left.shape, tuple(apply("mul", e, factor, span=span) for e in left.elements))
    if len(left.shape) != 2 or left.shape[1] != right.shape[0] or not left.elements:
        return None
    rows = left.shape[0]
    if rows * len(right.elements) > MAX_PRODUCT:
        raise Rejected(
            ModelTooLarge(
                span, what=f"a product of {rows * len(right.elements)} multiplications", limit=MAX_PRODUCT
            )
        )
    b = sharing.value(right, "right")
    columns = [b.elements] if len(right.shape) == 1 else [b.column(j) for j in range(right.shape[1])]
    if (matrix := inverted(left)) is not None:
        return Value("real", (rows, *right.shape[1:]), unknowns(matrix, columns, span))
    a = sharing.value(left, "left")
    elements = tuple(
        reduction("add", products(a.row(i), column, span), span, sharing)
        for i in range(rows)
        for column in columns
    )
    return Value(scalar, (rows, *right.shape[1:]), elements)


def unknowns(matrix: Sequence[Expr], columns: Sequence[Sequence[Expr]], span: Span) -> tuple[Expr, ...]:
    """The solutions x of `matrix * x = column`, row by row, each an operation of its own."""
    if (count := len(matrix) * len(columns)) > MAX_PRODUCT:
        raise Rejected(ModelTooLarge(span, what=f"a solution of {count} multiplications", limit=MAX_PRODUCT))
    numbers = [Number(span, float(i)) for i in range(len(columns[0]))]
    return tuple(
        apply("solve", number, *matrix, *column, span=span) for number in numbers for column in columns
    )


def inverted(value: Value) -> tuple[Expr, ...] | None:
    """The matrix that `value` is the inverse of, if it is made of `unknowns`: then a product with it is better solved for."""
    match value.elements[0], value.shape:
        case Apply(op="solve", args=(_, *system)), (n, m) if n == m:
            matrix = tuple(system[: n * n])
            columns = [[Number(None, float(i == j)) for i in range(n)] for j in range(n)]
            wanted = ((Number(None, float(i)), *matrix, *column) for i in range(n) for column in columns)
            found = (e.args if isinstance(e, Apply) and e.op == "solve" else () for e in value.elements)
            return matrix if all(a == b for a, b in zip(found, wanted, strict=True)) else None
    return None


def inner_product(left: Sequence[Expr], right: Sequence[Expr], span: Span) -> Expr:
    """The sum of the products of each pair; at least one pair."""
    return chained("add", products(left, right, span), span)


def products(left: Sequence[Expr], right: Sequence[Expr], span: Span) -> list[Expr]:
    """The products of each pair."""
    return [apply("mul", a, b, span=span) for a, b in zip(left, right, strict=True)]


def reduction(op: Reduction, terms: Sequence[Expr], span: Span, sharing: Sharing) -> Expr:
    """The sum or extreme of `terms`, at least one, perhaps many of other agents."""
    return sharing.join(op, terms, span) or chained(op, terms, span)


def chained(op: Operator, terms: Sequence[Expr], span: Span) -> Expr:
    """`terms`, at least one, joined by `op` from left to right."""
    return reduce(lambda left, right: apply(op, left, right, span=span), terms)


def unary(node: tree.Unary, operand: Value) -> Value:
    """A sign or `not`."""
    if node.op == "not":
        condition(operand, node.operand)
        return scalar_of("bool", apply("not", operand.single, span=node.span))
    if operand.scalar == "bool":
        raise Rejected(OperandNotNumeric(node.span, op=node.op, type=operand.type))
    if node.op == "+":
        return operand
    return Value(operand.scalar, operand.shape, tuple(_negated(e, node.span) for e in operand.elements))


def _negated(expr: Expr, span: Span) -> Expr:
    """A negative literal stays a literal."""
    return Number(span, -expr.value) if isinstance(expr, Number) else apply("neg", expr, span=span)


def condition(value: Value, node: tree.Expr) -> Expr:
    """The scalar of a condition."""
    if value.scalar != "bool" or value.shape != ():
        raise Rejected(NotACondition(node.span, text=_shortened(node.span.text), type=value.type))
    return value.single
