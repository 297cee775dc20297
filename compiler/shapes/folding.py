"""Constants: operations on literals are carried out when compiling.

Needed for sizes, indices, ranges and structural conditions, which must be literals in the end; harmless elsewhere, because the same double
arithmetic is done as at run time.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.compiler import exact
from hierc.compiler.arrays.columns import Index, column
from hierc.compiler.expression import Expr, Gather, Number, Operator


def constant(expr: Expr) -> float | None:
    """The value of a literal; None for anything that is not known when compiling. Booleans are 0.0 and 1.0."""
    return expr.value if isinstance(expr, Number) else None


def folded_index(op: Operator, args: Sequence[Expr]) -> Index | None:
    """The integers of an operation on indices and whole literals; None for any other, or where a result is no integer or too large.

    Booleans are 0 and 1. At least one argument is an index.
    """
    values = [_whole(arg) for arg in args]
    if any(v is None for v in values) or op not in _WHOLE:
        return None
    with np.errstate(all="ignore"):
        result = np.asarray(_WHOLE[op](*values), np.float64)
    fits = np.isfinite(result) & (result == np.round(result)) & (np.abs(result) < MAX_INDEX)
    return column(result.astype(np.int64)) if fits.all() else None


#: Integers are computed as doubles, which have them exactly up to here.
MAX_INDEX = 2.0**53


def _whole(expr: Expr) -> NDArray[np.float64] | None:
    if isinstance(expr, Gather) and expr.kind == "index":
        return np.asarray(expr.at if isinstance(expr.at, int) else expr.at.values, np.float64)
    return np.asarray(expr.value) if isinstance(expr, Number) and expr.value.is_integer() else None


def folded(op: Operator, args: Sequence[Expr]) -> float | None:
    """The value of an operation on literals; None if an argument is no literal or the result is no finite real number."""
    values = [arg.value for arg in args if isinstance(arg, Number)]
    if len(values) < len(args):
        return None
    try:
        result = float(_OPERATIONS[op](*values))
    except (ArithmeticError, ValueError):
        return None
    return result if math.isfinite(result) else None


def _sign(x: float) -> float:
    return float((x > 0) - (x < 0))


def _solve(index: float, *system: float) -> float:
    """One unknown of a system of n equations: n rows of the matrix, then the right-hand side."""
    n = math.isqrt(len(system))  # n*n + n is less than (n + 1)^2
    return exact.solution(system[: n * n], system[n * n :])[int(index)]


def _round(x: float) -> float:
    """Half away from zero."""
    return math.copysign(math.floor(abs(x) + 0.5), x)


_OPERATIONS: dict[Operator, Callable[..., float]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "neg": operator.neg, "pow": math.pow,
    "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "log10": math.log10,
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
    "atan2": math.atan2, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh,
    "abs": abs, "sign": _sign, "floor": math.floor, "ceil": math.ceil, "round": _round,
    "mod": operator.mod, "quotient": lambda x, y: math.floor(x / y), "min": min, "max": max,
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge, "eq": operator.eq, "ne": operator.ne,
    "det": lambda *matrix: exact.determinant(matrix), "solve": _solve,
    "and": lambda a, b: bool(a) and bool(b), "or": lambda a, b: bool(a) or bool(b), "not": operator.not_,
}  # fmt: skip

#: The same on arrays of whole numbers, of those operations that give such numbers.
_WHOLE: dict[Operator, Callable[..., Any]] = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "neg": np.negative, "pow": np.power,
    "abs": np.abs, "sign": np.sign, "floor": np.floor, "ceil": np.ceil, "round": np.round,
    "mod": np.mod, "quotient": np.floor_divide, "min": np.minimum, "max": np.maximum,
    "lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal, "eq": np.equal, "ne": np.not_equal,
    "and": np.logical_and, "or": np.logical_or, "not": np.logical_not,
}  # fmt: skip
