"""What a group's integration leaves: its segments, as arrays, and their values at any time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class GroupTrajectory:
    """Segments of one group: `knots` (k + 1,), `coefficients` (k, n, degree + 1) of its states in theta = (t - t0)/h, lowest power first."""

    name: str
    method: str
    degree: int
    knots: Floats
    coefficients: Floats
    initial: Floats  # (n,): what holds before the first step
    stats: Mapping[str, int]

    def __call__(self, t: Floats) -> Floats:
        """States (len(t), n) at the times t, each within the knots (at a knot: of the segment that ends there)."""
        if not len(self.coefficients):
            return np.broadcast_to(self.initial, (len(t), len(self.initial))).copy()
        k = np.clip(np.searchsorted(self.knots, t, side="left") - 1, 0, len(self.coefficients) - 1)
        theta = ((t - self.knots[k]) / (self.knots[k + 1] - self.knots[k]))[:, None]
        c = self.coefficients[k]
        result = c[:, :, -1]
        for power in range(self.degree - 1, -1, -1):
            result = result * theta + c[:, :, power]
        return np.ascontiguousarray(result)
