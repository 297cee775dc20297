"""Plots of results: a panel a group, drawn without any state outside the figure. The only module of the runtime that knows matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from hierc.runtime.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hierc.runtime.result import Result

#: Kinds of files that can be written.
SUFFIXES = (".png", ".pdf", ".svg")
#: More lines than this in a panel cannot be told apart.
_MOST_LINES = 12


def draw(result: Result, path: Path | None, names: list[str] | None) -> Figure:
    """Draw `names` in one panel, or what is recorded in a panel a group. Raises ImportError, KeyError, OSError, ValueError."""
    if path is not None and path.suffix not in SUFFIXES:
        raise ValueError(f"cannot draw to `{path.name}`: plots are {', '.join(SUFFIXES)} files")
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError('plots need matplotlib: pip install "hierc[plot]"') from None
    panels = result.panels() if names is None else {result.model: names}
    figure = Figure(figsize=(9.0, 1.2 + 2.2 * len(panels)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)
    for axis, (title, chosen) in zip(axes[:, 0], panels.items(), strict=True):
        _panel(axis, result, title, chosen)
    axes[-1, 0].set_xlabel("time [s]")
    if path is not None:
        _save(figure, path)
    return figure


def _panel(axis: Axes, result: Result, title: str, names: list[str]) -> None:
    units = result.units
    columns = [
        (name, _label(column, units.get(name) or units.get(name.rpartition("[")[0])), values)
        for name in names
        for column, values in result.columns([name]).items()
    ]
    for _, label, values in columns[:_MOST_LINES]:
        axis.plot(result.t, values, label=label, linewidth=1.2)
    hidden = len(columns) - _MOST_LINES
    axis.set_title(
        _plain(title) + (f" (and {hidden} more)" if hidden > 0 else ""), loc="left", fontsize="medium"
    )
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.0)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", frameon=False)
    if not any(np.isfinite(values).any() for _, _, values in columns):
        axis.text(0.5, 0.5, "no finite values", transform=axis.transAxes, ha="center")


def _label(name: str, unit: str | None) -> str:
    return " " + _plain(name + (f" [{unit}]" if unit else ""))  # matplotlib hides labels that begin with `_`


def _plain(text: str) -> str:
    """Text that matplotlib shows as it is: a `$` would begin a formula."""
    return text.replace("$", r"\$")


def _save(figure: Figure, path: Path) -> None:
    def put(file: BinaryIO) -> None:
        figure.savefig(file, format=path.suffix[1:], dpi=130)

    write_whole(path, put)
