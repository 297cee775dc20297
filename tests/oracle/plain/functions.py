"""The built-in functions and operators on numpy arrays, for reals of any of numpy's types.

An `int` is Python's, a `bool` too, a `real` is of the type `Real` that is given; vectors and matrices are arrays of these.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

Value = Any  # int, bool, a numpy real, or an array of one of these
Real = Callable[[Any], Any]


def plain(value: Value) -> Value:
    """Integers and truth values of numpy as Python's."""
    return value.item() if isinstance(value, np.integer | np.bool_) else value


def whole(value: Value) -> bool:
    """Whether a value is an `int` or an array of them."""
    return (isinstance(value, int) and not isinstance(value, bool)) or np.asarray(value).dtype.kind == "i"


def as_real(value: Value, real: Real) -> Value:
    """A number as a real."""
    return value.astype(real) if isinstance(value, np.ndarray) else real(value)


def binary(op: str, a: Value, b: Value, real: Real) -> Value:
    """An operator on two values of fitting shapes."""
    match op:
        case "+":
            return a + b
        case "-":
            return a - b
        case ".*":
            return a * b
        case "*":
            return a @ b if np.ndim(a) == 2 and np.ndim(b) > 0 else a * b
        case "/" | "./":
            return np.divide(as_real(a, real), as_real(b, real))
        case "^":
            return a**b if whole(a) and whole(b) and b >= 0 else np.power(real(a), real(b))
        case "<":
            return bool(a < b)
        case "<=":
            return bool(a <= b)
        case ">":
            return bool(a > b)
        case ">=":
            return bool(a >= b)
        case "==":
            return bool(a == b)
        case "!=":
            return bool(a != b)
    raise AssertionError(op)


def sign(x: Value) -> Value:
    """-1, 0 or 1, of the type of `x`."""
    return type(x)((x > 0) - int(x < 0))


def rounded(x: Value) -> Value:
    """The nearest whole number, half away from zero."""
    return sign(x) * np.floor(abs(x) + type(x)(0.5))


def mod(x: Value, y: Value) -> Value:
    """The remainder with the sign of `y`."""
    return np.mod(x, y) if isinstance(x, np.floating) or isinstance(y, np.floating) else x % y


def solved(matrix: Value, right: Value) -> Value:
    """The solution of `matrix*x = right`, by Gauss and Jordan with the largest pivots."""
    a, b = np.array(matrix), np.array(right)
    for k in range(len(a)):
        pivot = k + int(np.argmax(abs(a[k:, k])))
        a[[k, pivot]], b[[k, pivot]] = a[[pivot, k]], b[[pivot, k]]
        b[k], a[k] = b[k] / a[k, k], a[k] / a[k, k]
        for other in range(len(a)):
            if other != k:
                b[other], a[other] = b[other] - a[other, k] * b[k], a[other] - a[other, k] * a[k]
    return b


def determinant(matrix: Value) -> Value:
    """By minors of the first row."""
    if len(matrix) == 1:
        return matrix[0, 0]
    minors = (determinant(np.delete(matrix[1:], j, axis=1)) for j in range(len(matrix)))
    return reduce(lambda a, b: a + b, (matrix[0, j] * minor * (-1) ** j for j, minor in enumerate(minors)))


_REAL: dict[str, Callable[..., Value]] = {
    "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "log10": np.log10, "sin": np.sin, "cos": np.cos, "tan": np.tan,
    "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2, "sinh": np.sinh, "cosh": np.cosh,
    "tanh": np.tanh, "norm": lambda x: np.sqrt((x * x).sum()), "solve": solved,
    "inverse": lambda a: solved(a, np.eye(len(a), dtype=a.dtype)), "det": determinant,
    "floor": np.floor, "ceil": np.ceil, "round": rounded,
}  # fmt: skip

_ANY: dict[str, Callable[..., Value]] = {
    "abs": abs, "sign": sign, "mod": mod, "div": lambda i, j: i // j, "smooth": lambda x: x,
    "min": lambda *x: min(np.ravel(x[0]) if len(x) == 1 else x), "max": lambda *x: max(np.ravel(x[0]) if len(x) == 1 else x),
    "clamp": lambda x, low, high: min(max(x, low), high),
    "dot": lambda a, b: (a * b).sum(), "cross": np.cross, "sum": lambda a: a.sum(),
    "transpose": np.transpose, "trace": np.trace,
    "eye": lambda n: np.eye(n, dtype=int), "zeros": lambda *shape: np.zeros(shape, dtype=int),
}  # fmt: skip


def call(name: str, args: list[Value], real: Real) -> Value:
    """A built-in function."""
    if name in _REAL:
        return _REAL[name](*(as_real(a, real) for a in args))
    return plain(_ANY[name](*args))
