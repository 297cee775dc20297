"""The inner pieces of an Adams step; `adams.py` says what they are for and in what order they run.

The past of a group is kept as modified divided differences (Shampine and Gordon, Computer Solution of Ordinary Differential Equations, 1975, chapter 5):
row j of the history is the difference of order j, j = 0, 1, …, of the derivatives at the last knots, and, for what other groups read, of its values. A channel's differences stand side by side. For a
step of size h to the knot t + h they are multiplied by `SCALE` to become those of a polynomial that is the sum of rows of `BASIS`,

    basis_0 = 1,  basis_j(theta) = basis_(j-1)(theta) (theta h + past_(j-1))/(h + past_(j-1)),

past_j being the distance of the j-th knot before the last one. All factors are positive in the step, so powers of theta lose nothing.

Each piece is lowered once for each form of group. Capitals are sizes, and offsets into the workspace, which begins with what is the same for all forms.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hierc.runtime.machine.dialect import Array, Lanes, at, fma, lane, outlined, splat, unroll
from hierc.runtime.records import Group
from hierc.runtime.segments import HEADER, segment

#: The highest order of the predictor; the solution's is one more.
HIGHEST = 12
#: Differences kept of everything: for the predictor's polynomial, its corrector's, and the estimate of the error at one order more.
ROWS = HIGHEST + 2
#: A step's error is held to the tolerance over this: those of the many steps of a multistep method add up.
STRICTER = 10.0
#: Steps that are smaller than usual ones by this factor are taken to come to a jump of what other groups read.
SUSPECT = 1e-2

# Offsets into the workspace: one number a row, then `ROWS` a row.
PAST = 0  # distance of earlier knots from the last one
SCALE = PAST + ROWS  # what differences are multiplied by
MEAN = SCALE + ROWS  # mean of the basis over the step
GROWTH = MEAN + ROWS  # error estimates: relative to those of equal steps
EQUAL = GROWTH + ROWS  # error constants of equal steps, by order
BETWEEN = EQUAL + ROWS  # largest values, between the last two knots, of what the polynomials leave out
ERRORS = BETWEEN + ROWS  # norms of the changes that the corrector makes, at three orders; of what others read
BASIS = ERRORS + 4  # coefficients, lowest power first
FIRST = BASIS + ROWS * ROWS  # where the parts begin whose size depends on the form

if TYPE_CHECKING:  # given by Adams.names
    N: int
    WIDTH: int
    DEGREE: int
    PUBLISHED: int
    HISTORY: int
    SEEN: int
    OUT: int
    Y: int
    NEXT: int
    F: int
    CHANGE: int
    V: int
    EQUAL_STEPS: tuple[float, ...]
    LEFT_OUT: tuple[float, ...]

    def rhs_fixed(t: Lanes, u: Array[Lanes], p: Array[float], v: Array[Lanes]) -> None: ...
    def rhs(
        t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
    ) -> None: ...
    def publish(t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], y: Array[Lanes]) -> None: ...


def number(work: Array[Lanes], place: int) -> float:
    """A number of the workspace."""
    return lane(work[place], 0)


def difference(work: Array[Lanes], past: Array[Lanes], j: int) -> float:
    """Difference j of a channel with this past, as the step under trial has it."""
    return number(work, SCALE + j) * number(past, j)


def weight(g: Group, i: int) -> float:
    """One over the tolerance of a state in one step."""
    return STRICTER / (g.absolute[i] + g.rtol * abs(g.x[i]))


@outlined
def derivative(g: Group, t: float, x: Array[Lanes]) -> None:
    """The group's right-hand side, its inputs unchanged since `rhs_fixed`."""
    rhs(splat(t), x, g.u, g.p, at(g.work, F), at(g.work, V))


@outlined
def published(g: Group, t: float, x: Array[Lanes]) -> None:
    """What other groups read beside the states."""
    publish(splat(t), x, g.u, g.p, at(g.work, OUT))


# ---- the first step -----------------------------------------------------------------------------


