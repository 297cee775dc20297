"""MATLAB's ode45, single-rate: Dormand and Prince 5(4) with its error control and its continuous extension.

Dormand and Prince, J. Comput. Appl. Math. 6 (1980); Shampine and Reichelt, SIAM J. Sci. Comput. 18 (1997). The largest component of the error counts, relative
to max(|y|, atol/rtol). The text runs on floats and on numbers that count (`counting.py`); products with coefficients that are zero are left out, though
MATLAB makes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from counting import ELEMENTARY, Floats, Meter, Number, floats, plain

C = (0.2, 0.3, 0.8, 8 / 9, 1.0, 1.0)
A = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
#: Powers 1 to 4 of the place in the step, for each stage.
DENSE = np.array(
    [
        (1.0, -183 / 64, 37 / 12, -145 / 128),
        (0.0, 0.0, 0.0, 0.0),
        (0.0, 1500 / 371, -1000 / 159, 1000 / 371),
        (0.0, -125 / 32, 125 / 12, -375 / 64),
        (0.0, 9477 / 3392, -729 / 106, 25515 / 6784),
        (0.0, -11 / 7, 11 / 3, -55 / 28),
        (0.0, 1.5, -4.0, 2.5),
    ]
)

Rhs = Callable[[float, Floats], Floats]


@dataclass(frozen=True, slots=True)
class Solution:
    """States (k, n) at the times asked for, and what was done."""

    states: Floats
    steps: int
    rejected: int
    evaluations: int


def ode45(
    rhs: Rhs, stop: float, start: Any, tolerance: float, times: Floats, most_steps: float = np.inf
) -> Solution:
    """From 0 to `stop`, rtol = atol = tolerance; `start` (n,) may be numbers that count. `times` (k,) ascend from 0."""
    y, t, out = start, 0.0, np.full((len(times), len(start)), np.nan)
    done, steps, rejected = 0, 0, 0
    f = rhs(t, y)
    evaluations = 1
    fastest = max(abs(plain(d)) / max(abs(plain(v)), 1.0) for d, v in zip(f, y, strict=True))
    h = min(0.1 * stop, 0.8 * tolerance**0.2 / fastest)
    while t < stop and steps < most_steps:
        h = min(h, 0.1 * stop)
        last = 1.1 * h >= stop - t
        if last:
            h = stop - t
        failed = False
        while True:
            stages, end = _stages(rhs, t, y, f, h)
            evaluations += 6
            error = h * _norm(stages, y, end)
            if plain(error) <= tolerance:
                break
            rejected += 1
            h = 0.5 * h if failed else h * max(0.1, 0.8 * (tolerance / plain(error)) ** 0.2)
            failed, last = True, False
        while done < len(times) and (times[done] <= t + h or last):
            theta = (times[done] - t) / h
            powers = theta ** np.arange(1, 5)
            out[done] = floats(y) + h * (DENSE @ powers) @ floats(np.array(stages))
            done += 1
        t, y, f = stop if last else t + h, end, stages[-1]
        steps += 1
        if not failed:
            growth = 1.25 * (plain(error) / tolerance) ** 0.2
            h = h / growth if growth > 0.2 else 5.0 * h
    return Solution(out, steps, rejected, evaluations)


def _stages(rhs: Rhs, t: float, y: Any, f: Any, h: float) -> tuple[list[Any], Any]:
    """The seven stages, and the states at the end of the step."""
    stages, inner = [f], y
    for c, row in zip(C, A, strict=True):
        inner = y
        for a, k in zip(row, stages, strict=True):
            if a != 0.0:
                inner = inner + (h * a) * k
        stages.append(rhs(t + c * h, inner))
    return stages, inner


def _norm(stages: list[Any], y: Any, end: Any) -> Any:
    terms = [e * k for e, k in zip(ERROR, stages, strict=True) if e != 0.0]
    error = terms[0]
    for term in terms[1:]:
        error = error + term
    return np.max(np.abs(error) / np.maximum(np.maximum(np.abs(y), np.abs(end)), 1.0))


def cost_of_a_step(rhs: Rhs, stop: float, start: Floats, tolerance: float) -> float:
    """Operations of a step beside right-hand sides: counted over some steps, and the control of the size, which works on plain floats."""
    meter = Meter()
    numbers = np.frompyfunc(lambda v: Number(float(v), meter), 1, 1)

    def counted(t: float, y: Any) -> Any:
        return numbers(rhs(t, floats(y)))

    solve = meter.wrap(0, "ode45", ode45)
    found = solve(counted, stop, numbers(start), tolerance, np.zeros(0), _COUNTED)
    attempts = found.steps + found.rejected
    scalars = sum(a != 0.0 for row in A for a in row) + 2 * len(C)  # h*a and t + c*h
    return float(meter.flops[0, "ode45"] / attempts + scalars + _CONTROL)


_COUNTED = 20
#: A power and what is done with it.
_CONTROL = ELEMENTARY + 8
