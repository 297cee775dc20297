"""Reference solutions from the hand-written right-hand sides: extrapolation of order 16, checked by scipy's DOP853."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from cases import Case
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

#: Output times of every comparison are the ends of this many equal parts.
PARTS = 100
#: The most by which two reference solutions may differ; the finest error in the tables is a hundred times larger.
_AGREEMENT = 1e-9
#: Numbers of substeps of the modified midpoint rule, for an order of twice their count.
_COLUMNS = (2, 4, 6, 8, 10, 12, 14, 16)


def output_times(case: Case) -> Floats:
    """The 101 times at which errors are measured."""
    return np.linspace(0.0, case.stop, PARTS + 1)


@dataclass(frozen=True, slots=True)
class Reference:
    """States (101, n) at the output times, each state's scale (n,): its largest size over the run, and how well two solutions agree."""

    states: Floats
    scale: Floats
    agreement: float

    def error(self, states: Floats) -> float:
        """Largest |y - y_ref|/scale over states and times (101, n)."""
        return float((np.abs(states - self.states) / self.scale).max())


def reference(case: Case, folder: Path | None = None) -> Reference:
    """A solution that two independent ways of getting it confirm.

    `folder` may hold ready ones, `ref/<name>.npz` with arrays `y` (101, n) and `scale` (n,): they take the place of DOP853. Raises ValueError
    where the two disagree.
    """
    found = _extrapolation(case)
    check, scale = (
        _read(folder / "ref" / f"{case.peer_name}.npz") if folder and case.peer_name else _dop853(case)
    )
    difference = float((np.abs(found - check) / scale).max())
    if not difference < _AGREEMENT:
        raise ValueError(f"two reference solutions of {case.name} differ by {difference:.1e}")
    return Reference(found, scale, difference)


def _extrapolation(case: Case) -> Floats:
    rows = [np.array(case.start, np.float64)]
    for begin, end in pairwise(output_times(case).tolist()):
        rows.append(_extrapolate(case, rows[-1], begin, end))
    return np.array(rows)


def _dop853(case: Case) -> tuple[Floats, Floats]:
    """Output times are ends of steps, not interpolated; the scale is taken from all steps."""
    rows = [np.array(case.start, np.float64)]
    scale = np.abs(rows[0])
    for span in pairwise(output_times(case).tolist()):
        result = solve_ivp(lambda t, x: _rhs(case, t, x), span, rows[-1], "DOP853", rtol=1e-12, atol=1e-14)
        if not result.success:
            raise ValueError(f"DOP853 fails on {case.name}: {result.message}")
        rows.append(result.y[:, -1])
        scale = np.maximum(scale, np.abs(result.y).max(axis=1))
    return np.array(rows), scale


def _extrapolate(case: Case, y: Floats, begin: float, end: float) -> Floats:
    """Gragg-Bulirsch-Stoer (Hairer, Norsett and Wanner I, II.9) with fixed steps."""
    big = (end - begin) / case.reference_steps
    for k in range(case.reference_steps):
        t = begin + k * big
        table: list[Floats] = []
        for column, parts in enumerate(_COLUMNS):
            row = [_midpoint(case, y, t, big, parts)]
            for q, above in enumerate(table, 1):
                row.append(row[-1] + (row[-1] - above) / ((parts / _COLUMNS[column - q]) ** 2 - 1))
            table = row
        y = table[-1]
    return y


def _midpoint(case: Case, y: Floats, t: float, big: float, parts: int) -> Floats:
    """The modified midpoint rule over a step `big` in `parts` substeps, with Gragg's smoothing."""
    h = big / parts
    before, now = y, y + h * _rhs(case, t, y)
    for k in range(1, parts):
        before, now = now, before + 2 * h * _rhs(case, t + k * h, now)
    return 0.5 * (before + now + h * _rhs(case, t + big, now))


def _rhs(case: Case, t: float, y: Floats) -> Floats:
    return np.array(case.rhs(t, y.tolist()))


def _read(file: Path) -> tuple[Floats, Floats]:
    with np.load(file) as arrays:
        return np.asarray(arrays["y"], np.float64), np.asarray(arrays["scale"], np.float64)
