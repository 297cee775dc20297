"""Where the time of a run went, group by group: right-hand sides, linear algebra, reading of inputs, publishing, and the rest.

In: a run's engine, system and settings. Out: `Costs`, found by running again with timers in the machine code (`machine/timing.py`), which the run itself does
not have. What the timers cost is measured beside it and taken off. Guaranteed: the second run takes the very steps of the first. Sections of some ten
nanoseconds are told apart as well as the processor tells them, which works at several at once; their sum is that of the steps.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import records
from hierc.runtime.elements import Elements
from hierc.runtime.families import named_groups
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.machine.program import Program
from hierc.runtime.machine.timing import ALGEBRA, INPUTS, PARTS, PUBLISHING, RHS, STEPS, TIMER, TIMERS
from hierc.runtime.methods.catalogue import METHODS

if TYPE_CHECKING:
    from hierc.runtime.run import Engine, FinishedRun

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Timers of nothing, from which is learnt what one costs; of so many trials the quickest.
_IDLE, _TRIALS = 20_000, 5
#: A short run is done again, at most so often, until so many seconds are spent; the quickest counts.
_RUNS, _ENOUGH = 10, 0.1


@dataclass(frozen=True, slots=True)
class GroupCosts:
    """What the steps of the groups of one name cost, `car[1..100]`; all numbers are sums over the `groups`, times in s.

    `flops`: operations of right-hand sides (an elementary function counts 20) at all points of a method's lanes: evaluations x lanes x operations.
    `seconds` is all of the time, of which `rhs`, `algebra`, `inputs` and `publishing` are parts; `rest` is what no part has: predicting and accepting
    steps, norms, step-size control.
    """

    name: str
    groups: int
    methods: tuple[str, ...]
    steps: int
    rejected: int
    evaluations: int
    flops: int
    rhs: float
    algebra: float
    inputs: float
    publishing: float
    rest: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of all groups, in the order of the model. `seconds`: all steps together; `timers`: what the timers took beside, already taken off."""

    groups: tuple[GroupCosts, ...]
    seconds: float
    timers: float


@dataclass(frozen=True, slots=True)
class _Timer:
    """Ticks that a timer adds to its own part, and to what is around it; ticks a second."""

    inside: float
    around: float
    rate: float


def cost_of(
    engine: Engine,
    run: FinishedRun,
    settings: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
    **others: Any,
) -> Costs:
    """Run again with timers; `settings`, `groups` and `others` as `Engine.run` has them. None of a run that failed at its start."""
    timed = engine.with_timers
    again = timed.run(run.system, settings, groups, **others)
    if again.clocks is None or again.groups.program is None:
        return Costs((), 0.0, 0.0)
    timer = _calibrated(again.groups.program)
    found = [_seconds(again.clocks, timer)]
    while sum(seconds[:, STEPS].sum() for seconds, _ in found) < _ENOUGH and len(found) < _RUNS:
        again = timed.run(run.system, settings, groups, **others)
        assert again.clocks is not None
        found.append(_seconds(again.clocks, timer))
    seconds, lost = min(found, key=lambda f: float(f[0][:, STEPS].sum()))
    assert again.groups.records is not None
    flops = _flops(engine, again.groups.methods, again.groups.records["evaluations"])
    return Costs(_by_name(timed.elements, again, seconds, flops), float(seconds[:, STEPS].sum()), lost)


def _calibrated(program: Program) -> _Timer:
    """What a timer costs here and now."""
    assert program.idle is not None
    group = RecordArray(records.Group, 1)
    clocks = np.zeros((len(PARTS), 2), np.int64)
    group["clocks"][0] = clocks.ctypes.data
    idle = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_int64)(program.idle)
    best = _Timer(0.0, float("inf"), 1.0)
    for _ in range(_TRIALS):
        clocks[:] = 0
        began = time.perf_counter()
        idle(group.address, _IDLE)
        spent = time.perf_counter() - began
        around = float(clocks[TIMERS, 0]) / _IDLE
        if around < best.around:
            best = _Timer(float(clocks[TIMER, 0]) / _IDLE, around, clocks[TIMERS, 0] / spent)
    return best


def _seconds(clocks: Integers, timer: _Timer) -> tuple[Floats, float]:
    """Seconds (groups, parts) without those of timers; how many those were."""
    ticks, calls = clocks[:, :, 0].astype(np.float64), clocks[:, :, 1]
    inner = calls[:, [RHS, ALGEBRA, INPUTS, PUBLISHING]].sum(axis=1)
    lost = inner * timer.around
    ticks -= calls * timer.inside
    ticks[:, STEPS] -= lost
    taken = float(lost.sum() + (calls[:, STEPS] * timer.around).sum())
    return np.maximum(ticks, 0.0) / timer.rate, taken / timer.rate


def _flops(engine: Engine, methods: Sequence[str], evaluations: Integers) -> Integers:
    """Operations of the right-hand sides of each group."""
    found = np.zeros(len(methods), np.int64)
    for w in engine.wiring:
        found[w.places] = sum(engine.plan.classes[c.kind].flops for c in w.form.calls if c.part < 0)
    lanes = np.array([METHODS[m].lanes if m in METHODS else 1 for m in methods], np.int64)
    return found * lanes * evaluations[: len(methods)]


def _by_name(
    elements: Elements, run: FinishedRun, seconds: Floats, flops: Integers
) -> tuple[GroupCosts, ...]:
    table = run.groups.records
    assert table is not None
    made = []
    for name, places in named_groups(elements):
        rhs, algebra, inputs, publishing, steps = (
            float(seconds[places, part].sum()) for part in (RHS, ALGEBRA, INPUTS, PUBLISHING, STEPS)
        )
        counted = {key: int(table[key][places].sum()) for key in ("steps", "rejected", "evaluations")}
        made.append(
            GroupCosts(
                name=name,
                groups=len(places),
                methods=tuple(dict.fromkeys(run.groups.methods[g] for g in places.tolist())),
                flops=int(flops[places].sum()),
                rhs=rhs,
                algebra=algebra,
                inputs=inputs,
                publishing=publishing,
                rest=max(steps - rhs - algebra - inputs - publishing, 0.0),
                seconds=steps,
                **counted,
            )
        )
    return tuple(made)
