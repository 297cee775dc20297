"""Explicit Runge-Kutta methods with native dense output: the step, for any tables.

Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, sections II.4 to II.6 and II.10. Stage s + 1 is the derivative at the end of the step, the
first of the next one; stages after it serve the dense output only.

As in `radau.py`, pieces are lowered once for each form of group; names in capitals and `rhs`, `rhs_fixed`, `publish` are given by `names`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hierc.runtime.control import (
    MOST_REJECTIONS,
    MOST_SEGMENTS,
    after_acceptance,
    after_rejection,
    first_size,
    propose_end,
    started,
    watch_stability,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array, Lanes, at, fma, invoke, lane, outlined, splat, unroll
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.records import ACCEPTED, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import HEADER, covered, finish, read_inputs, segment

Row = tuple[float, ...]
_SAFETY = 0.9


@dataclass(frozen=True, slots=True)
class ExplicitTables:
    """One method of s stages. `a` has rows for stages 2, 3, …, those after s + 1 for dense output; `nodes` all stages' places.

    Steps beyond `radius`/|lambda| are taken to be bounded by stability. `error` and `second_error` weigh the stages in the error estimates (Hairer's combination of two where there is a second);
    x(theta) = x + h sum_j theta**(j+1) sum_i dense[j][i] k_i.
    """

    name: str
    order: int
    error_order: int
    radius: float
    nodes: Row
    a: tuple[Row, ...]
    b: Row
    error: Row
    second_error: Row
    dense: tuple[Row, ...]

    @property
    def stages(self) -> int:
        """Stages before the one at the end of the step."""
        return len(self.b)


def matrix_of_nested_form(b: Row, d: tuple[Row, ...]) -> tuple[Row, ...]:
    """Dense output of the form x + theta (F0 + (1 - theta) (F1 + theta (F2 + (1 - theta) (F3 + …)))) as powers of theta.

    F0 = h b.k, F1 = h k_1 - F0, F2 = 2 F0 - h (k_1 + k_end), F3, … = h d.k (DOP853, HNW section II.10).
    """
    count = len(d[0])
    end = len(b)
    first, last = np.eye(count)[0], np.eye(count)[end]
    step = np.concatenate([b, np.zeros(count - end)])
    rows = [step, first - step, 2 * step - first - last, *map(np.asarray, d)]
    powers = np.zeros((1, count))
    for k in range(len(rows) - 1, -1, -1):
        powers[0] += rows[k]
        shifted = np.vstack([np.zeros((1, count)), powers])  # times theta
        powers = shifted if k % 2 == 0 else np.vstack([powers, np.zeros((1, count))]) - shifted
    return tuple(tuple(map(float, row)) for row in powers[1:])


if TYPE_CHECKING:  # given by Explicit.names
    N: int
    INPUTS: int
    STAGES: int
    LAST_STAGE: int
    DEGREE: int
    WIDTH: int
    PUBLISHED: int
    Y: int
    NEXT: int
    V: int
    OUT: int
    A: tuple[Row, ...]
    B: Row
    C: Row
    ERROR: Row
    SECOND_ERROR: Row
    DENSE: tuple[Row, ...]
    FIT_NODES: Row
    FIT: tuple[Row, ...]

    TWO_ERRORS: bool
    SAFETY: float
    RADIUS: float

    def rhs_fixed(t: Lanes, u: Array[Lanes], p: Array[float], v: Array[Lanes]) -> None: ...
    def rhs(
        t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
    ) -> None: ...
    def publish(t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], y: Array[Lanes]) -> None: ...


# ---- pieces -------------------------------------------------------------------------------------


@outlined
def derivative(g: Group, t: Lanes, x: Array[Lanes], u: Array[Lanes], dx: Array[Lanes]) -> None:
    """The group's right-hand side."""
    rhs_fixed(t, u, g.p, at(g.work, V))
    rhs(t, x, u, g.p, dx, at(g.work, V))


def initial(g: Group) -> float:
    """First stage of the first step, and the step's size."""
    y = at(g.work, Y)
    for i in range(N):
        y[i] = splat(g.x[i])
    derivative(g, splat(g.t), y, g.u, g.work)
    return first_size(g, g.work)


def attempt(g: Group) -> float:
    """All stages and the solution at the end of the step; the norm of its error."""
    k = g.work
    y = at(g.work, Y)
    x = at(g.work, NEXT)
    h = g.trial
    for s in unroll(STAGES - 1):
        for i in range(N):
            a = 0.0
            for j in unroll(s + 1):
                if A[s][j] != 0.0:
                    a = fma(A[s][j], lane(k[j * N + i], 0), a)
            y[i] = splat(fma(h, a, g.x[i]))
        derivative(g, splat(g.t + C[s + 1] * h), y, at(g.u, (s + 1) * INPUTS), at(k, (s + 1) * N))
    for i in range(N):
        a = 0.0
        for j in unroll(STAGES):
            if B[j] != 0.0:
                a = fma(B[j], lane(k[j * N + i], 0), a)
        x[i] = splat(fma(h, a, g.x[i]))
    derivative(g, splat(g.end), x, at(g.u, STAGES * INPUTS), at(k, STAGES * N))
    if g.watched == 1:
        g.stiffness = stiffness(g)
    return error_norm(g)


def stiffness(g: Group) -> float:
    """How much the last two stages, both at the end of the step, differ in their derivatives for what they differ in the states, times the step."""
    k = g.work
    y = at(g.work, Y)
    x = at(g.work, NEXT)
    faster = 0.0
    further = 0.0
    for i in range(N):
        a = lane(k[STAGES * N + i], 0) - lane(k[(STAGES - 1) * N + i], 0)
        b = lane(x[i], 0) - lane(y[i], 0)
        faster = fma(a, a, faster)
        further = fma(b, b, further)
    if further == 0.0:
        return 0.0
    return g.trial * math.sqrt(faster / further)


def error_norm(g: Group) -> float:
    """Root mean square of the error estimate, relative to the tolerances."""
    k = g.work
    x = at(g.work, NEXT)
    main = 0.0
    second = 0.0
    for i in range(N):
        scale = 1.0 / (g.absolute[i] + g.rtol * max(abs(g.x[i]), abs(lane(x[i], 0))))
        e = 0.0
        for j in unroll(STAGES + 1):
            if ERROR[j] != 0.0:
                e = fma(ERROR[j], lane(k[j * N + i], 0), e)
        main += e * scale * (e * scale)
        if TWO_ERRORS:
            e = 0.0
            for j in unroll(STAGES + 1):
                if SECOND_ERROR[j] != 0.0:
                    e = fma(SECOND_ERROR[j], lane(k[j * N + i], 0), e)
            second += e * scale * (e * scale)
    if TWO_ERRORS:
        if main == 0.0 and second == 0.0:
            return 0.0
        return g.trial * main / math.sqrt((main + 0.01 * second) * N)
    return g.trial * math.sqrt(main / N)


def accept(g: Group) -> float:
    """The extra stages, the step's segment, and the new states."""
    k = g.work
    y = at(g.work, Y)
    h = g.trial
    for s in unroll(LAST_STAGE - STAGES):
        for i in range(N):
            a = 0.0
            for j in unroll(STAGES + 1 + s):
                if A[STAGES + s][j] != 0.0:
                    a = fma(A[STAGES + s][j], lane(k[j * N + i], 0), a)
            y[i] = splat(fma(h, a, g.x[i]))
        derivative(
            g,
            splat(g.t + C[STAGES + 1 + s] * h),
            y,
            at(g.u, (STAGES + 1 + s) * INPUTS),
            at(k, (STAGES + 1 + s) * N),
        )
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / h
    piece[3] = h
    for i in range(N):
        c = at(piece, HEADER + i * WIDTH)
        c[0] = g.x[i]
        for q in unroll(DEGREE):
            a = 0.0
            for j in unroll(LAST_STAGE + 1):
                if DENSE[q][j] != 0.0:
                    a = fma(DENSE[q][j], lane(k[j * N + i], 0), a)
            c[q + 1] = h * a
    if PUBLISHED > 0:
        fit(g, piece)
    x = at(g.work, NEXT)
    for i in range(N):
        g.x[i] = lane(x[i], 0)
        k[i] = k[STAGES * N + i]
    return 0.0


def fit(g: Group, piece: Array[float]) -> None:
    """Polynomials through the published outs at the fit nodes, from the states' own polynomials there."""
    y = at(g.work, Y)
    for m in unroll(DEGREE + 1):
        for i in range(N):
            c = at(piece, HEADER + i * WIDTH)
            a = c[DEGREE]
            for q in unroll(DEGREE):
                a = fma(a, FIT_NODES[m], c[DEGREE - 1 - q])
            y[i] = splat(a)
        u = at(g.u, (LAST_STAGE + 1 + m) * INPUTS)
        published(g, splat(g.t + FIT_NODES[m] * g.trial), y, u, at(g.work, OUT + m * PUBLISHED))
    out = at(g.work, OUT)
    for r in range(PUBLISHED):
        c = at(piece, HEADER + (N + r) * WIDTH)
        for q in unroll(DEGREE + 1):
            a = 0.0
            for m in unroll(DEGREE + 1):
                a = fma(FIT[q][m], lane(out[m * PUBLISHED + r], 0), a)
            c[q] = a


@outlined
def published(g: Group, t: Lanes, x: Array[Lanes], u: Array[Lanes], out: Array[Lanes]) -> None:
    """What other groups read beside the states."""
    publish(t, x, u, g.p, out)


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes until one is accepted. Returns one of the codes of `records.py`."""
    if g.h <= 0.0:  # noqa: SIM102 - both sides of an `and` are evaluated in the dialect
        if not started(g, groups, splat(g.t)):
            return WAITING
    while True:
        if not propose_end(g):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        segments = read_at_stages(g, groups)
        if segments > MOST_SEGMENTS:
            g.h = g.trial * (0.9 * MOST_SEGMENTS / segments)
            continue
        error = invoke(g.attempt, g)
        g.evaluations += STAGES
        if error < 1.0:
            complete(g, groups)
            after_acceptance(g, error, SAFETY)
            finish(g)
            if g.watched == 1:
                watch_stability(g, RADIUS)
            return ACCEPTED
        after_rejection(g, error, SAFETY)
        if g.rejections > MOST_REJECTIONS:
            return NOT_FINITE


def read_at_stages(g: Group, groups: Array[Group]) -> int:
    """Inputs at all stages. Returns the most segments of one source that the step touches."""
    segments = 0
    for s in unroll(LAST_STAGE + 1):
        t = g.t + C[s] * g.trial
        segments = max(segments, read_inputs(g, groups, splat(t), g.t, t, at(g.u, s * g.inputs)))
    return segments


def complete(g: Group, groups: Array[Group]) -> None:
    """What is left to do of a step whose error is small enough."""
    if g.published > 0:
        for m in unroll(DEGREE + 1):
            t = g.t + FIT_NODES[m] * g.trial
            read_inputs(g, groups, splat(t), g.t, t, at(g.u, (LAST_STAGE + 1 + m) * g.inputs))
    invoke(g.accept, g)
    g.evaluations += LAST_STAGE - STAGES


# ---- the method ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Explicit:
    """An explicit Runge-Kutta method with the given tables."""

    tables: ExplicitTables

    @property
    def name(self) -> str:
        return self.tables.name

    @property
    def order(self) -> int:
        return self.tables.order

    @property
    def dense_order(self) -> int:
        return len(self.tables.dense)

    @property
    def error_order(self) -> int:
        return self.tables.error_order

    @property
    def lanes(self) -> int:
        return 1

    @property
    def degree(self) -> int:
        return len(self.tables.dense)

    @property
    def width(self) -> int:
        return 8

    @property
    def newton_tolerance(self) -> float:
        return 0.0

    @property
    def keeps_work(self) -> bool:
        return True  # the derivatives at the end of a step, where the next one begins

    @property
    def step(self) -> Piece:
        return step

    @property
    def pieces(self) -> tuple[Piece, ...]:
        return (initial, attempt, accept)

    @property
    def input_rows(self) -> int:
        """Times at which a step reads its inputs."""
        return len(self.tables.a) + 1 + self.degree + 1

    def step_names(self) -> Mapping[str, Any]:
        """Sizes and nodes."""
        tables = self.tables
        fit_nodes = tuple((1.0 - math.cos(math.pi * m / self.degree)) / 2.0 for m in range(self.degree + 1))
        return {
            "STAGES": tables.stages,
            "LAST_STAGE": len(tables.a),
            "DEGREE": self.degree,
            "C": (*tables.nodes,),
            "FIT_NODES": fit_nodes,
            "SAFETY": _SAFETY,
            "RADIUS": tables.radius,
        }

    def names(self, composer: Composer) -> Names:
        """Tables, workspace and the functions of one form."""
        tables, n = self.tables, composer.form.states
        shared = self.step_names()
        nodes = np.array(shared["FIT_NODES"])
        fit = np.linalg.inv(np.vander(nodes, increasing=True))
        rows = len(tables.a) + 1
        published = len(composer.form.published)

        def padded(row: Row, length: int) -> Row:
            return row + (0.0,) * (length - len(row))

        offsets = {"Y": rows * n, "NEXT": (rows + 1) * n, "V": (rows + 2) * n}
        offsets["OUT"] = offsets["V"] + composer.saved
        names = {
            **shared,
            **offsets,
            "N": n,
            "INPUTS": composer.form.inputs,
            "WIDTH": self.width,
            "PUBLISHED": published,
            "A": tables.a,
            "B": tables.b,
            "ERROR": padded(tables.error, tables.stages + 1),
            "SECOND_ERROR": padded(tables.second_error, tables.stages + 1),
            "TWO_ERRORS": bool(tables.second_error),
            "DENSE": tuple(padded(row, rows) for row in tables.dense),
            "FIT": tuple(tuple(map(float, row)) for row in fit),
            "rhs_fixed": composer.rhs_fixed,
            "rhs": composer.rhs,
            "publish": composer.publish(),
        }
        return Names(names, offsets["OUT"] + (self.degree + 1) * published, composer.linear())
