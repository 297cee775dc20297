"""Generated functions under CPython where CPython would raise: in the arithmetic of the machine, 1/0 infinite, the root of -1 NaN.

So a fault spoils what depends on it, not all that the function computes. Where `math`'s functions raise numpy's stand in for them: elsewhere all bits are
CPython's, and so those of machine code.
"""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from hierc.runtime.externs import Extern
from hierc.runtime.tables import Table

_OTHER_NAMES = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "pow": "power"}
_SAME = (
    "sqrt",
    "fabs",
    "floor",
    "ceil",
    "copysign",
    "exp",
    "log",
    "log10",
    "sin",
    "cos",
    "tan",
    "sinh",
    "cosh",
    "tanh",
    "fmod",
)


def _never_raising(name: str) -> Callable[..., np.float64]:
    usual: Callable[..., float] = getattr(math, name)
    at_faults: Callable[..., np.float64] = getattr(np, _OTHER_NAMES.get(name, name))

    def function(*args: float) -> np.float64:
        try:
            return np.float64(usual(*args))
        except (ValueError, OverflowError):
            return at_faults(*args)

    return function


_MATH = types.SimpleNamespace(**{name: _never_raising(name) for name in (*_SAME, *_OTHER_NAMES)})


def _quiet(callee: Table | Extern) -> Callable[..., np.float64]:
    """A table or extern whose value goes on in the machine's arithmetic."""
    return lambda *args: np.float64(callee(*args))


def call(function: Callable[..., None], *args: Any) -> None:
    """function(…, output), its output NaN where it is not finite. Numbers and lists of numbers as arguments."""
    names = {**function.__globals__, "math": _MATH, "float": np.float64}
    names.update({name: _quiet(f) for name, f in names.items() if isinstance(f, Table | Extern)})
    quiet = types.FunctionType(function.__code__, names)
    output = args[-1]
    given = [np.float64(a) if isinstance(a, float) else [np.float64(v) for v in a] for a in args[:-1]]
    result = list(output)
    try:
        with np.errstate(all="ignore"):
            quiet(*given, result)
    except ZeroDivisionError:  # 1.0/0.0, written out
        pass
    output[:] = [float(v) if math.isfinite(v) else math.nan for v in result]
