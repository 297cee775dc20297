"""Adams' predictor and corrector of variable step and order 1 to 12: two evaluations a step, for right-hand sides that cost much and are not stiff.

Shampine and Gordon, Computer Solution of Ordinary Differential Equations (1975), chapters 5 to 7 and 10; Hairer, Norsett and Wanner, Solving Ordinary
Differential Equations I, section III.5. The predictor of order k is corrected by one of order k + 1, whose solution is kept. The order rises or falls by
one, as the errors that orders k - 2 to k + 1 would make with equal steps say; the step is doubled or kept, so that steps are often equal,
or it shrinks. A step's segment is the polynomial that its corrector integrates; what other groups read is a polynomial through its values at the last knots,
one of which is at the step's end, and so costs one evaluation a step.

As in `radau.py`, `step` decides, the same for all groups; what it calls by address are the pieces of `adams_pieces.py`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from hierc.runtime.control import (
    MOST_REJECTIONS,
    MOST_SEGMENTS,
    power,
    propose_end,
    started,
    watch_stability,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array, invoke, is_finite, splat
from hierc.runtime.methods.adams_pieces import (
    BASIS,
    EQUAL,
    ERRORS,
    FIRST,
    GROWTH,
    HIGHEST,
    MEAN,
    PAST,
    ROWS,
    SCALE,
    accept,
    attempt,
    correct,
    initial,
    number,
)
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.records import ACCEPTED, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import covered, finish, read_inputs

if TYPE_CHECKING:  # given by Adams.step_names
    LEAST_ORDER: int
    MOST_ORDER: int

#: Steps beyond this over |lambda| are taken to be bounded by stability.
RADIUS = 0.6
#: The error that steps aim at, relative to the tolerance.
AIM = 0.5


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes and orders until one is accepted. Returns one of the codes of `records.py`."""
    if g.h <= 0.0:
        if not started(g, groups, splat(g.t)):
            return WAITING
        g.began = g.count
        g.order_now = 1
        g.alike = 0
        g.regular = 1
    while True:
        if not propose_end(g):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        if read_inputs(g, groups, splat(g.end), g.t, g.end, g.u) > MOST_SEGMENTS:
            g.h = 0.5 * g.trial
            continue
        coefficients(g)
        error = invoke(g.attempt, g)
        g.evaluations += 1
        if error < 1.0:
            error = invoke(g.correct, g)
            g.evaluations += 1
        if error < 1.0:
            above = invoke(g.accept, g)
            after_acceptance(g, above)
            if g.watched == 1:
                watch_stability(g, RADIUS)
            return ACCEPTED
        after_rejection(g, error)
        if g.rejections > MOST_REJECTIONS:
            return NOT_FINITE


def in_a_row(g: Group) -> int:
    """Steps of the trial's size in a row, itself among them."""
    return g.alike + 1 if g.trial == g.previous else 1


def coefficients(g: Group) -> None:
    """The tables of the workspace for the step under trial. Rows that only equal steps have a part in are there already."""
    row = in_a_row(g)
    first = max(1, min(g.regular, row))
    g.regular = row
    h = g.trial
    for j in range(first, ROWS):
        past = number(g.work, PAST + j - 1)
        whole = past + h
        g.work[SCALE + j] = splat(number(g.work, SCALE + j - 1) * whole / number(g.work, PAST + j))
        g.work[GROWTH + j] = splat(number(g.work, GROWTH + j - 1) * j * h / whole)
        mean = 0.0
        before = 0.0
        for q in range(j + 1):
            same = number(g.work, BASIS + (j - 1) * ROWS + q)
            c = (h * before + past * same) / whole
            g.work[BASIS + j * ROWS + q] = splat(c)
            mean += c / (q + 1)
            before = same
        g.work[MEAN + j] = splat(mean)


def estimate(g: Group, order: int) -> float:
    """The error that the trial's size would make at its order k, or at k - 1 or k - 2, were all steps equal."""
    norm = number(g.work, ERRORS + g.order_now - order)
    return g.trial * number(g.work, GROWTH + order) * number(g.work, EQUAL + order) * norm


def better_below(g: Group) -> bool:
    """Whether the orders below the trial's look no worse."""
    k = g.order_now
    if k <= LEAST_ORDER or k == 1:
        return False
    if k == 2:
        return estimate(g, 1) <= 0.5 * estimate(g, 2)
    return max(estimate(g, k - 1), estimate(g, k - 2)) <= estimate(g, k)


