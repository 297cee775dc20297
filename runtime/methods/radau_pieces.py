"""The inner pieces of a Radau step, each a few lines of arithmetic over lanes; `radau.py` says what they are for and in what order they run.

One value of `Lanes` holds a variable at all stages and, in the lane after them, at the start of the step, so that one evaluation of the right-hand side
serves all stages and the error estimate.

Each piece is lowered once for each form of group, with its sizes and functions as constants. Those stand in capitals: N states, INPUTS inputs, the tables
of `radau_tables.py`, offsets into the workspace (in lanes). The group's own functions are rhs_fixed (what does not depend on the states), rhs, publish,
factor, solve and solve_real, made by `machine/compose.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hierc.runtime.control import first_size
from hierc.runtime.machine.dialect import (
    Array,
    Lanes,
    at,
    fma,
    lane,
    largest,
    put,
    swap_halves,
    total,
    unroll,
)
from hierc.runtime.records import Group
from hierc.runtime.segments import HEADER, segment

if TYPE_CHECKING:  # given by Radau.names
    N: int
    INPUTS: int
    LANES: int
    STAGES: int
    HALF: int
    PAIRS: int
    PUBLISHED: int
    MIDDLE: float
    Z: int
    W: int
    Y: int
    F: int
    V: int
    OUT: int
    SEEN: int
    FACTORS: int
    NODES: Lanes
    BETWEEN_NODES: Lanes
    STAGE_MASK: Lanes
    FIRST_LANE: Lanes
    ERROR: Lanes
    REAL_PARTS: Lanes
    IMAGINARY_PARTS: Lanes
    TO_EIGEN: Array[Lanes]
    FROM_EIGEN: Array[Lanes]
    TO_POWERS: Array[Lanes]
    BETWEEN: Array[Lanes]
    SLOPE: Array[Lanes]

    def rhs_fixed(t: Lanes, u: Array[Lanes], p: Array[float], v: Array[Lanes]) -> None: ...
    def rhs(
        t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
    ) -> None: ...
    def publish(t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], y: Array[Lanes]) -> None: ...
    def factor(
        t: float,
        h: float,
        x: Array[Lanes],
        u: Array[Lanes],
        p: Array[float],
        v: Array[Lanes],
        factors: Array[Lanes],
    ) -> None: ...
    def solve(b: Array[Lanes], factors: Array[Lanes]) -> None: ...
    def solve_lanes(b: Array[Lanes], factors: Array[Lanes]) -> None: ...
    def solve_real(b: Array[float], factors: Array[Lanes]) -> None: ...


#: Steps that are smaller than usual ones by this factor are taken to come to a jump of what other groups read.
SUSPECT = 1e-2


def initial(g: Group) -> float:
    """First step size."""
    y = at(g.work, Y)
    f = at(g.work, F)
    for i in range(N):
        y[i] = NODES * 0.0 + g.x[i]
    rhs_fixed(NODES * 0.0 + g.t, g.u, g.p, at(g.work, V))
    rhs(NODES * 0.0 + g.t, y, g.u, g.p, f, at(g.work, V))
    return first_size(g, f)


def begin(g: Group) -> float:
    """Predict the stages from the last step's polynomial, and factor the Newton matrix at the middle one."""
    z = at(g.work, Z)
    w = at(g.work, W)
    t = g.t + g.trial * NODES
    rhs_fixed(t, g.u, g.p, at(g.work, V))
    if g.fresh == 1:
        last = at(segment(g, g.count - 1), HEADER)
        theta = 1.0 + NODES * (g.trial / g.previous)
        for i in range(N):
            c = at(last, i * g.width)
            a = NODES * 0.0 + c[STAGES]
            for q in unroll(STAGES):
                a = fma(a, theta, c[STAGES - 1 - q])
            z[i] = STAGE_MASK * (a - g.x[i])
            w[i] = to_eigen(z[i])
    else:
        for i in range(N):
            z[i] = NODES * 0.0
            w[i] = NODES * 0.0
    return refresh(g)


def refresh(g: Group) -> float:
    """Jacobian at the middle stage of the current iterate, and its factors."""
    y = at(g.work, Y)
    z = at(g.work, Z)
    for i in range(N):
        y[i] = g.x[i] + z[i]
    factor(g.t + g.trial * MIDDLE, g.trial, y, g.u, g.p, at(g.work, V), at(g.work, FACTORS))
    return 0.0


def to_eigen(v: Lanes) -> Lanes:
    """Stage values to packed eigen-components."""
    a = lane(v, 0) * TO_EIGEN[0]
    for j in unroll(STAGES - 1):
        a = fma(lane(v, j + 1), TO_EIGEN[j + 1], a)
    return a


def from_eigen(v: Lanes) -> Lanes:
    """Packed eigen-components to stage values; two sums, for the processor's sake."""
    a = lane(v, 0) * FROM_EIGEN[0]
    b = lane(v, HALF + 1) * FROM_EIGEN[HALF + 1]
    for k in unroll(PAIRS):
        a = fma(lane(v, k + 1), FROM_EIGEN[k + 1], a)
        if k > 0:
            b = fma(lane(v, HALF + k + 1), FROM_EIGEN[HALF + k + 1], b)
    return a + b


