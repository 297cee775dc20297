"""Determinant, inverse and linear solution of matrices: up to 3x3 as scalar formulas, above as operations that factor the matrix at run time.

All elements that come in are leaves (the caller shared them), and the pieces that several elements of a formula need (cofactors, the
determinant) are shared here, so the formulas stay small. Each unknown of a larger system is an operation of its own; the symbolic phase finds that they
have their matrix, and its factors, in common.
"""

from __future__ import annotations

from hierc.compiler.expression import Expr, Number
from hierc.compiler.shapes.operations import Sharing, inner_product, unknowns
from hierc.compiler.shapes.values import Value, apply
from hierc.grammar.source import Span

#: Largest matrix with a formula of its own.
LARGEST_FORMULA = 3

#: Largest matrix at all.
MAX_SIZE = 12


def determinant(matrix: Value, span: Span) -> Expr:
    """Determinant, up to 3x3 by expansion along the first row."""
    size = matrix.shape[0]
    if size > LARGEST_FORMULA:
        return apply("det", *matrix.elements, span=span)
    if size == 1:
        return matrix.elements[0]
    if size == 2:
        return _minor(matrix, (0, 1), (0, 1), span)
    return _expanded(matrix, _cofactors(matrix, span), span)


def _minor(matrix: Value, rows: tuple[int, int], columns: tuple[int, int], span: Span) -> Expr:
    """Determinant of the 2x2 matrix in these rows and columns."""
    (i, k), (j, m) = rows, columns
    main = apply("mul", matrix.row(i)[j], matrix.row(k)[m], span=span)
    side = apply("mul", matrix.row(i)[m], matrix.row(k)[j], span=span)
    return apply("sub", main, side, span=span)


def _cofactors(matrix: Value, span: Span) -> list[list[Expr]]:
    """Cofactors C[i][j] of a 3x3 matrix; taking rows and columns cyclically gives their signs."""
    following = ((1, 2), (2, 0), (0, 1))
    return [[_minor(matrix, following[i], following[j], span) for j in range(3)] for i in range(3)]


def _expanded(matrix: Value, cofactors: list[list[Expr]], span: Span) -> Expr:
    return inner_product(matrix.row(0), cofactors[0], span)


def _adjugate(matrix: Value, span: Span, sharing: Sharing) -> tuple[list[list[Expr]], Expr]:
    """Rows of the adjugate and the determinant, all shared."""
    size = matrix.shape[0]
    if size == 2:
        a, b, c, d = matrix.elements
        rows = [[d, apply("neg", b, span=span)], [apply("neg", c, span=span), a]]
        return rows, sharing.define("determinant", determinant(matrix, span))
    cofactors = [[sharing.define("cofactor", c) for c in row] for row in _cofactors(matrix, span)]
    rows = [[cofactors[j][i] for j in range(3)] for i in range(3)]
    return rows, sharing.define("determinant", _expanded(matrix, cofactors, span))


def inverse(matrix: Value, span: Span, sharing: Sharing) -> Value:
    """The inverse: as adjugate over determinant, or column by column."""
    size = matrix.shape[0]
    if size > LARGEST_FORMULA:
        unit = tuple(Number(span, float(i == j)) for i in range(size) for j in range(size))
        return _factored(matrix, Value("real", matrix.shape, unit), span)
    if size == 1:
        return Value("real", (1, 1), (apply("div", Number(span, 1.0), matrix.elements[0], span=span),))
    rows, det = _adjugate(matrix, span, sharing)
    return Value("real", matrix.shape, tuple(apply("div", e, det, span=span) for row in rows for e in row))


def solve(matrix: Value, right: Value, span: Span, sharing: Sharing) -> Value:
    """The solution of `matrix * x = right`, by Cramer's rule where it is small; `right` is a vector or a matrix."""
    size = matrix.shape[0]
    if size > LARGEST_FORMULA:
        return _factored(matrix, right, span)
    if size == 1:
        return Value(
            "real", right.shape, tuple(apply("div", e, matrix.elements[0], span=span) for e in right.elements)
        )
    rows, det = _adjugate(matrix, span, sharing)
    columns = [right.elements] if len(right.shape) == 1 else [right.column(j) for j in range(right.shape[1])]
    products = (inner_product(row, column, span) for row in rows for column in columns)
    return Value("real", right.shape, tuple(apply("div", p, det, span=span) for p in products))


def _factored(matrix: Value, right: Value, span: Span) -> Value:
    """The solution of `matrix * x = right`, its unknowns one by one."""
    columns = [right.elements] if len(right.shape) == 1 else [right.column(j) for j in range(right.shape[1])]
    return Value("real", right.shape, unknowns(matrix.elements, columns, span))
