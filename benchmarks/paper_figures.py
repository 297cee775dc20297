"""The pictures of `paper.py`, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from efficiency import Measured, predicted
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hierc.runtime.result import Result

mpl.use("Agg")
_SIZE = (6.4, 4.0)
#: What the levels of the cart are called in the paper's order, with the names of their positions.
_LEVELS = {
    "1 planner": ("plan.p[1]", "plan.p[2]"),
    "2 kinematic": ("kin.x", "kin.y"),
    "3 dynamic": ("cart.x", "cart.y"),
    "4 follower": ("tail.x", "tail.y"),
}


def _drawing(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True, color="0.9")
    return figure, axes


def _save(figure: Figure, axes: Axes, path: Path) -> None:
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def efficiency_of_levels(measured: Sequence[Measured], path: Path) -> None:
    """Figure 2: operations of multirate over single-rate integration against the cost of the right-hand side."""
    figure, axes = _drawing("right-hand side, flops a state", "multirate / single-rate")
    costs = np.linspace(0.0, 100.0, 201)
    for k, m in enumerate(measured):
        axes.plot(
            costs,
            [predicted(m.levels, c) for c in costs],
            f"C{k}--",
            label=f"{m.levels} levels, equation (9)",
        )
        axes.plot(costs, [m.efficiency(c) for c in costs], f"C{k}-", label=f"{m.levels} levels, measured")
    axes.axhline(1.0, color="0.5", linewidth=0.8)
    axes.set_ylim(0.0, 2.0)
    _save(figure, axes, path)


def trajectories(result: Result, path: Path) -> None:
    """Figure 3: where the four levels of the cart go."""
    figure, axes = _drawing("x, m", "y, m")
    for k, (label, (x, y)) in enumerate(_LEVELS.items()):
        axes.plot(result(x, result.t), result(y, result.t), f"C{k}", label=label, linewidth=1.6 - 0.3 * k)
    axes.set_aspect("equal")
    _save(figure, axes, path)


def step_sizes(result: Result, path: Path) -> None:
    """Figure 4: the step size of each level over time."""
    figure, axes = _drawing("t, s", "step size, s")
    for k, (label, group) in enumerate(zip(_LEVELS, result.stats, strict=True)):
        starts, sizes = result.steps(group)
        axes.step(starts, sizes, f"C{k}", where="post", label=label, linewidth=0.8)
    axes.set_yscale("log")
    _save(figure, axes, path)


def efficiency_of_tolerances(tolerances: Sequence[float], shares: Sequence[float], path: Path) -> None:
    """Figure 5: operations of abm5 over those of ode45 against the tolerance of both."""
    figure, axes = _drawing("tolerance", "operations, abm5 / ode45")
    axes.semilogx(tolerances, shares, "C0o-", label="cart, all operations")
    axes.set_ylim(0.0, 1.0)
    _save(figure, axes, path)


def equal_error(
    errors: Sequence[float], curves: Mapping[str, Sequence[tuple[float, float]]], path: Path
) -> None:
    """Operations of the default method over those of ode45 against the achieved error: of right-hand sides, and all."""
    figure, axes = _drawing("achieved error", "operations, radau13 / ode45")
    for k, (name, shares) in enumerate(curves.items()):
        axes.loglog(errors, [right for right, _ in shares], f"C{k}o--", label=f"{name}, right-hand sides")
        axes.loglog(errors, [everything for _, everything in shares], f"C{k}o-", label=f"{name}, all")
    axes.axhline(0.1, color="0.5", linewidth=0.8)
    _save(figure, axes, path)
