"""The work-precision diagram of `hierc bench`: CPU time over achieved error, a line a solver."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hierc.runtime.files import write_whole
from hierc.runtime.plotting import require_matplotlib

if TYPE_CHECKING:
    from hierc.bench import Bench


def draw(found: Bench, path: Path) -> None:
    """Draw to a .png, .pdf or .svg file. Raises ImportError without matplotlib, OSError."""
    require_matplotlib()
    from io import BytesIO

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for name in found.solvers:
        points = [
            (run.error, 1e3 * run.seconds)
            for run in found.runs
            if run.solver == name and run.error is not None and run.seconds is not None
        ]
        if points:
            ours = name.startswith("hierc")
            axes.plot(
                *zip(*points, strict=True), "o-" if ours else "s--", label=name, lw=2 if ours else 1, ms=4
            )
    if found.agreement:
        axes.axvspan(0.0, found.agreement, color="0.9", lw=0)
    axes.set(
        xscale="log", yscale="log", xlabel="error, relative to each state's largest size", ylabel="CPU ms"
    )
    axes.set_title(f"{found.model}: {found.states} states, to {found.stop:g} s")
    axes.invert_xaxis()
    axes.grid(visible=True, which="major", color="0.85")
    axes.legend(fontsize="small")
    drawing = BytesIO()
    figure.savefig(drawing, format=path.suffix[1:], dpi=150)
    write_whole(path, drawing.getvalue())
