"""External functions for the tests: what users write."""

from __future__ import annotations

import functools
import math
from math import tanh

import numpy as np

SLOPE = 3
HUGE = 10**30
calls: list[float] = []


def smooth(v: float) -> float:
    return tanh(v / 0.01)


def coulomb(v: float) -> float:
    """Friction with everything that is compiled."""
    force = 1.5 * smooth(v)
    extra: float = 0.25
    if v > SLOPE or (1 < v < 2 and not v > 1.9):
        force += 0.1 * v**2 + extra
    elif v < -1:
        force -= max(v, -2.0) - min(v, -1.5)
    else:
        pass
    rest = abs(v) if v else math.pi
    return force + 1e-3 * math.atan2(rest, 2) + v**-2 if v else -force


def inverse(v: float) -> float:
    return 1 / v


def two(a: float, b: float) -> float:
    return a / (1 + b * b)


def with_list(v: float) -> float:
    total = sum([v, 1.0])
    return total


def with_loop(v: float) -> float:
    s = 0.0
    for k in range(3):
        s += v * k
    return s


def with_numpy(v: float) -> float:
    return np.tanh(v)


def with_root(v: float) -> float:
    return abs(v) ** 0.5


def no_return(v: float) -> float:  # type: ignore[return]
    if v > 0:
        return v


def unset(v: float) -> float:
    if v > 0:
        w = 1.0
    return w


def with_default(v: float, k: float = 2) -> float:
    return k * v


def huge(v: float) -> float:
    return v * HUGE


def as_value(v: float) -> float:
    return v or 1.0


def recorded(v: float) -> float:
    calls.append(v)
    return 2.0 * v


def norm(v: list[float], k: float) -> float:
    return k * float(np.linalg.norm(v))


def fails(v: float) -> float:
    if v > 0.5:
        raise RuntimeError("the sensor\nfell off")
    return -float(str(v))


def gives_text(v: float) -> str:
    return "fast"


def of_array(v: float) -> object:
    return np.where(v > 0, v, 0.0)


@functools.cache
def cached(v: float) -> float:
    return v


class Holder:
    factor = 2.0

    @staticmethod
    def scaled(v: float) -> float:
        return Holder.factor * v


constant = 3.0
