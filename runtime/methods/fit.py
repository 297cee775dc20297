"""The channels of a group without states: polynomials through what it computes of its inputs.

A sum over ten thousand agents, each with steps of its own, is no polynomial on any step; what several groups read of it is one all the same, of degree 7,
through its values at the Chebyshev-Lobatto places of a step, so it is continuous. It is compared with the sum at places between them. How far it may be off
follows from what it is made of: nobody knows a sum better than its terms. So the tolerance is `rtol` of the value, and what the value changes by when
every input is off by its own tolerance, with signs at random: where large terms cancel, that is what remains of them. Without it, the small kinks at the
knots of ten thousand terms would be resolved one by one.

As in `radau.py`, pieces are lowered once for each form of group; names in capitals and `publish` are given by `names`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hierc.runtime.control import (
    MOST_REJECTIONS,
    after_acceptance,
    after_rejection,
    begin_with,
    propose_end,
    resolution,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import (
    Array,
    Lanes,
    at,
    fma,
    invoke,
    is_finite,
    lane,
    largest,
    put,
    total,
    unroll,
)
from hierc.runtime.machine.split import switches
from hierc.runtime.machine.types import LaneConstant, LaneTable
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.records import ACCEPTED, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import HEADER, covered, finish, read_inputs, segment

if TYPE_CHECKING:  # given by Fit.names
    LANES: int
    PUBLISHED: int
    OUT: int
    SEEN: int
    BLURRED: int
    PLACES: Lanes
    CHECKED: Lanes
    ODD: Lanes
    PAIRS: Lanes
    HALVES: Lanes
    NEGATIVE: Lanes
    FIRST_LANE: Lanes
    BETWEEN: Array[Lanes]
    TO_POWERS: Array[Lanes]
    SAFETY: float

    def publish(t: Lanes, x: Array[Lanes], u: Array[Lanes], p: Array[float], y: Array[Lanes]) -> None: ...


#: Lanes of a value, one more than the polynomial's degree.
_LANES = 8
#: A step that is so many times as long as a segment of what it reads is made shorter: of as many equal parts, each holds a place that is looked at. Where
#: what is computed has branches, these parts are shorter than the segments: another agent may be the largest for a part of one of its own only.
MOST_SEGMENTS, MOST_SEGMENTS_OF_BRANCHES = 8, 2
#: What rounding leaves uncertain of a polynomial's value, relative to it.
ROUNDING = 1e-13
#: Steps that are smaller than usual ones by this factor are taken to come to a jump; at a kink, as an extreme has, they need not be as small.
SUSPECT = 1e-5
_SAFETY = 0.9


# ---- pieces -------------------------------------------------------------------------------------


def attempt(g: Group) -> float:
    """What the group publishes, at the polynomial's places and where it is checked."""
    publish(g.t + g.trial * PLACES, g.work, g.u, g.p, at(g.work, OUT))
    publish(g.t + g.trial * CHECKED, g.work, at(g.u, g.inputs), g.p, at(g.work, SEEN))
    return 0.0


def defect(g: Group) -> float:
    """The largest error of the polynomials where they are checked, in tolerances; the inputs there are blurred by now. Not a number where a value is none."""
    seen = at(g.work, SEEN)
    blurred = at(g.work, BLURRED)
    publish(g.t + g.trial * CHECKED, g.work, at(g.u, g.inputs), g.p, blurred)
    # What jumps differs from any polynomial however small the step; but a reader only feels the difference as long as the step lasts.
    weight = 1.0
    if g.trial < SUSPECT * g.usual:
        weight = g.trial / g.usual
    worst = 0.0
    sound = 0.0
    for k in range(PUBLISHED):
        v = at(g.work, OUT)[k]
        off = blurred[k] - seen[k]
        noise = math.sqrt(total(off * off) / LANES)
        if not is_finite(noise):
            noise = 0.0  # where it is defined, the edge is nearer than the tolerance
        tolerance = g.rtol * largest(abs(seen[k])) + noise + 1e-300
        error = largest(abs(seen[k] - between(v))) * (weight / tolerance)
        worst = max(worst, error)
        sound += 0.0 * (error + total(v))
    return worst + sound


def between(v: Lanes) -> Lanes:
    """Values where the polynomial through v is checked."""
    a = lane(v, 0) * BETWEEN[0]
    for j in unroll(LANES - 1):
        a = fma(lane(v, j + 1), BETWEEN[j + 1], a)
    return a


def accept(g: Group) -> float:
    """Write the step's segment."""
    piece = segment(g, g.count)
    piece[0] = g.t
    piece[1] = g.end
    piece[2] = 1.0 / g.trial
    piece[3] = g.trial
    out = at(g.work, OUT)
    for k in range(PUBLISHED):
        start = lane(out[k], 0)
        put(at(piece, HEADER + k * LANES), to_powers(out[k] - start, start))
    return 0.0


