"""What a group's integration leaves: its segments, as arrays, and their values at any time."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.machine.program import Program
from hierc.runtime.segments import HEADER

Floats = NDArray[np.float64]
_SAMPLE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


@dataclass(frozen=True)
class GroupTrajectory:
    """Segments of one group, a row of `table` each (see `segments.py`); `reached` is the end of the last."""

    name: str
    method: str
    degree: int
    width: int
    table: Floats
    reached: float
    initial: Floats  # (n,): what holds before the first step
    stats: Mapping[str, int]
    program: Program  # whose `sample` evaluates

    @property
    def knots(self) -> Floats:
        """Ends of the steps (k + 1,), s."""
        return np.append(self.table[:, 0], self.reached)

    @property
    def coefficients(self) -> Floats:
        """Coefficients (k, n, degree + 1) of the states in theta = (t - t0)/h, lowest power first."""
        n = len(self.initial)
        places = self.table[:, HEADER : HEADER + n * self.width].reshape(-1, n, self.width)
        return places[:, :, : self.degree + 1]

    def __call__(self, t: Floats) -> Floats:
        """States (len(t), n) at the times t, each within the knots (at a knot: of the segment that ends there)."""
        n = len(self.initial)
        if not len(self.table):
            return np.broadcast_to(self.initial, (len(t), n)).copy()
        times = np.ascontiguousarray(t, np.float64)
        out = np.empty((len(times), n))
        count, stride = self.table.shape
        shape = np.array([count, stride, self.width, self.degree, n, len(times)], np.int64)
        sample = _SAMPLE(self.program.sample)
        sample(self.table.ctypes.data, shape.ctypes.data, times.ctypes.data, out.ctypes.data)
        return out
