"""Radau IIA of orders 5, 9 and 13: implicit Runge-Kutta, stiffly accurate, L-stable, vectorised over its stages.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.8 (simplified Newton iteration in the eigenvectors of A^-1, starting values,
error estimate) and Hairer and Wanner, J. Comput. Appl. Math. 111 (1999). One value of `Lanes` holds a variable at all stages and, in the lane after
them, at the start of the step, so that one evaluation of the right-hand side serves all stages and the error estimate.

The pieces (`begin`, `iterate`, …) are lowered once for each form of group, with its sizes and functions as constants; `step` decides and is the same
for all. Names in capitals are given by `compose.py`: N states, the tables of `radau_tables.py`, offsets into the workspace (in lanes), and the group's
own functions rhs_fixed (what does not depend on the states), rhs, publish, factor, solve, solve_real.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hierc.runtime.control import after_acceptance, after_rejection, power, propose_end
from hierc.runtime.machine.dialect import (
    Array,
    Lanes,
    at,
    fma,
    invoke,
    is_finite,
    lane,
    put,
    swap_halves,
    total,
    unroll,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.types import LaneConstant, LaneTable
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.methods.radau_tables import Tables
from hierc.runtime.records import ACCEPTED, FULL, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import HEADER, covered, read_inputs, segment

if TYPE_CHECKING:  # given by compose.py
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

    def rhs_fixed(t: Lanes, u: Array[Lanes], p: Array[float], v: Array[Lanes]) -> None: ...
    def rhs(
        t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
    ) -> None: ...
    def publish(t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], y: Array[Lanes]) -> None: ...
    def factor(
        t: float, h: float, x: Array[Lanes], u: Array[Lanes], p: Array[float], factors: Array[Lanes]
    ) -> None: ...
    def solve(b: Array[Lanes], factors: Array[Lanes]) -> None: ...
    def solve_real(b: Array[float], factors: Array[Lanes]) -> None: ...


#: Newton iterations before a step is given up.
MOST_ITERATIONS = 8
#: Fresh Jacobians at the current iterate before a stalled iteration is given up.
MOST_REFRESHES = 2
#: A step over more segments of one source than this is checked for inputs it cannot see.
FEW_SEGMENTS = 2
#: Failed trials of one step before the right-hand side itself is blamed.
MOST_REJECTIONS = 60


# ---- pieces -------------------------------------------------------------------------------------


def initial(g: Group) -> float:
    """First step size, from the size of the states and of their derivatives at the start (Hairer, Norsett and Wanner, II.4)."""
    y = at(g.work, Y)
    f = at(g.work, F)
    for i in range(N):
        y[i] = NODES * 0.0 + g.x[i]
    rhs_fixed(NODES * 0.0 + g.t, g.u, g.p, at(g.work, V))
    rhs(NODES * 0.0 + g.t, y, g.u, g.p, f, at(g.work, V))
    size = 0.0
    speed = 0.0
    for i in range(N):
        w = 1.0 / (g.absolute[i] + g.rtol * abs(g.x[i]))
        size += g.x[i] * w * (g.x[i] * w)
        speed += lane(f[i], 0) * w * (lane(f[i], 0) * w)
    size = math.sqrt(size / N)
    speed = math.sqrt(speed / N)
    h = 0.01 * size / speed
    if not (size > 1e-5 and speed > 1e-5):
        h = 1e-6
    return h


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
            c = at(last, i * LANES)
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
    factor(g.t + g.trial * MIDDLE, g.trial, y, g.u, g.p, at(g.work, FACTORS))
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
    """Norm of what a step cannot see of its inputs: their deviation, between the stages, from the polynomial through the stages.

    A reader whose steps are long beside those of what it reads samples its inputs too thinly, and its error estimate, made of the same samples, would
    not show it. Here the right-hand side is compared at points between the stages with the inputs as they are and as the stages make them seem.
    """
    y = at(g.work, Y)
    z = at(g.work, Z)
    f = at(g.work, F)
    w = at(g.work, W)
    seen = at(g.u, 2 * INPUTS)
    for k in range(INPUTS):
        seen[k] = between(g.u[k])
    for i in range(N):
        y[i] = g.x[i] + between(z[i])
    t = g.t + g.trial * BETWEEN_NODES
    rhs_fixed(t, at(g.u, INPUTS), g.p, at(g.work, V))
    rhs(t, y, at(g.u, INPUTS), g.p, f, at(g.work, V))
    rhs_fixed(t, seen, g.p, at(g.work, V))
    rhs(t, y, seen, g.p, w, at(g.work, V))
    norm = NODES * 0.0
    for i in range(N):
        q = g.trial * (f[i] - w[i]) * (1.0 / (g.absolute[i] + g.rtol * abs(g.x[i])))
        norm = fma(q, q, norm)
    return math.sqrt(total(norm * STAGE_MASK) * (1.0 / (N * STAGES)))


def between(v: Lanes) -> Lanes:
    """Values at the stages and the start to values between them, by the polynomial through all."""
    a = lane(v, 0) * BETWEEN[0]
    for j in unroll(STAGES):
        a = fma(lane(v, j + 1), BETWEEN[j + 1], a)
    return a


def accept(g: Group) -> float:
    """Write the step's segment and advance the states."""
    y = at(g.work, Y)
    z = at(g.work, Z)
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / g.trial
    piece[3] = g.trial
    coefficients = at(piece, HEADER)
    if PUBLISHED > 0:
        for i in range(N):
            y[i] = g.x[i] + z[i]
        out = at(g.work, OUT)
        publish(g.t + g.trial * NODES, y, g.u, g.p, out)
        for k in range(PUBLISHED):
            start = lane(out[k], STAGES)
            put(at(coefficients, (N + k) * LANES), to_powers(out[k] - start, start))
    for i in range(N):
        put(at(coefficients, i * LANES), to_powers(z[i], g.x[i]))
    for i in range(N):
        g.x[i] = g.x[i] + lane(z[i], STAGES - 1)
    return 0.0


