"""Step-size control, shared by the methods: from an error estimate to the next step size.

The predictive controller of Gustafsson (ACM TOMS 20, 1994) with the usual limits: a step grows at most eightfold and shrinks at most to a tenth.
"""

from __future__ import annotations

import math

from hierc.runtime.machine.dialect import Array, Lanes, bits, from_bits, invoke, lane
from hierc.runtime.records import Group
from hierc.runtime.segments import covered, read_inputs

#: A method is asked about once so many steps seem to be bounded by stability.
SEEM_STIFF = 15
#: Failed trials of one step before the right-hand side itself is blamed.
MOST_REJECTIONS = 60
#: An explicit step sees too little of inputs that change within more segments than this: it is made shorter.
MOST_SEGMENTS = 4
#: Steps below this many spacings of doubles at t make no progress.
SMALLEST = 10.0


def power(x: float, y: float) -> float:
    """x**y for x > 0, to about three digits: enough for step sizes, and far cheaper than `pow`."""
    b = bits(x)
    exponent = b // 4503599627370496 - 1023
    m = from_bits(b % 4503599627370496 + 4607182418800017408)
    log2 = exponent + (-2.153620718 + m * (3.047884142 + m * (-1.051875137 + m * 0.158248743)))
    z = min(max(log2 * y, -1000.0), 1000.0)
    whole = int(z + 2000.0) - 2000
    f = z - whole
    mantissa = 1.0 + f * (0.695556856 + f * (0.226173111 + f * 0.078024437))
    return from_bits((whole + 1023) * 4503599627370496) * mantissa


def resolution(t: float, end: float) -> float:
    """The size of steps between these times that make no progress."""
    return SMALLEST * 2.220446049250313e-16 * max(abs(t), abs(end))


def propose_end(g: Group) -> bool:
    """Set g.trial and g.end from g.h: lands on the stop, never leaves a sliver before it. False where the step is too small to advance t."""
    h = min(g.h, g.max_step)
    left = g.stop - g.t
    if h >= left * (1.0 - 1e-12):
        g.end = g.stop
        h = left
    else:
        if h > 0.5 * left:
            h = 0.5 * left
        g.end = g.t + h
    g.trial = h
    return g.end > g.t and ((h > resolution(g.t, g.end) and h >= g.min_step) or g.end == g.stop)


def first_size(g: Group, derivatives: Array[Lanes]) -> float:
    """A first step size, from the size of the states and of their derivatives at the start (Hairer, Norsett and Wanner, II.4)."""
    size = 0.0
    speed = 0.0
    for i in range(g.n):
        w = 1.0 / (g.absolute[i] + g.rtol * abs(g.x[i]))
        size += g.x[i] * w * (g.x[i] * w)
        speed += lane(derivatives[i], 0) * w * (lane(derivatives[i], 0) * w)
    size = math.sqrt(size / g.n)
    speed = math.sqrt(speed / g.n)
    h = 0.01 * size / speed
    if not (size > 1e-5 and speed > 1e-5):
        h = 1e-6
    return h


def started(g: Group, groups: Array[Group], t: Lanes) -> bool:
    """Set the first step size, from the derivatives at g.t, which is in all lanes of t; False where what the group reads is not known there yet."""
    if not covered(g, groups, g.t):
        return False
    read_inputs(g, groups, t, g.t, g.t, g.u)
    begin_with(g, invoke(g.initial, g))
    g.evaluations += 1
    return True


def begin_with(g: Group, h: float) -> None:
    """Set the first step size: h, but not so small that it is lost beside t, nor below the user's least."""
    lost = 1000.0 * SMALLEST * 2.220446049250313e-16 * abs(g.t)
    g.h = max(h, max(lost, g.min_step))  # noqa: PLW3301 - the dialect's max has two arguments


def after_acceptance(g: Group, error: float, safety: float) -> None:
    """Next step size after an accepted step of size g.trial."""
    predicted = 1.0
    if g.last_size > 0.0 and g.last_error > 0.0 and error > 0.0:
        predicted = min(1.0, g.trial / g.last_size * power(g.last_error / error, 1.0 / g.order))
    factor = 8.0
    if error > 0.0:
        factor = min(8.0, max(0.2, safety * predicted * power(error, -1.0 / g.order)))
    if g.rejections > 0:
        factor = min(factor, 1.0)
    g.last_size = g.trial
    g.usual = max(g.trial, g.usual - 0.5 * g.trial)
    g.last_error = max(error, 1e-2)
    g.h = g.trial * factor


def after_rejection(g: Group, error: float, safety: float) -> None:
    """Next trial after an error estimate of 1 or more; one that is not a number counts as very large."""
    factor = 0.1
    if error == error:
        factor = max(0.1, safety * power(error, -1.0 / g.order))
    g.h = g.trial * factor
    g.rejections += 1
    g.rejected += 1


def watch_stability(g: Group, radius: float) -> None:
    """Count the steps lately that the method's stability seems to bound; where they are many, ask for a review (Hairer and Wanner, IV.2).

    After one that changed nothing, only when patience ends or steps have become much shorter.
    """
    if g.stiffness > radius:
        g.limited = min(g.limited + 1, SEEM_STIFF)
    else:
        g.limited = max(0, g.limited - 3)
    if g.limited >= SEEM_STIFF and (g.steps >= g.patience or g.trial < g.alarm):
        g.limited = 0
        g.review = g.steps
