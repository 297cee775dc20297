"""Adams-Bashforth-Moulton of order 5 with integer step ratios: the multirate method of the paper that hierc began with.

J. M. Esposito and V. Kumar, "Efficient dynamic simulation of robotic systems with hierarchy", ICRA 2001. Each group predicts by Adams-Bashforth,
evaluates, corrects by Adams-Moulton and evaluates again (PECE); Milne's device takes the error from the difference of the two. A group's steps are equal
parts of the way to the next knot of what it reads: h_i = r_i h_(i+1), the ratio chosen anew at each such knot. So slow groups step first, every knot of a
group is one of all its readers, and in between these read its polynomials of degree 5.

Predictor and corrector use the same four derivatives. The corrected value with its estimated error taken out is that of the Adams-Moulton formula of order 5,
and the best that four derivatives give: a predictor of order 5 would need a fifth, and steps a third shorter where stability limits them. The
history is kept as backward differences (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, III.1); at another step size it is
read off the polynomials of earlier steps. The first steps are made by Tsit5, as are those after a jump.

`step` decides, and is the same for all groups; what it calls by address are the pieces of `abm5_pieces.py` and, for a start, of `explicit.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from hierc.runtime.control import (
    MOST_REJECTIONS,
    after_acceptance,
    after_rejection,
    power,
    resolution,
    started,
)
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array, acquire, invoke, splat
from hierc.runtime.methods.abm5_pieces import accept, attempt, begin
from hierc.runtime.methods.explicit import Explicit, complete, initial, read_at_stages
from hierc.runtime.methods.method import Names, Piece
from hierc.runtime.methods.tsit5 import TSIT5
from hierc.runtime.records import ACCEPTED, NOT_FINITE, TOO_SMALL, WAITING, Group
from hierc.runtime.segments import covered, finish, read_inputs, segment

#: Adams-Bashforth in backward differences, and the corrector's; see `abm5_pieces.py`.
GAMMAS = (Fraction(1), Fraction(1, 2), Fraction(5, 12), Fraction(3, 8), Fraction(251, 720))
#: Milne's estimate in h D^4 f: 19/270 of the difference of predictor and corrector, both of order 4.
MILNES = Fraction(19, 720)
#: The last term of a step's polynomial is that of the final derivative, and this much of how the final one differs from the predicted.
LATER = Fraction(251, 456)
#: Failed trials of one step before the history is blamed.
MOST_TRIALS = 3
#: A longer step must be worth a new history: where a new way to a knot begins, and on the way.
WORTHWHILE, ON_THE_WAY = 1.05, 1.5
#: A step that need not be shorter than this part of itself is kept.
KEPT = 0.8
#: Steps of a new size before it may grow: an unstable one takes a while to show.
HELD = 5.5
#: After a failed trial steps stay below this part of its size, which each step raises by so much: so a size that stability limits is found, not tried again and again.
LOWERED, RAISED = 0.8, 1.01
#: Sizes that differ by less than this part of them are the same, but for rounding.
_SAME = 1e-9
_SAFETY = 0.8
#: An error that allows a step of twice the size.
_TINY = (_SAFETY / 2.0) ** 5
#: The method of the first steps; a last coefficient of zero gives its polynomials our degree.
_START = Explicit(replace(TSIT5, dense=(*TSIT5.dense, (0.0,) * len(TSIT5.nodes))))

if TYPE_CHECKING:  # given by step_names
    STAGES: int
    SAFETY: float
    TINY: float
    SAME: float


# ---- the step -----------------------------------------------------------------------------------


def step(g: Group, groups: Array[Group]) -> float:
    """Take one step: try sizes until one is accepted. Returns one of the codes of `records.py`."""
    mark = next_knot(g, groups)
    if mark <= g.t:
        return WAITING
    if g.h <= 0.0:
        if not started(g, groups, splat(g.t)):
            return WAITING
        g.origin = g.t
        g.ceiling = g.stop - g.t
    while True:
        if not divide(g, mark):
            return TOO_SMALL
        if not covered(g, groups, g.end):
            return WAITING
        error = attempt_step(g, groups)
        if error < 1.0:
            close(g, groups, error)
            return ACCEPTED
        after_rejection(g, error, SAFETY)
        if g.rejections == 1:
            g.ceiling = LOWERED * g.trial
        if g.rejections > MOST_REJECTIONS:
            return NOT_FINITE
        if g.rejections > MOST_TRIALS:
            g.fresh = 0  # the history may reach over a jump
            g.origin = g.t


def next_knot(g: Group, groups: Array[Group]) -> float:
    """Where the step must end at the latest: at the next knot of what the group reads. Not after g.t where that is not known yet.

    What has no states follows the steps of those that it reads, and its own knots stand close to theirs: nobody lands on them.
    """
    mark = g.stop
    for s in range(g.source_count):
        source = g.sources[s]
        up = groups[source.group]
        if up.n == 0:
            continue
        if up.t <= g.t:
            return g.t
        acquire()
        k = source.cursor
        while segment(up, k)[1] <= g.t:
            k += 1
        source.cursor = k
        mark = min(mark, segment(up, k)[1])
    return mark


def divide(g: Group, mark: float) -> bool:
    """Set g.trial and g.end to one of equal parts of the way to the mark. False where the step is too small to advance t.

    The size is kept where it fits, unless a longer one is worth a new history.
    """
    rest = mark - g.t
    wanted = min(g.h, g.max_step)
    if g.fresh == 1:
        wanted = min(wanted, reach(g))
    smallest = resolution(g.t, mark)
    if rest > wanted and not (wanted > smallest and wanted >= g.min_step):
        return False
    parts = int(rest / wanted * (1.0 - SAME)) + 1
    kept = int(rest / max(g.previous, smallest) + 0.5)
    if kept > parts and abs(rest - kept * g.previous) < SAME * rest:
        gain = rest / (parts * g.previous)
        if gain < WORTHWHILE or (gain < ON_THE_WAY and g.mark == mark and mark < g.stop):
            parts = kept
    g.mark = mark
    g.trial = rest / parts
    g.end = g.t + g.trial
    if parts == 1:
        g.end = mark
    return g.end > g.t


def reach(g: Group) -> float:
    """The longest step for which the history reaches back far enough."""
    return 0.25 * (1.0 + SAME) * (g.t - g.origin)


def attempt_step(g: Group, groups: Array[Group]) -> float:
    """Read the inputs and make the attempt; the norm of its error."""
    if g.fresh == 0:
        read_at_stages(g, groups)
        g.evaluations += STAGES
        return invoke(g.attempt, g)
    if abs(g.trial - g.spacing) > SAME * g.trial:
        invoke(g.begin, g)
        g.spacing = g.trial
        g.spacings += 1
    read_inputs(g, groups, splat(g.end), g.t, g.end, g.u)
    g.evaluations += 1
    g.iterations += 1
    return invoke(g.attempt, g)


def close(g: Group, groups: Array[Group], error: float) -> None:
    """Accept the step, and propose the next one's size."""
    if g.fresh == 1:
        invoke(g.accept, g)
        g.evaluations += 1
        propose(g, error)
    else:
        complete(g, groups)
        after_acceptance(g, error, SAFETY)
    finish(g)
    if g.fresh == 0 and g.trial <= reach(g):
        g.fresh = 1
        g.spacing = 0.0
        g.grown = g.t


