"""Which method for which group: by predicted cost, from a short probe of the run and the spectra it meets.

The number of steps of a method follows from how fast the solution moves (its time scale T, which the probe's own steps reveal) and, for explicit methods,
from the largest eigenvalue: h = min(c T tol**(1/q), radius/|lambda|). The cost of a step is a base, a part for each state and a part for each operation of the
right-hand side. The constants were measured once (`benchmarks/step_costs.py`) and are part of the text, so that the same model chooses the same methods on
every machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: What the probe runs, and what stays unless another method is predicted to be clearly cheaper.
FAVOURITE = "radau13"
#: Leaves the method to `choose`.
AUTO = "auto"
#: Another method must be predicted to cost less than this part of the favourite.
CLEARLY = 0.8
#: A call of a Python function out of machine code, ns: of the least that such functions do.
PYTHON_CALL = 3000.0


@dataclass(frozen=True, slots=True)
class Cost:
    """A method's constants. Accuracy: h = reach * T * tol**(1/order). Stability: h <= radius/|lambda|.

    A step takes, in ns, base + iterations*(state*n + evaluation*flops) + algebra*(updates + iterations*entries); and each call of a Python function
    `PYTHON_CALL`, in `lanes` evaluations at a time: those of an implicit step's iterations, and one more that checks it.
    """

    order: int
    reach: float
    radius: float
    base: float
    state: float
    evaluation: float
    algebra: float
    iterations: float
    lanes: int = 1

    @property
    def calls(self) -> float:
        """How often a step evaluates what is called in Python."""
        return self.iterations if math.isfinite(self.radius) else self.lanes * (self.iterations + 1.0)


COSTS = {
    "tsit5": Cost(5, 4.9, 3.0, base=118.0, state=1.6, evaluation=0.09, algebra=0.0, iterations=6.0),
    "dop853": Cost(8, 6.2, 6.0, base=181.0, state=2.1, evaluation=0.09, algebra=0.0, iterations=15.0),
    "adams": Cost(12, 0.64, 1.3, base=138.0, state=17.0, evaluation=0.09, algebra=0.0, iterations=2.0),
    "radau5": Cost(
        4, 4.4, math.inf, base=125.0, state=8.9, evaluation=0.16, algebra=0.92, iterations=1.3, lanes=4
    ),
    "radau9": Cost(
        6, 7.1, math.inf, base=248.0, state=8.7, evaluation=0.21, algebra=1.0, iterations=1.8, lanes=8
    ),
    "radau13": Cost(
        8, 9.6, math.inf, base=286.0, state=8.7, evaluation=0.2, algebra=1.1, iterations=2.2, lanes=8
    ),
}

#: Methods that are taken only where they are asked for: nothing checks what they do between knots, where it was found to be wrong by a hundred tolerances.
BY_NAME = frozenset({"tsit5", "dop853"})
#: Methods whose steps are bounded by stability.
EXPLICIT = frozenset(name for name, cost in COSTS.items() if math.isfinite(cost.radius))


@dataclass(frozen=True, slots=True)
class Probe:
    """What the probe learnt of one group.

    `step` is a typical step size of the favourite (s); `spectral_radius()` the largest |eigenvalue| met (1/s), computed only if it can matter;
    `updates` and `entries` are those of its sparse factorisation; `calls` counts the Python functions that a right-hand side calls.
    """

    step: float
    spectral_radius: Callable[[], float]
    states: int
    flops: int
    updates: int
    entries: int
    linear: bool
    tolerance: float
    calls: int = 0


def choose(*probes: Probe) -> str:
    """The method of least predicted cost a second, the favourite unless another is clearly cheaper; for all groups that the probes stand for."""
    cheapest = _cheapest(probes, [0.0] * len(probes))
    if cheapest not in EXPLICIT:  # even as long as nothing bounds the steps of those
        return cheapest
    return _cheapest(probes, [probe.spectral_radius() for probe in probes])


def _cheapest(probes: Sequence[Probe], radii: Sequence[float]) -> str:
    costs = {
        name: sum(predicted_cost(name, probe, radius) for probe, radius in zip(probes, radii, strict=True))
        for name in COSTS
        if name not in BY_NAME
    }
    best = min(costs, key=lambda name: costs[name])
    return best if costs[best] < CLEARLY * costs[FAVOURITE] else FAVOURITE


def predicted_cost(name: str, probe: Probe, radius: float) -> float:
    """Predicted ns of work for a second of simulated time; `radius` is the largest |eigenvalue| (1/s)."""
    cost, favourite = COSTS[name], COSTS[FAVOURITE]
    scale = probe.step / (favourite.reach * probe.tolerance ** (1.0 / favourite.order))
    h: float = cost.reach * scale * probe.tolerance ** (1.0 / cost.order)
    if radius > 0.0:
        h = min(h, cost.radius / radius)
    return step_cost(name, probe) / h


def step_cost(name: str, probe: Probe) -> float:
    """Predicted ns of one step."""
    cost = COSTS[name]
    iterations = 1.0 if probe.linear and math.isinf(cost.radius) else cost.iterations
    evaluations = iterations * (cost.state * probe.states + cost.evaluation * probe.flops)
    algebra = cost.algebra * (probe.updates + iterations * probe.entries)
    return cost.base + evaluations + algebra + PYTHON_CALL * cost.calls * probe.calls


def spectral_radius(matrices: Sequence[NDArray[np.float64]]) -> float:
    """Largest |eigenvalue| of some Jacobians; of large ones their norm, which bounds it."""
    largest = 0.0
    for matrix in matrices:
        if not np.isfinite(matrix).all() or not matrix.size:
            continue
        small = len(matrix) <= 64
        found = np.abs(np.linalg.eigvals(matrix)).max() if small else np.abs(matrix).sum(axis=1).max()
        largest = max(largest, float(found))
    return largest