def to_powers(v: Lanes, start: float) -> Lanes:
    """Coefficients of the polynomial through v, which is 0 at the start, and moved by `start`; lowest power in lane 0."""
    a = start * FIRST_LANE
    for j in unroll(LANES - 1):
        a = fma(lane(v, j + 1), TO_POWERS[j + 1], a)
    return a


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes until one is accepted. Returns one of the codes of `records.py`."""
    if g.h <= 0.0:
        if not covered(g, groups, g.t):
            return WAITING
        begin_with(g, shortest(g, groups))
    most = MOST_SEGMENTS if g.linear == 1 else MOST_SEGMENTS_OF_BRANCHES
    least = 2.0 * resolution(g.t, g.stop)
    while True:
        if not propose_end(g):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        segments = read_inputs(g, groups, g.t + g.trial * PLACES, g.t, g.end, g.u)
        if segments > most and g.trial > least:
            g.h = max(g.trial * (0.9 * most / segments), least)
            continue
        read_inputs(g, groups, g.t + g.trial * CHECKED, g.t, g.end, at(g.u, g.inputs))
        invoke(g.attempt, g)
        blur(g, groups, at(g.u, g.inputs))
        error = invoke(g.defect, g)
        g.evaluations += 3
        # Close to the spacing of doubles nothing is left to resolve.
        if error < 1.0 or (g.trial <= least and is_finite(error)):
            invoke(g.accept, g)
            after_acceptance(g, error, SAFETY)
            g.h = max(g.h, least)
            finish(g)
            return ACCEPTED
        after_rejection(g, error, SAFETY)
        if g.rejections > MOST_REJECTIONS:
            return NOT_FINITE
        if g.h >= g.min_step:
            g.h = max(g.h, least)


def shortest(g: Group, groups: Array[Group]) -> float:
    """The shortest segment of what g reads, at g.t; where it reads nothing, a part of the run."""
    h = 1e-3 * (g.stop - g.t)
    for s in range(g.source_count):
        source = g.sources[s]
        h = min(h, segment(groups[source.group], source.cursor)[3])
    return h


def blur(g: Group, groups: Array[Group], u: Array[Lanes]) -> None:
    """Add to each input its tolerance, that of the state it is or of its group for an out.

    Signs: over the lanes one of the eight rows of a Hadamard matrix, so that inputs of different rows do not meet in a mean square; which row, beyond the
    eighth input, and as a whole plus or minus, is by chance, another one in each trial.
    """
    chance = g.evaluations + 1
    for s in range(g.source_count):
        source = g.sources[s]
        up = groups[source.group]
        for i in range(source.count):
            k = source.first + i
            channel = (g.channels[k] - HEADER) // up.width
            absolute = up.floor
            if channel < up.n:
                absolute = up.absolute[channel]
            chance = (chance * 1103515245 + 12345) % 2147483648
            row = k if k < LANES else chance // 65536
            sign = sign_of(row, ODD) * sign_of(row // 2, PAIRS) * sign_of(row // 4, HALVES)
            sign = sign * sign_of(chance // 524288, NEGATIVE)
            u[k] = u[k] + sign * (absolute + (up.rtol + ROUNDING) * abs(u[k]))


def sign_of(chance: int, signs: Lanes) -> Lanes:
    """`signs` where a number is odd, otherwise 1."""
    odd = 1.0 * (chance % 2)
    return 1.0 - odd + odd * signs


# ---- the method ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Fit:
    """What a group without states has in place of an integration method."""

    name: str = "fit"
    order: int = _LANES
    dense_order: int = _LANES
    error_order: int = _LANES
    lanes: int = _LANES
    degree: int = _LANES - 1
    width: int = _LANES
    input_rows: int = 2 * _LANES
    newton_tolerance: float = 0.0
    keeps_work: bool = False

    @property
    def step(self) -> Piece:
        return step

    @property
    def pieces(self) -> tuple[Piece, ...]:
        return (attempt, defect, accept)

    def step_names(self) -> Mapping[str, Any]:
        """Places in the step, and signs."""
        lanes = range(_LANES)
        return {
            "PLACES": LaneConstant(tuple(map(float, _places()))),
            "CHECKED": LaneConstant(tuple(map(float, _checked()))),
            "ODD": LaneConstant(tuple(1.0 - 2.0 * (k % 2) for k in lanes)),
            "PAIRS": LaneConstant(tuple(1.0 - 2.0 * (k // 2 % 2) for k in lanes)),
            "HALVES": LaneConstant(tuple(1.0 - 2.0 * (k // 4) for k in lanes)),
            "NEGATIVE": LaneConstant((-1.0,) * _LANES),
            "LANES": _LANES,
            "SAFETY": _SAFETY,
        }

    def names(self, composer: Composer) -> Names:
        """Tables, workspace and the functions of one form."""
        published = len(composer.form.published)
        names = {
            **self.step_names(),
            "OUT": 0,
            "SEEN": published,
            "BLURRED": 2 * published,
            "PUBLISHED": published,
            "FIRST_LANE": LaneConstant((1.0,) + (0.0,) * (_LANES - 1)),
            "BETWEEN": LaneTable(_rows(np.vander(_checked(), _LANES, increasing=True).T)),
            "TO_POWERS": LaneTable(_rows(np.eye(_LANES))),
            "publish": composer.publish(),
        }
        parts = {composer.classes[call.kind].parts[call.part].function for call in composer.form.publishing}
        smooth = not any(switches(composer.definitions(part)) for part in parts)
        return Names(names, 3 * published * _LANES, linear=smooth)


def _places() -> np.ndarray[Any, np.dtype[np.float64]]:
    """The polynomial's places in a step."""
    found = (1.0 - np.cos(np.pi * np.arange(_LANES) / (_LANES - 1))) / 2.0
    return np.asarray(found, np.float64)


def _checked() -> np.ndarray[Any, np.dtype[np.float64]]:
    """Places between them, and one more in the widest gap."""
    middles = (1.0 - np.cos(np.pi * (np.arange(_LANES - 1) + 0.5) / (_LANES - 1))) / 2.0
    return np.append(middles, 0.44)


def _rows(powers: np.ndarray[Any, np.dtype[np.float64]]) -> tuple[tuple[float, ...], ...]:
    """For each place a row of lanes: what its value contributes to sums of powers, given as columns."""
    weights = np.linalg.solve(np.vander(_places(), _LANES, increasing=True).T, powers)
    return tuple(tuple(map(float, row)) for row in weights)


FIT = Fit()