def after_acceptance(g: Group, above: float) -> None:
    """Order and size of the next step; `above` is the norm of the differences that tell of order k + 1."""
    k = g.order_now
    row = in_a_row(g)
    knots = g.count - g.began
    building = k == knots + 1 and k < MOST_ORDER and (knots == 0 or g.rejections == 0)
    below = better_below(g)
    error = estimate(g, k)
    if below:
        g.order_now = k - 1
        error = estimate(g, k - 1)
    elif building:
        g.order_now = k + 1
    elif k < row:
        higher = g.trial * number(g.work, EQUAL + k + 1) * above
        if k > max(LEAST_ORDER, 1) and estimate(g, k - 1) <= min(error, higher):
            g.order_now = k - 1
            error = estimate(g, k - 1)
        elif k < MOST_ORDER and higher < (error if k > 1 else 0.5 * error):
            g.order_now = k + 1
            error = higher
    error = max(error, number(g.work, ERRORS + 3))
    doubled = error * power(2.0, g.order_now + 1.0)
    g.h = g.trial
    if (building and not below) or doubled <= AIM:
        g.h = 2.0 * g.trial
    elif error > AIM:
        g.h = g.trial * max(0.5, min(0.9, power(AIM / error, 1.0 / (g.order_now + 1.0))))
    for j in range(1, ROWS):
        g.work[PAST + ROWS - j] = splat(number(g.work, PAST + ROWS - j - 1) + g.trial)
    g.usual = max(g.trial, g.usual - 0.5 * g.trial)
    g.alike = row
    finish(g)


def after_rejection(g: Group, error: float) -> None:
    """Order and size of the next trial."""
    g.rejections += 1
    g.rejected += 1
    factor = 0.5
    if not is_finite(error):
        factor = 0.1
    elif g.order_now == 1:
        factor = max(0.01, min(0.5, math.sqrt(AIM / max(estimate(g, 1), AIM))))
    elif better_below(g):
        g.order_now -= 1
    if g.rejections >= 3:
        g.order_now = 1
    g.h = g.trial * factor


# ---- the method ---------------------------------------------------------------------------------


@functools.cache
def equal_steps() -> tuple[float, ...]:
    """Size of the error constants of Adams' correctors by order, |int_0^1 (s - 1) s … (s + j - 2)/j! ds|; 0 at order 0."""
    return (0.0, *(abs(float(integral(falling(j)))) for j in range(1, ROWS)))


@functools.cache
def left_out() -> tuple[float, ...]:
    """Largest |(s - 1) s … (s + j - 2)/j!| for s between 0 and 1; below two knots nothing is known, and 0 stands for that."""
    places = [k / 64 for k in range(65)]
    largest = [max(abs(evaluate(falling(j), s)) for s in places) for j in range(2, ROWS)]
    return (0.0, 0.0, *largest)


def falling(j: int) -> list[Fraction]:
    """Coefficients of (s - 1) s … (s + j - 2)/j!, lowest power first."""
    powers = [Fraction(1)]
    for m in range(j):
        shifted = [Fraction(0), *powers]
        powers = [(a + (m - 1) * b) / (m + 1) for a, b in zip(shifted, [*powers, Fraction(0)], strict=True)]
    return powers


def integral(powers: list[Fraction]) -> Fraction:
    """Integral of a polynomial from 0 to 1."""
    return sum((c / (q + 1) for q, c in enumerate(powers)), Fraction(0))


def evaluate(powers: list[Fraction], s: float) -> float:
    return sum(float(c) * s**q for q, c in enumerate(powers))


@dataclass(frozen=True, slots=True)
class Adams:
    """Adams' methods of these orders; with the two equal, the one method as soon as there is a past."""

    least_order: int = 1
    most_order: int = HIGHEST

    @property
    def name(self) -> str:
        whole = (self.least_order, self.most_order) == (1, HIGHEST)
        return "adams" if whole else f"adams{self.least_order}to{self.most_order}"

    @property
    def order(self) -> int:
        return self.most_order + 1

    @property
    def dense_order(self) -> int:
        return self.most_order + 1

    @property
    def error_order(self) -> int:
        return self.most_order + 1

    @property
    def lanes(self) -> int:
        return 1

    @property
    def degree(self) -> int:
        return ROWS - 1

    @property
    def width(self) -> int:
        return ROWS

    @property
    def newton_tolerance(self) -> float:
        return 0.0

    @property
    def keeps_work(self) -> bool:
        return True  # the past

    @property
    def input_rows(self) -> int:
        return 1

    @property
    def step(self) -> Piece:
        return step

    @property
    def pieces(self) -> tuple[Piece, ...]:
        return (initial, attempt, correct, accept)

    def step_names(self) -> Mapping[str, Any]:
        """The orders."""
        return {"LEAST_ORDER": self.least_order, "MOST_ORDER": self.most_order}

    def names(self, composer: Composer) -> Names:
        """Constants, workspace and the functions of one form."""
        n, published = composer.form.states, len(composer.form.published)
        sizes = {
            "HISTORY": ROWS * n, "SEEN": ROWS * published, "OUT": published, "Y": n, "NEXT": n, "F": n, "CHANGE": n,
            "V": composer.saved,
        }  # fmt: skip
        ends = list(accumulate(sizes.values(), initial=FIRST))
        names = {
            **dict(zip(sizes, ends, strict=False)),
            "N": n,
            "WIDTH": self.width,
            "PUBLISHED": published,
            "EQUAL_STEPS": equal_steps(),
            "LEFT_OUT": left_out(),
            "rhs_fixed": composer.rhs_fixed,
            "rhs": composer.rhs,
            "publish": composer.publish(),
        }
        return Names(names, ends[-1], composer.linear())
