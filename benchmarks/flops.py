"""Floating-point operations of whole runs: unit costs from a counted beginning (`tally.py`), numbers of calls from the run's own counters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tally import CountedRun, flops, halves, wired

from hierc.runtime.contract import Class
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun
from hierc.runtime.simulation import Simulation

#: What says how often a kind of call is made: a counter, or all attempts where it is not named here.
GOVERNING = {
    "rhs": "evaluations", "iterate": "iterations", "solve": "iterations", "refresh": "jacobians", "factor": "jacobians",
    "accept": "steps", "publish": "steps", "begin": "spacings",
}  # fmt: skip
#: A Radau step begins with a new Jacobian; it has no history.
GOVERNING_IMPLICIT = {**GOVERNING, "begin": "jacobians"}
_COUNTERS = ("steps", "rejected", "evaluations", "iterations", "jacobians", "failures", "spacings")
#: Attempts of the counted beginning: those after the first number tell what one more costs.
_FIRST, _LAST = 600, 2400


@dataclass(frozen=True, slots=True)
class Work:
    """Operations of one run: all, and those of right-hand sides."""

    total: float
    right_hand_sides: float

    def __add__(self, other: Work) -> Work:
        return Work(self.total + other.total, self.right_hand_sides + other.right_hand_sides)


def settings(method: str, tolerance: float, **more: Any) -> dict[str, Any]:
    """Numerical settings of a run."""
    return {
        "rtol": tolerance,
        "atol": tolerance,
        "method": method,
        "max_step": math.inf,
        "min_step": 0.0,
        **more,
    }


def run(
    model: Model,
    stop: float,
    chosen: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]] | None = None,
) -> FinishedRun:
    """A run down to its trajectories, its groups those of the model's text."""
    finished = model.engine.run(model.system(), {"start": 0.0, "stop": stop, **chosen}, groups or {})
    if not finished.status.ok:
        raise ValueError(finished.status.message)
    return finished


@dataclass(frozen=True, slots=True)
class Prices:
    """What a group's steps cost: operations beside its start, by kind of call, for one more of the counter that governs it."""

    implicit: bool
    start: float
    each: Mapping[str, float]

    def work(self, counters: Mapping[str, int]) -> Work:
        """Operations of a run with these counters."""
        spent = {kind: price * governing(kind, self.implicit, counters) for kind, price in self.each.items()}
        return Work(self.start + sum(spent.values()), spent.get("rhs", 0.0) + spent.get("rhs_fixed", 0.0))


def governing(kind: str, implicit: bool, counters: Mapping[str, int]) -> int:
    """How often a kind of call is made, as far as counters tell."""
    name = (GOVERNING_IMPLICIT if implicit else GOVERNING).get(kind)
    return counters[name] if name else counters["steps"] + counters["rejected"] + counters["failures"]


def prices(
    model: Model,
    stop: float,
    chosen: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]] | None = None,
    attempts: tuple[int, int] = (_FIRST, _LAST),
) -> tuple[Prices, ...]:
    """Prices of every group, from the counted beginning of a run: of its second part, where a kind of call is made there."""
    decided = model.engine.group_settings(chosen, groups or {})
    simulation = Simulation(model.engine, model.system(), decided, model.initial(), 0.0, stop)
    counted = CountedRun(simulation)
    counted.advance(attempts[0])
    places = range(len(counted.groups))
    first = [spent(counted, g) for g in places]
    counted.advance(attempts[1] - attempts[0])
    return tuple(_priced(counted, g, *first[g]) for g in places)


def spent(counted: CountedRun, g: int) -> tuple[dict[str, float], dict[str, int]]:
    """Operations of one group so far by kind of call, and its counters."""
    fixed = called_prices(counted.simulation, g)
    own = {kind: float(n) for (k, kind), n in counted.meter.flops.items() if k == g}
    own |= {kind: n * fixed[kind] for (k, kind), n in counted.meter.calls.items() if k == g and kind in fixed}
    return own, {name: int(getattr(counted.groups[g], name)) for name in _COUNTERS}


def _priced(counted: CountedRun, g: int, before: Mapping[str, float], counters: Mapping[str, int]) -> Prices:
    implicit = METHODS[counted.simulation.settings[g].method].lanes > 1
    after, last = spent(counted, g)
    each, start = {}, 0.0
    for kind, amount in after.items():
        if kind == "initial" or kind.endswith(" at the start"):
            start += amount
            continue
        done = governing(kind, implicit, last) - governing(kind, implicit, counters)
        since = amount - before.get(kind, 0.0)
        if not done:
            done, since = governing(kind, implicit, last), amount
        each[kind] = since / max(done, 1)
    return Prices(implicit, start, each)


def called_prices(simulation: Simulation, g: int) -> dict[str, float]:
    """Operations of one call of what is not run but counted in its text: the group's own functions and, for an implicit method, its linear algebra.

    An update of a factorisation and an entry of its factors cost a complex product and sum, 8 operations, for each of the systems solved together.
    """
    wiring, _ = wired(simulation, g)
    classes: tuple[Class, ...] = simulation.elements.plan.classes
    (call,) = wiring.form.calls
    kind, method = classes[call.kind], METHODS[simulation.settings[g].method]
    before, after = halves(kind.rhs)
    lanes = method.lanes
    prices = {
        "rhs_fixed": lanes * before,
        "rhs": lanes * after,
        "publish": lanes * sum(flops(parse_function(classes[c.kind].parts[c.part].function)) for c in wiring.form.publishing),
    }  # fmt: skip
    if lanes > 1:
        composer = Composer(Unit("price"), "price", wiring.form, classes, parse_function, lanes)
        elimination, systems = composer.elimination, lanes // 2
        prices |= {
            "factor": flops(parse_function(kind.jac))
            + 8 * systems * (elimination.updates + elimination.entries),
            "solve": 8 * systems * elimination.entries,
            "solve_lanes": 2 * lanes * elimination.entries,
            "solve_real": 2 * elimination.entries,
        }
    return {name: float(price) for name, price in prices.items()}


def total(parts: Sequence[Work]) -> Work:
    """The sum over groups."""
    return sum(parts, Work(0.0, 0.0))
