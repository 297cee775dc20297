"""Numbers that count what is done with them, and the dialect's functions for such numbers.

Additions, subtractions, products, quotients, comparisons, absolute values, minima and maxima count 1, roots, powers and elementary functions 20, as in
`Class.flops`; integers and signs count nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import control

Floats = NDArray[np.float64]
#: A root, a power, an elementary function.
ELEMENTARY = 20


class Meter:
    """Operations and calls by (group, kind of call); what a call makes within another counts for the inner one."""

    def __init__(self) -> None:
        self.flops: Counter[tuple[int, str]] = Counter()
        self.calls: Counter[tuple[int, str]] = Counter()
        self._now: list[tuple[int, str]] = []

    def add(self, count: int) -> None:
        """Count operations for the call under way."""
        if self._now:
            self.flops[self._now[-1]] += count

    def wrap(self, g: int, kind: Callable[[], str] | str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its calls counted. `kind` may be asked anew for each."""

        def counted(*args: Any) -> Any:
            key = (g, kind if isinstance(kind, str) else kind())
            self.calls[key] += 1
            self._now.append(key)
            try:
                return function(*args)
            finally:
                self._now.pop()

        return counted


class Number:
    """A float that tells a meter of every operation on it."""

    __slots__ = ("meter", "value")

    def __init__(self, value: float, meter: Meter) -> None:
        self.value, self.meter = value, meter

    def _made(self, value: float, count: int = 1) -> Number:
        self.meter.add(count)
        return Number(value, self.meter)

    def __add__(self, other: Any) -> Any:
        return self._made(self.value + plain(other)) if _is_scalar(other) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        return self._made(self.value - plain(other)) if _is_scalar(other) else NotImplemented

    def __rsub__(self, other: Any) -> Number:
        return self._made(plain(other) - self.value)

    def __mul__(self, other: Any) -> Any:
        return self._made(self.value * plain(other)) if _is_scalar(other) else NotImplemented

    def __truediv__(self, other: Any) -> Any:
        return self._made(_quotient(self.value, plain(other))) if _is_scalar(other) else NotImplemented

    def __rtruediv__(self, other: Any) -> Number:
        return self._made(_quotient(plain(other), self.value))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Number:
        return self._made(-self.value, 0)

    def __abs__(self) -> Number:
        return self._made(abs(self.value))

    def _compared(self, answer: bool) -> bool:
        self.meter.add(1)
        return answer

    def __lt__(self, other: Any) -> bool:
        return self._compared(self.value < plain(other))

    def __le__(self, other: Any) -> bool:
        return self._compared(self.value <= plain(other))

    def __gt__(self, other: Any) -> bool:
        return self._compared(self.value > plain(other))

    def __ge__(self, other: Any) -> bool:
        return self._compared(self.value >= plain(other))

    def __eq__(self, other: object) -> bool:
        return self._compared(self.value == plain(other))

    def __ne__(self, other: object) -> bool:
        return self._compared(self.value != plain(other))

    __hash__ = None  # type: ignore[assignment]

    def __int__(self) -> int:
        return int(self.value)

    def __float__(self) -> float:
        return self.value


def plain(x: Any) -> float:
    """The float of a number that counts, or of any other."""
    return x.value if isinstance(x, Number) else float(x)


_plain = np.frompyfunc(plain, 1, 1)


def floats(x: Any) -> Floats:
    """An array of them."""
    return np.asarray(_plain(x), np.float64)


def _is_scalar(x: Any) -> bool:
    return isinstance(x, Number | float | int | np.floating)


def _quotient(a: float, b: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


def dialect(meter: Meter) -> dict[str, Any]:
    """The dialect's functions for numbers that count."""

    def numbers(values: Any) -> Any:
        return np.frompyfunc(lambda v: Number(plain(v), meter), 1, 1)(values)

    def one(function: Callable[..., float], cost: int) -> Callable[..., Number]:
        def counted(*args: Any) -> Number:
            meter.add(cost)
            return Number(function(*map(plain, args)), meter)

        return counted

    def total(v: Any) -> Any:
        while len(v) > 1:
            v = v[: len(v) // 2] + v[len(v) // 2 :]
        return v[0]

    def largest(v: Any) -> Number:
        meter.add(len(v) - 1)
        return Number(float(floats(v).max()), meter)

    return {
        "lane": lambda v, k: v[k],
        "splat": lambda x: numbers(np.full(1, plain(x))),
        "fma": lambda a, b, c: a * b + c,
        "total": total,
        "largest": largest,
        "select": lambda mask, a, b: np.where(np.asarray(mask, bool), a, b),
        "is_finite": lambda x: math.isfinite(plain(x)),
        "max": one(max, 1),
        "min": one(min, 1),
        "power": one(control.power, ELEMENTARY),
        "math": SimpleNamespace(sqrt=one(lambda x: math.sqrt(x) if x >= 0.0 else math.nan, ELEMENTARY)),
    }
