"""Systems of equations between numbers that are known when compiling: solved exactly, and rounded once."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache

Rows = tuple[tuple[Fraction, ...], ...]


def determinant(matrix: tuple[float, ...]) -> float:
    """The determinant of a square matrix, given row by row. Raises OverflowError above any float."""
    return float(_eliminated(matrix)[0])


def solution(matrix: tuple[float, ...], right: tuple[float, ...]) -> tuple[float, ...]:
    """x of matrix*x = right. Raises ZeroDivisionError for a singular matrix, OverflowError above any float."""
    det, inverse = _eliminated(matrix)
    if not det:
        raise ZeroDivisionError("a singular matrix")
    return tuple(float(sum(a * Fraction(b) for a, b in zip(row, right, strict=True))) for row in inverse)


@lru_cache(maxsize=64)
def _eliminated(matrix: tuple[float, ...]) -> tuple[Fraction, Rows]:
    """The determinant, and the rows of the inverse unless that is zero."""
    n = math.isqrt(len(matrix))
    rows = [
        [Fraction(a) for a in matrix[i * n : (i + 1) * n]] + [Fraction(int(i == j)) for j in range(n)]
        for i in range(n)
    ]
    det = Fraction(1)
    for k in range(n):
        best = next((i for i in range(k, n) if rows[i][k]), None)
        if best is None:
            return Fraction(0), ()
        if best != k:
            rows[k], rows[best], det = rows[best], rows[k], -det
        pivot = rows[k][k]
        det *= pivot
        rows[k] = [a / pivot for a in rows[k]]
        for i in range(n):
            if i != k and (factor := rows[i][k]):
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return det, tuple(tuple(row[n:]) for row in rows)