def initial(g: Group) -> float:
    """Begin a history in which nothing ever changed; the first step's size.

    At order 1 the error is h**2 x''/2. With x'' taken as x'/T and T as the time in which x' crosses the scale of the states, 1/rtol tolerances,
    this is an eighth of the tolerance.
    """
    work = g.work
    begin_tables(work)
    for i in range(N):
        work[Y + i] = splat(g.x[i])
    rhs_fixed(splat(g.t), g.u, g.p, at(work, V))
    derivative(g, g.t, at(work, Y))
    speed = 0.0
    for i in range(N):
        begin_past(at(work, HISTORY + i * ROWS), number(work, F + i))
        q = number(work, F + i) * weight(g, i)
        speed += q * q
    if PUBLISHED > 0:
        published(g, g.t, at(work, Y))
    for r in range(PUBLISHED):
        begin_past(at(work, SEEN + r * ROWS), number(work, OUT + r))
    speed = math.sqrt(speed / N)
    h = 0.5 / (speed * math.sqrt(g.rtol / STRICTER))
    if not (speed > 1e-5):
        h = 1e-6
    return h


def begin_tables(work: Array[Lanes]) -> None:
    """What is known before the first step: the constants, and the first row of everything."""
    for place in range(FIRST):
        work[place] = splat(0.0)
    for j in unroll(ROWS):
        work[PAST + j] = splat(float(j))
        work[EQUAL + j] = splat(EQUAL_STEPS[j])
        work[BETWEEN + j] = splat(LEFT_OUT[j])
    work[SCALE] = splat(1.0)
    work[MEAN] = splat(1.0)
    work[GROWTH] = splat(1.0)
    work[BASIS] = splat(1.0)


def begin_past(past: Array[Lanes], value: float) -> None:
    """A channel that always had this value."""
    past[0] = splat(value)
    for j in range(1, ROWS):
        past[j] = splat(0.0)


# ---- predict, correct ---------------------------------------------------------------------------


def attempt(g: Group) -> float:
    """Predict the states, and the derivatives, which the right-hand side corrects; the norm of the error.

    Leaves the norms of the corrections to the polynomials of the order under trial and the two below.
    """
    work = g.work
    k = g.order_now
    h = g.trial
    for i in range(N):
        past = at(work, HISTORY + i * ROWS)
        mean = 0.0
        end = 0.0
        for j in range(k):
            d = difference(work, past, j)
            mean = fma(number(work, MEAN + j), d, mean)
            end += d
        work[Y + i] = splat(fma(h, mean, g.x[i]))
        work[CHANGE + i] = splat(end)
    rhs_fixed(splat(g.end), g.u, g.p, at(work, V))
    derivative(g, g.end, at(work, Y))
    here = 0.0
    lower = 0.0
    lowest = 0.0
    for i in range(N):
        past = at(work, HISTORY + i * ROWS)
        change = number(work, F + i) - number(work, CHANGE + i)
        work[CHANGE + i] = splat(change)
        w = weight(g, i)
        here = fma(change * w, change * w, here)
        if k > 1:
            change += difference(work, past, k - 1)
            lower = fma(change * w, change * w, lower)
        if k > 2:
            change += difference(work, past, k - 2)
            lowest = fma(change * w, change * w, lowest)
    work[ERRORS] = splat(math.sqrt(here / N))
    work[ERRORS + 1] = splat(math.sqrt(lower / N))
    work[ERRORS + 2] = splat(math.sqrt(lowest / N))
    return h * (number(work, MEAN + k - 1) - number(work, MEAN + k)) * math.sqrt(here / N)


def correct(g: Group) -> float:
    """States and derivatives at the end of the step; the error of what other groups read. Not a number where something is not finite."""
    work = g.work
    factor = g.trial * number(work, MEAN + g.order_now)
    for i in range(N):
        work[NEXT + i] = splat(fma(factor, number(work, CHANGE + i), number(work, Y + i)))
        work[Y + i] = work[F + i]
    derivative(g, g.end, at(work, NEXT))
    if g.watched == 1:
        g.stiffness = stiffness(g)
    error = 0.0
    if PUBLISHED > 0:
        published(g, g.end, at(work, NEXT))
        error = published_error(g)
    work[ERRORS + 3] = splat(error)
    for i in range(N):
        error += 0.0 * number(work, F + i)
    return error


