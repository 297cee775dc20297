"""Which method for which group: by predicted cost, from a short probe of the run and the spectra it meets.

The number of steps of a method follows from how fast the solution moves (its time scale T, which the probe's own steps reveal) and, for explicit methods,
from the largest eigenvalue: h = min(c T tol**(1/q), radius/|lambda|). The cost of a step is a base, a part for each state and a part for each operation of the
right-hand side. The constants were measured once (`benchmarks/step_costs.py`) and are part of the text, so that the same model chooses the same methods on
every machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: What the probe runs, and what stays unless another method is predicted to be clearly cheaper.
FAVOURITE = "radau13"
#: Another method must be predicted to cost less than this part of the favourite.
CLEARLY = 0.8


@dataclass(frozen=True, slots=True)
class Cost:
    """A method's constants. Accuracy: h = reach * T * tol**(1/order). Stability: h <= radius/|lambda|. Step: ns.

    `iterations` counts evaluations of the right-hand side a step; each costs `evaluation` ns a flop and `state` ns a state.
    """

    order: int
    reach: float
    radius: float
    base: float
    state: float
    evaluation: float
    iterations: float


COSTS = {
    "tsit5": Cost(order=5, reach=3.8, radius=3.0, base=70.0, state=5.0, evaluation=0.25, iterations=6.0),
    "dop853": Cost(order=8, reach=5.3, radius=6.0, base=130.0, state=7.0, evaluation=0.25, iterations=15.0),
    "radau5": Cost(order=4, reach=3.2, radius=math.inf, base=60.0, state=14.0, evaluation=0.3, iterations=2.0),
    "radau9": Cost(order=6, reach=5.8, radius=math.inf, base=90.0, state=15.0, evaluation=0.4, iterations=2.5),
    "radau13": Cost(order=8, reach=8.2, radius=math.inf, base=100.0, state=18.0, evaluation=0.4, iterations=3.0),
}


@dataclass(frozen=True, slots=True)
class Probe:
    """What the probe learnt of one group: typical step sizes of the favourite (s), largest |eigenvalue| (1/s), sizes."""

    step: float
    spectral_radius: float
    states: int
    flops: int
    linear: bool
    tolerance: float


def choose(probe: Probe) -> str:
    """The method of least predicted cost a second, the favourite unless another is clearly cheaper."""
    costs = {name: predicted_cost(name, probe) for name in COSTS}
    best = min(costs, key=lambda name: costs[name])
    return best if costs[best] < CLEARLY * costs[FAVOURITE] else FAVOURITE


def predicted_cost(name: str, probe: Probe) -> float:
    """Predicted ns of work for a second of simulated time."""
    cost, favourite = COSTS[name], COSTS[FAVOURITE]
    scale = probe.step / (favourite.reach * probe.tolerance ** (1.0 / favourite.order))
    h = cost.reach * scale * probe.tolerance ** (1.0 / cost.order)
    if probe.spectral_radius > 0.0:
        h = min(h, cost.radius / probe.spectral_radius)
    iterations = 1.0 if probe.linear and math.isinf(cost.radius) else cost.iterations
    return (cost.base + iterations * (cost.state * probe.states + cost.evaluation * probe.flops)) / h


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
