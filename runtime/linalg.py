"""Systems of linear equations in generated modules: a factorisation with row exchanges, shared by all right-hand sides of one matrix.

A generated module calls `factor`, `substitute` and `determinant`; `solve`, `inverse` and `det` of the language, and their derivatives, are made of these
three. Written out for one matrix they would be thousands of lines that choose rows at run time, so they are the only operations of a generated
module that are not scalar, and factors the only values that are not numbers: `factor_size(n)` doubles in a row, which may be kept in `p` as `p[3:24]`.

The text below is all there is: CPython runs it on floats, and the machine layer lowers the same two loops over lanes, where each lane exchanges rows
of its own. So both agree bit for bit. A row is chosen by its entry relative to the largest entry that the row had at first: the choice, and so the
accuracy, does not depend on the units in which the equations happen to be written.

Factors of an n-by-n matrix: n rows of n + 1 entries, then the determinant. Row i has the multipliers before its diagonal, 1/pivot on it, the upper
triangle after it, and last the number of the equation that came to stand there. Nothing here raises: the determinant of a singular matrix is
0 and 1/pivot infinite, so that solutions are infinite or NaN.
"""

from __future__ import annotations

from typing import Any

from hierc.runtime.machine.dialect import Array, Lanes, any_lane, exact, outlined, select

#: Largest matrix that the language has these functions for.
LARGEST = 12
#: Rows with nothing above this are compared as they are.
_TINY = 1e-300
_INFINITE = float("inf")


def factor_size(n: int) -> int:
    """Doubles that the factors of an n-by-n matrix take."""
    return n * (n + 1) + 1


def factor(n: int, *matrix: float) -> list[float]:
    """Factors of the n-by-n matrix with these n*n entries, row by row."""
    factors: Any = [0.0] * factor_size(n)
    for i in range(n):
        factors[i * (n + 1) : i * (n + 1) + n] = matrix[i * n : (i + 1) * n]
    work: Any = [0.0] * (n + 1)
    factor_rows(factors, work, n)
    return list(factors)


def substitute(n: int, factors: list[float], *right: float) -> list[float]:
    """The n unknowns x of A x = right, from the factors of A."""
    given: Any = factors
    b: Any = right
    x: Any = [0.0] * n
    substitute_rows(given, b, x, n)
    return list(x)


def determinant(n: int, factors: list[float]) -> float:
    """The determinant of A, from its factors."""
    return factors[n * (n + 1)]


# ---- the dialect's text ----------------------------------------------------------------------


@exact
@outlined
def factor_rows(m: Array[Lanes], work: Array[Lanes], n: int) -> None:
    """Replace the matrix in `m`, n rows of n + 1 entries, by its factors. `work` has n + 1 entries."""
    width = n + 1
    m[n * width] = 1.0  # type: ignore[assignment]
    for i in range(n):
        size = abs(m[i * width])
        for j in range(1, n):
            size = max(size, abs(m[i * width + j]))
        work[i] = 1.0 / select(size < _TINY, 1.0, size)
        m[i * width + n] = float(i)  # type: ignore[assignment]
    for k in range(n):
        # Which row has the largest entry in this column, measured by its own size?
        best = abs(m[k * width + k]) * work[k]
        work[n] = float(k)  # type: ignore[assignment]
        for i in range(k + 1, n):
            other = abs(m[i * width + k]) * work[i]
            work[n] = select(other > best, float(i), work[n])
            best = select(other > best, other, best)
        # Exchange it with row k, in the lanes where it is row i.
        for i in range(k + 1, n):
            if any_lane(work[n] == float(i)):
                for j in range(n + 1):
                    upper = m[k * width + j]
                    lower = m[i * width + j]
                    m[k * width + j] = select(work[n] == float(i), lower, upper)
                    m[i * width + j] = select(work[n] == float(i), upper, lower)
                work[i] = select(work[n] == float(i), work[k], work[i])
                m[n * width] = select(work[n] == float(i), -m[n * width], m[n * width])
        # Eliminate. Where the pivot is zero, so is what stands below it.
        pivot = m[k * width + k]
        m[n * width] = m[n * width] * pivot
        inverse = 1.0 / select(pivot == 0.0, 1.0, pivot)
        for i in range(k + 1, n):
            multiplier = m[i * width + k] * inverse
            m[i * width + k] = multiplier
            for j in range(k + 1, n):
                m[i * width + j] = m[i * width + j] - multiplier * m[k * width + j]
        m[k * width + k] = select(pivot == 0.0, _INFINITE, inverse)


@exact
@outlined
def substitute_rows(m: Array[Lanes], b: Array[Lanes], x: Array[Lanes], n: int) -> None:
    """Set the n unknowns `x` for the right-hand side `b`, by the factors `m`."""
    width = n + 1
    for i in range(n):
        rest = b[i]
        if any_lane(m[i * width + n] != float(i)):
            for k in range(n):
                rest = select(m[i * width + n] == float(k), b[k], rest)
        for j in range(i):
            rest = rest - m[i * width + j] * x[j]
        x[i] = rest
    for done in range(n):
        i = n - 1 - done
        rest = x[i]
        for j in range(i + 1, n):
            rest = rest - m[i * width + j] * x[j]
        x[i] = rest * m[i * width + i]