def stiffness(g: Group) -> float:
    """How much the two evaluations at the end of the step differ for what the corrector changed, times the step."""
    work = g.work
    faster = 0.0
    further = 0.0
    for i in range(N):
        a = number(work, F + i) - number(work, Y + i)
        b = number(work, CHANGE + i)
        faster = fma(a, a, faster)
        further = fma(b, b, further)
    if further == 0.0:
        return 0.0
    return math.sqrt(faster / further) / number(work, MEAN + g.order_now)


def last_row(g: Group) -> int:
    """The highest difference of what other groups read: of order k + 1, where there are so many knots."""
    return min(g.order_now, g.count - g.began) + 1


def published_error(g: Group) -> float:
    """The largest term that the polynomials through one knot fewer would leave out, relative to the tolerances.

    What jumps differs from any polynomial however small the step; but a reader only feels the difference as long as the step lasts.
    """
    last = last_row(g)
    worst = 0.0
    for r in range(PUBLISHED):
        value = number(g.work, OUT + r)
        q = STRICTER * abs(deviation(g.work, r, last)) / (g.floor + g.rtol * abs(value))
        if not (q <= worst):  # so that what is not a number stays
            worst = q
    part = 1.0
    if g.trial < SUSPECT * g.usual:
        part = g.trial / g.usual
    return worst * part * number(g.work, BETWEEN + last)


def deviation(work: Array[Lanes], r: int, last: int) -> float:
    """What the polynomial through earlier knots misses a published value by: its difference `last`."""
    d = number(work, OUT + r)
    for j in range(last):
        d -= difference(work, at(work, SEEN + r * ROWS), j)
    return d


# ---- an accepted step ---------------------------------------------------------------------------


def accept(g: Group) -> float:
    """Write the step's segment, extend the histories, advance the states; the norm of the differences that tell of one order more."""
    work = g.work
    k = g.order_now
    h = g.trial
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / h
    piece[3] = h
    above = 0.0
    for i in range(N):
        past = at(work, HISTORY + i * ROWS)
        c = at(piece, HEADER + i * WIDTH)
        powers(work, past, k, number(work, CHANGE + i), at(work, BASIS), at(c, 1))
        c[0] = g.x[i]
        for q in unroll(ROWS - 1):
            c[q + 1] = c[q + 1] * h * (1.0 / (q + 1))
        d = extend(work, past, k + 1, number(work, F + i)) * weight(g, i)
        above = fma(d, d, above)
        g.x[i] = number(work, NEXT + i)
    last = last_row(g)
    for r in range(PUBLISHED):
        past = at(work, SEEN + r * ROWS)
        c = at(piece, HEADER + (N + r) * WIDTH)
        change = deviation(work, r, last)
        powers(work, past, last, change, at(work, BASIS), c)
        c[ROWS - 1] = change * number(work, BASIS + last * ROWS + ROWS - 1)
        extend(work, past, last, number(work, OUT + r))
    return math.sqrt(above / N)


def powers(
    work: Array[Lanes],
    past: Array[Lanes],
    last: int,
    change: float,
    basis: Array[Lanes],
    c: Array[float],
) -> None:
    """Coefficients, but for the highest, of the polynomial with the differences below `last` of a channel, and the last one equal to `change`."""
    for q in unroll(ROWS - 1):
        c[q] = change * lane(basis[last * ROWS + q], 0)
    for j in range(last):
        d = difference(work, past, j)
        for q in unroll(ROWS - 1):
            c[q] = fma(d, lane(basis[j * ROWS + q], 0), c[q])


def extend(work: Array[Lanes], past: Array[Lanes], last: int, value: float) -> float:
    """Differences up to `last` of a channel, with its value at the end of the step."""
    d = value
    for j in range(last):
        old = difference(work, past, j)
        past[j] = splat(d)
        d -= old
    past[last] = splat(d)
    return d