def iterate(g: Group) -> float:
    """One simplified Newton iteration; the norm of its correction, relative to the tolerances."""
    y = at(g.work, Y)
    z = at(g.work, Z)
    w = at(g.work, W)
    f = at(g.work, F)
    for i in range(N):
        y[i] = g.x[i] + z[i]
    rhs(g.t + g.trial * NODES, y, g.u, g.p, f, at(g.work, V))
    for i in range(N):
        a = to_eigen(g.trial * f[i])
        y[i] = a - REAL_PARTS * w[i] - IMAGINARY_PARTS * swap_halves(w[i])
    solve(y, at(g.work, FACTORS))
    norm = NODES * 0.0
    for i in range(N):
        w[i] = w[i] + y[i]
        d = from_eigen(y[i])
        z[i] = z[i] + d
        q = d * (1.0 / (g.absolute[i] + g.rtol * abs(g.x[i])))
        norm = fma(q, q, norm)
    return math.sqrt(total(norm * STAGE_MASK) * (1.0 / (N * STAGES)))


def estimate(g: Group, again: int) -> float:
    """Norm of the local error. `again` filters the estimate once more, which spares rejections after a bad start."""
    y = at(g.work, Y)
    z = at(g.work, Z)
    f = at(g.work, F)
    e = at(g.x, N)
    if again == 1:
        for i in range(N):
            y[i] = NODES * 0.0 + (g.x[i] + e[i])
        rhs(g.t + g.trial * NODES, y, g.u, g.p, f, at(g.work, V))
    for i in range(N):
        e[i] = g.trial * lane(f[i], STAGES) + total(z[i] * ERROR)
    solve_real(e, at(g.work, FACTORS))
    norm = 0.0
    for i in range(N):
        largest = max(abs(g.x[i]), abs(g.x[i] + lane(z[i], STAGES - 1)))
        q = e[i] / (g.absolute[i] + g.rtol * largest)
        norm += q * q
    return math.sqrt(norm / N)


def defect(g: Group) -> float:
    """Norm of the error between the knots: of the step's polynomials for the states, and of those for what other groups read.

    Between the stages, the derivative of the states' polynomial is compared with the right-hand side at its values and the inputs as they are there; the
    Newton matrix turns the difference into an error of the states. So inputs that move faster than the stages can see show, as does a solution
    that turns faster than its polynomial. What other groups read is computed there and compared with its own polynomial; where that jumps, the
    difference counts by the part that the step is of usual ones, for so much less does a reader gather of it.
    """
    y = at(g.work, Y)
    z = at(g.work, Z)
    f = at(g.work, F)
    u = at(g.u, INPUTS)
    t = g.t + g.trial * BETWEEN_NODES
    for i in range(N):
        y[i] = g.x[i] + between(z[i])
    rhs_fixed(t, u, g.p, at(g.work, V))
    rhs(t, y, u, g.p, f, at(g.work, V))
    for i in range(N):
        f[i] = g.trial * f[i] - slope(z[i])
    solve_lanes(f, at(g.work, FACTORS))
    norm = NODES * 0.0
    for i in range(N):
        q = f[i] * (1.0 / (g.absolute[i] + g.rtol * abs(g.x[i])))
        norm = fma(q, q, norm)
    worst = largest(norm * STAGE_MASK) * (1.0 / N)
    if PUBLISHED > 0:
        out = at(g.work, OUT)
        seen = at(g.work, SEEN)
        for i in range(N):
            f[i] = g.x[i] + z[i]
        publish(g.t + g.trial * NODES, f, g.u, g.p, out)
        publish(t, y, u, g.p, seen)
        # What jumps differs from any polynomial however small the step; but a reader only feels the difference as long as the step lasts.
        weight = 1.0
        if g.trial < SUSPECT * g.usual:
            weight = g.trial / g.usual
        for k in range(PUBLISHED):
            q = (seen[k] - between(out[k])) * (weight / (g.floor + g.rtol * abs(seen[k])))
            worst = max(worst, largest(q * q * STAGE_MASK))
    return math.sqrt(worst)


def slope(z: Lanes) -> Lanes:
    """Stage increments to the derivatives of their polynomial, by theta, between the stages."""
    a = lane(z, 0) * SLOPE[0]
    for j in unroll(STAGES - 1):
        a = fma(lane(z, j + 1), SLOPE[j + 1], a)
    return a


def between(v: Lanes) -> Lanes:
    """Values at the stages and the start to values between them, by the polynomial through all."""
    a = lane(v, 0) * BETWEEN[0]
    for j in unroll(STAGES):
        a = fma(lane(v, j + 1), BETWEEN[j + 1], a)
    return a


def accept(g: Group) -> float:
    """Write the step's segment and advance the states."""
    z = at(g.work, Z)
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / g.trial
    piece[3] = g.trial
    coefficients = at(piece, HEADER)
    if PUBLISHED > 0:
        out = at(g.work, OUT)  # filled by `defect`
        for k in range(PUBLISHED):
            start = lane(out[k], STAGES)
            put(at(coefficients, (N + k) * g.width), to_powers(out[k] - start, start))
    for i in range(N):
        put(at(coefficients, i * g.width), to_powers(z[i], g.x[i]))
    for i in range(N):
        g.x[i] = g.x[i] + lane(z[i], STAGES - 1)
    return 0.0


def to_powers(z: Lanes, start: float) -> Lanes:
    """Stage increments to the coefficients of the polynomial through them and the start, lowest power in lane 0."""
    a = start * FIRST_LANE
    for j in unroll(STAGES):
        a = fma(lane(z, j), TO_POWERS[j], a)
    return a