def propose(g: Group, error: float) -> None:
    """The next step's size. It may grow once a longer step has had time to show whether it is stable."""
    factor = 2.0
    if error > TINY:
        factor = max(0.2, SAFETY * power(error, -1.0 / g.order))
        if factor > KEPT and factor < 1.0:
            factor = 1.0
    if g.trial > WORTHWHILE * g.previous:
        g.grown = g.t
    if g.rejections > 0 or g.end - g.grown < HELD * g.trial:
        factor = min(factor, 1.0)
    g.ceiling *= RAISED
    g.h = min(factor * g.trial, max(g.ceiling, g.trial))


# ---- the method ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ABM5:
    """Adams-Bashforth-Moulton of order 5."""

    @property
    def name(self) -> str:
        return "abm5"

    @property
    def order(self) -> int:
        return 5

    @property
    def dense_order(self) -> int:
        return 5

    @property
    def error_order(self) -> int:
        return 5

    @property
    def lanes(self) -> int:
        return 1

    @property
    def degree(self) -> int:
        return _START.degree

    @property
    def width(self) -> int:
        return _START.width

    @property
    def newton_tolerance(self) -> float:
        return 0.0

    @property
    def keeps_work(self) -> bool:
        return True  # the history

    @property
    def step(self) -> Piece:
        return step

    @property
    def pieces(self) -> tuple[Piece, ...]:
        return (initial, begin, attempt, accept)

    @property
    def input_rows(self) -> int:
        """Times at which a step reads its inputs: most in the first steps."""
        return _START.input_rows

    def step_names(self) -> Mapping[str, Any]:
        """Sizes and nodes of the first steps' method, and what is our own."""
        return {**_START.step_names(), "SAFETY": _SAFETY, "TINY": _TINY, "SAME": _SAME}

    def names(self, composer: Composer) -> Names:
        """Tables, workspace and the functions of one form."""
        start = _START.names(composer)
        published = len(composer.form.published)
        past = start.work
        seen = past + 4 * composer.form.states
        own = {
            "PAST": past,
            "SEEN": seen,
            "GAMMA": tuple(map(float, GAMMAS)),
            "MILNE": float(MILNES),
            "LATE": float(LATER),
        }
        return Names({**start.names, **own}, seen + 5 * published, start.linear)
