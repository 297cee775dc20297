"""Radau IIA of orders 5, 9 and 13: implicit Runge-Kutta, stiffly accurate, L-stable, vectorised over its stages.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.8 (simplified Newton iteration in the eigenvectors of A^-1, starting values,
error estimate) and Hairer and Wanner, J. Comput. Appl. Math. 111 (1999). `step` decides, and is the same for all groups; what it calls by address are the
pieces of `radau_pieces.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hierc.runtime.control import (
    MOST_REJECTIONS,
    after_acceptance,
    after_rejection,
    power,
    propose_end,
    started,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array, Lanes, at, invoke, is_finite
from hierc.runtime.machine.types import LaneConstant, LaneTable
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.methods.radau_pieces import accept, begin, defect, estimate, initial, iterate, refresh
from hierc.runtime.methods.radau_tables import Tables
from hierc.runtime.records import ACCEPTED, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import covered, finish, read_inputs

if TYPE_CHECKING:  # given by Radau.step_names
    NODES: Lanes
    BETWEEN_NODES: Lanes

#: Newton iterations before a step is given up.
MOST_ITERATIONS = 8
#: Fresh Jacobians at the current iterate before a stalled iteration is given up.
MOST_REFRESHES = 2


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes until one is accepted. Returns one of the codes of `records.py`."""
    if g.h <= 0.0:  # noqa: SIM102 - both sides of an `and` are evaluated in the dialect
        if not started(g, groups, NODES * 0.0 + g.t):
            return WAITING
    while True:
        if not propose_end(g):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        read_inputs(g, groups, g.t + g.trial * NODES, g.t, g.end, g.u)
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
        if error < 1.0:
            read_inputs(g, groups, g.t + g.trial * BETWEEN_NODES, g.t, g.end, at(g.u, g.inputs))
            error = max(error, invoke(g.defect, g))
            g.evaluations += 1
        safety = 0.9 * (2.0 * MOST_ITERATIONS + 1.0) / (2.0 * MOST_ITERATIONS + iterations)
        if error < 1.0:
            invoke(g.accept, g)
            after_acceptance(g, error, safety)
            g.fresh = 1
            finish(g)
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
                converging = (
                    g.contraction * change * power(max(g.rate, 1e-10), MOST_ITERATIONS - 1.0 - k)
                    < g.newton_tolerance
                )
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
        # After one iteration the rate is only the last step's, which says little where the solution turns.
        if max(g.contraction, 1.0 if k == 1 else 0.0) * change <= g.newton_tolerance:
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
    def keeps_work(self) -> bool:
        return False  # what the next step begins with is in the segments

    @property
    def input_rows(self) -> int:
        return (
            3 * self.tables.lanes
        )  # as they are at the stages, as they are between them, as the stages make them seem

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

    def _between(self, *, derivative: bool = False) -> tuple[tuple[float, ...], ...]:
        """Lagrange interpolation from the stages and the start to the places between them, or its derivative by theta.

        Row j is for the value at stage j, the last for the start.
        """
        s = self.tables.stages
        nodes = np.array([*self.tables.nodes, 0.0])
        middles = (np.array([0.0, *self.tables.nodes[:-1]]) + self.tables.nodes) / 2.0
        powers = np.vander(middles, s + 1, increasing=True).T
        if derivative:
            powers = np.vstack([np.zeros(s), np.arange(1, s + 1)[:, None] * powers[:-1]])
        weights = np.linalg.solve(np.vander(nodes, increasing=True).T, powers)
        return tuple((*map(float, row), *[0.0] * (self.lanes - s)) for row in weights)

    def names(self, composer: Composer) -> Names:
        """Tables, workspace and the functions of one form."""
        tables, n, lanes, s = self.tables, composer.form.states, self.lanes, self.tables.stages
        half = lanes // 2
        offsets = {"Z": 0, "W": n, "Y": 2 * n, "F": 3 * n, "V": 4 * n}
        offsets["OUT"] = 4 * n + composer.saved
        offsets["SEEN"] = offsets["OUT"] + len(composer.form.published)
        offsets["FACTORS"] = offsets["SEEN"] + len(composer.form.published)
        middle = s // 2
        real, imaginary = tables.eigenvalues[:half], tables.eigenvalues[half:]
        names = {
            **self.step_names(),
            **offsets,
            "N": n,
            "INPUTS": composer.form.inputs,
            "BETWEEN": LaneTable(self._between()),
            "SLOPE": LaneTable(self._between(derivative=True)),
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
            "solve_lanes": composer.solve_lanes(),
            "solve_real": composer.solve_real(),
        }
        elimination = composer.elimination
        work = offsets["FACTORS"] * lanes + composer.factor_size
        return Names(names, work, composer.linear(), elimination.updates, elimination.entries)
