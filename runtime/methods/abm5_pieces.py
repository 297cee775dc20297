"""The inner pieces of an ABM step; `abm5.py` says what they are for.

The workspace begins with rows of derivatives: 0 at the start of the step, 1 predicted and 2 final at its end. From PAST on come the backward differences D^0 to
D^3 of row 0, a row each, and from SEEN on D^0 to D^4 of what is published. Predictor and corrector use the first four: the predicted value is
x + h sum_j GAMMAS[j] D^j f, and the corrected one adds the last of GAMMAS times h D^4 f as predicted for the end.

As in `explicit.py`, names in capitals and `rhs`, `rhs_fixed`, `publish` are given by `names`. Where g.fresh is 0 there is no history yet, and the step is one of `explicit.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hierc.runtime.machine.dialect import Array, Lanes, at, fma, lane, outlined, splat, unroll
from hierc.runtime.methods.explicit import accept as accept_start
from hierc.runtime.methods.explicit import attempt as attempt_start
from hierc.runtime.methods.explicit import derivative, published
from hierc.runtime.records import Group
from hierc.runtime.segments import HEADER, segment

if TYPE_CHECKING:  # given by ABM5.names
    N: int
    WIDTH: int
    PUBLISHED: int
    Y: int
    NEXT: int
    V: int
    OUT: int
    PAST: int
    SEEN: int
    GAMMA: tuple[float, ...]
    MILNE: float
    LATE: float

    def rhs(
        t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
    ) -> None: ...


def begin(g: Group) -> float:
    """The history at the distance g.trial, from the polynomials of earlier steps."""
    past = at(g.work, PAST)
    seen = at(g.work, SEEN)
    for i in range(N):
        past[i] = g.work[i]
    look_back(g, g.t, seen)
    for j in unroll(4):
        t = g.t - (j + 1) * g.trial
        if j < 3:
            slopes(g, t, at(past, (j + 1) * N))
        look_back(g, t, at(seen, (j + 1) * PUBLISHED))
    differences(past, N, 3)
    differences(seen, PUBLISHED, 4)
    return 0.0


@outlined
def slopes(g: Group, t: float, into: Array[Lanes]) -> None:
    """Derivatives of the states' polynomials at an earlier time."""
    piece = earlier(g, t)
    theta = (t - piece[0]) * piece[2]
    for i in range(N):
        c = at(piece, HEADER + i * WIDTH)
        a = 5.0 * c[5]
        for q in unroll(4):
            a = fma(a, theta, (4.0 - q) * c[4 - q])
        into[i] = splat(a * piece[2])


@outlined
def look_back(g: Group, t: float, into: Array[Lanes]) -> None:
    """What was published at an earlier time."""
    piece = earlier(g, t)
    theta = (t - piece[0]) * piece[2]
    for r in range(PUBLISHED):
        c = at(piece, HEADER + (N + r) * WIDTH)
        a = c[5]
        for q in unroll(5):
            a = fma(a, theta, c[4 - q])
        into[r] = splat(a)


def earlier(g: Group, t: float) -> Array[float]:
    """The group's own segment that holds an earlier time."""
    k = g.count - 1
    while k > g.first and segment(g, k)[0] > t:
        k -= 1
    return segment(g, k)


def differences(v: Array[Lanes], n: int, most: int) -> None:
    """Backward differences of orders 0 to `most`, in place of values at the start of the step and 1, 2, … sizes before it."""
    for order in range(most):
        for k in range(most - order):
            for i in range(n):
                row = (most - k) * n + i
                v[row] = v[row - n] - v[row]