def to_powers(z: Lanes, start: float) -> Lanes:
    """Stage increments to the coefficients of the polynomial through them and the start, lowest power in lane 0."""
    a = start * FIRST_LANE
    for j in unroll(STAGES):
        a = fma(lane(z, j), TO_POWERS[j], a)
    return a


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes until one is accepted. Returns one of the codes of `records.py`."""
    if g.count - g.first >= g.capacity:
        return FULL
    if g.h <= 0.0:
        if not covered(g, groups, g.t):
            return WAITING
        read_inputs(g, groups, NODES * 0.0 + g.t, g.t, g.t, g.u)
        g.h = invoke(g.initial, g)
        g.evaluations += 1
    while True:
        if not propose_end(g):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        segments = read_inputs(g, groups, g.t + g.trial * NODES, g.t, g.end, g.u)
        iterations = newton(g)
        if iterations == 0:
            g.failures += 1
            g.h = 0.5 * g.trial if is_finite(g.rate) else 0.1 * g.trial
            g.rejections += 1
            g.contraction = 1.0
            if g.rejections > MOST_REJECTIONS:
                return NOT_FINITE
            continue
        error = invoke(g.estimate, g, 0)
        if error >= 1.0 and (g.count == 0 or g.rejections > 0):
            error = invoke(g.estimate, g, 1)
            g.evaluations += 1
        if segments > FEW_SEGMENTS and error < 1.0:
            t = g.t + g.trial * BETWEEN_NODES
            read_inputs(g, groups, t, g.t, g.end, at(g.u, g.inputs))
            error = max(error, invoke(g.defect, g))
            g.evaluations += 2
        safety = 0.9 * (2.0 * MOST_ITERATIONS + 1.0) / (2.0 * MOST_ITERATIONS + iterations)
        if error < 1.0:
            invoke(g.accept, g)
            after_acceptance(g, error, safety)
            g.previous = g.trial
            g.t = g.end
            g.fresh = 1
            g.rejections = 0
            g.count += 1
            g.steps += 1
            return ACCEPTED
        after_rejection(g, error, safety)
        if g.rejections > MOST_REJECTIONS:
            return NOT_FINITE


def newton(g: Group) -> int:
    """Iterate to convergence; returns the number of iterations, 0 where they failed (g.rate is then infinite if a value was not finite)."""
    invoke(g.begin, g)
    g.jacobians += 1
    g.factorizations += 1
    g.contraction = power(max(g.contraction, 1e-10), 0.8)
    g.rate = 0.5
    refreshes = 0
    k = 0  # iterations with this Jacobian
    done = 0
    change = 0.0
    ratio = 0.0
    while k < MOST_ITERATIONS:
        last = change
        last_ratio = ratio
        change = invoke(g.iterate, g)
        g.evaluations += 1
        g.iterations += 1
        k += 1
        done += 1
        if not is_finite(change):
            g.rate = change
            return 0
        if g.linear == 1:
            return done
        if k > 1:
            ratio = change / max(last, 1e-300)
            g.rate = ratio if k == 2 else math.sqrt(ratio * last_ratio)
            converging = g.rate < 0.99
            if converging:
                g.contraction = g.rate / (1.0 - g.rate)
                converging = g.contraction * change * power(max(g.rate, 1e-10), MOST_ITERATIONS - 1.0 - k) < g.newton_tolerance
            if not converging and change > 0.0:
                if refreshes == MOST_REFRESHES or ratio >= 2.0:
                    return 0
                invoke(g.refresh, g)
                g.jacobians += 1
                g.factorizations += 1
                refreshes += 1
                g.contraction = 1.0
                k = 0
                continue
        if g.contraction * change <= g.newton_tolerance:
            return done
    return 0


# ---- the method ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Radau:
    """Radau IIA with the given tables."""

    tables: Tables
    newton_tolerance: float

    @property
    def name(self) -> str:
        return f"radau{self.tables.order}"

    @property
    def order(self) -> int:
        return self.tables.order

    @property
    def dense_order(self) -> int:
        return self.tables.stages + 1

    @property
    def error_order(self) -> int:
        return self.tables.stages + 1

    @property
    def lanes(self) -> int:
        return self.tables.lanes

    @property
    def degree(self) -> int:
        return self.tables.stages

    @property
    def width(self) -> int:
        return self.tables.lanes

    @property
    def input_rows(self) -> int:
        return 3 * self.tables.lanes  # as they are at the stages, as they are between them, as the stages make them seem

    @property
    def step(self) -> Piece:
        return step

    @property
    def pieces(self) -> tuple[Piece, ...]:
        return (initial, begin, refresh, iterate, estimate, defect, accept)

    def step_names(self) -> Mapping[str, Any]:
        """The stages' places in the step; lane `stages` is its start. Places between them for `defect`."""
        s, lanes = self.tables.stages, self.lanes
        middles = tuple((a + b) / 2.0 for a, b in pairwise((0.0, *self.tables.nodes)))
        return {
            "NODES": LaneConstant((*self.tables.nodes, 0.0, *[1.0] * (lanes - s - 1))),
            "BETWEEN_NODES": LaneConstant(middles + (1.0,) * (lanes - s)),
        }

    def _between(self) -> tuple[tuple[float, ...], ...]:
        """Lagrange interpolation from the stages and the start to the places between them: row j for the value at stage j (the start last)."""
        s = self.tables.stages
        nodes = np.array([*self.tables.nodes, 0.0])
        middles = (np.array([0.0, *self.tables.nodes[:-1]]) + self.tables.nodes) / 2.0
        weights = np.linalg.solve(np.vander(nodes, increasing=True).T, np.vander(middles, s + 1, increasing=True).T)
        return tuple((*map(float, row), *[0.0] * (self.lanes - s)) for row in weights)

    def names(self, composer: Composer) -> Names:
        """Tables, workspace and the functions of one form."""
        tables, n, lanes, s = self.tables, composer.form.states, self.lanes, self.tables.stages
        half = lanes // 2
        offsets = {"Z": 0, "W": n, "Y": 2 * n, "F": 3 * n, "V": 4 * n}
        offsets["OUT"] = 4 * n + composer.saved
        offsets["FACTORS"] = offsets["OUT"] + len(composer.form.published)
        middle = s // 2
        real, imaginary = tables.eigenvalues[:half], tables.eigenvalues[half:]
        names = {
            **self.step_names(),
            **offsets,
            "N": n,
            "INPUTS": composer.form.inputs,
            "BETWEEN": LaneTable(self._between()),
            "LANES": lanes,
            "STAGES": s,
            "HALF": half,
            "PAIRS": (s - 1) // 2,
            "PUBLISHED": len(composer.form.published),
            "MIDDLE": tables.nodes[middle],
            "STAGE_MASK": LaneConstant((1.0,) * s + (0.0,) * (lanes - s)),
            "FIRST_LANE": LaneConstant((1.0,) + (0.0,) * (lanes - 1)),
            "ERROR": LaneConstant(tables.error + (0.0,) * (lanes - s)),
            "REAL_PARTS": LaneConstant(real + real),
            "IMAGINARY_PARTS": LaneConstant(tuple(-v for v in imaginary) + imaginary),
            "TO_EIGEN": LaneTable(tables.to_eigen),
            "FROM_EIGEN": LaneTable(tables.from_eigen),
            "TO_POWERS": LaneTable(tables.to_powers),
            "rhs_fixed": composer.rhs_fixed,
            "rhs": composer.rhs,
            "publish": composer.publish(),
            "factor": composer.factor(tables.eigenvalues, middle),
            "solve": composer.solve(),
            "solve_real": composer.solve_real(),
        }
        elimination = composer.elimination
        work = offsets["FACTORS"] * lanes + composer.factor_size
        return Names(names, work, composer.linear(), elimination.updates, elimination.entries)