def attempt(g: Group) -> float:
    """The solution at the end of the step; its largest error, relative to the tolerances."""
    if g.fresh == 0:
        return attempt_start(g)
    k = g.work
    past = at(k, PAST)
    p = at(k, Y)
    x = at(k, NEXT)
    h = g.trial
    last = h * GAMMA[4]
    for i in range(N):
        a = GAMMA[3] * lane(past[3 * N + i], 0)
        for j in unroll(3):
            a = fma(GAMMA[2 - j], lane(past[(2 - j) * N + i], 0), a)
        p[i] = splat(fma(h, a, g.x[i]))
    derivative(g, splat(g.end), p, g.u, at(k, N))
    worst = 0.0
    for i in range(N):
        fourth = lane(k[N + i], 0)
        for j in unroll(4):
            fourth = fourth - lane(past[j * N + i], 0)
        end = fma(last, fourth, lane(p[i], 0))
        x[i] = splat(end)
        e = abs(fourth) / (g.absolute[i] + g.rtol * max(abs(g.x[i]), abs(end)))
        if e > worst or e != e:  # what is not a number stays
            worst = e
    return h * MILNE * worst


def accept(g: Group) -> float:
    """The derivative at the end, the step's segment, the differences there, and the new states."""
    if g.fresh == 0:
        return accept_start(g)
    k = g.work
    past = at(k, PAST)
    x = at(k, NEXT)
    h = g.trial
    evaluate_again(g, splat(g.end), x, at(k, 2 * N))
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / h
    piece[3] = h
    half = h / 2.0
    quarter = h / 4.0
    small = h / 24.0
    late = h * LATE
    for i in range(N):
        start = lane(past[i], 0)
        last = lane(past[3 * N + i], 0)
        advance(past, N, 4, i, lane(k[2 * N + i], 0))
        d2 = quarter * lane(past[2 * N + i], 0)
        d3 = small * lane(past[3 * N + i], 0)
        d4 = fma(small, lane(past[3 * N + i], 0) - last, late * lane(k[2 * N + i] - k[N + i], 0))
        c = at(piece, HEADER + i * WIDTH)
        c[0] = g.x[i]
        c[1] = h * start
        c[2] = fma(half, lane(past[N + i], 0), -d2) - 2.0 * d3 - d4
        c[3] = (2.0 * d2 - d4) / 3.0
        c[4] = fma(0.5, d4, d3)
        c[5] = 0.2 * d4
        g.x[i] = lane(x[i], 0)
        k[i] = past[i]
    if PUBLISHED > 0:
        interpolate(g, piece)
    return 0.0


@outlined
def evaluate_again(g: Group, t: Lanes, x: Array[Lanes], dx: Array[Lanes]) -> None:
    """The right-hand side at the time and inputs of its last evaluation."""
    rhs(t, x, g.u, g.p, dx, at(g.work, V))


def interpolate(g: Group, piece: Array[float]) -> None:
    """Polynomials of what is published through its values at the step's ends and at four places before."""
    seen = at(g.work, SEEN)
    out = at(g.work, OUT)
    published(g, splat(g.end), at(g.work, NEXT), g.u, out)
    for r in range(PUBLISHED):
        start = lane(seen[r], 0)
        last = lane(seen[4 * PUBLISHED + r], 0)
        advance(seen, PUBLISHED, 5, r, lane(out[r], 0))
        d2 = lane(seen[2 * PUBLISHED + r], 0) / 2.0
        d3 = lane(seen[3 * PUBLISHED + r], 0) / 6.0
        d4 = lane(seen[4 * PUBLISHED + r], 0) / 24.0
        d5 = (lane(seen[4 * PUBLISHED + r], 0) - last) / 120.0
        c = at(piece, HEADER + (N + r) * WIDTH)
        c[0] = start
        c[1] = lane(seen[PUBLISHED + r], 0) - d2 - d3 - 2.0 * d4 - 6.0 * d5
        c[2] = d2 - d4 - 5.0 * d5
        c[3] = d3 + 2.0 * d4 + 5.0 * d5
        c[4] = d4 + 5.0 * d5
        c[5] = d5


def advance(v: Array[Lanes], n: int, count: int, i: int, value: float) -> None:
    """Backward differences one step later, where component i has this value."""
    new = value
    for j in range(count):
        old = lane(v[j * n + i], 0)
        v[j * n + i] = splat(new)
        new = new - old
