"""Plots of results: panels by group, and in a group by unit, drawn without any state outside the figure.

The only module of the runtime that knows matplotlib.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hierc.runtime.result import Result

Floats = NDArray[np.float64]
#: A scalar's name and its values over the output times.
_Line = tuple[str, Floats]

#: Kinds of files that can be written.
SUFFIXES = (".png", ".pdf", ".svg")
#: More lines than this in a panel cannot be told apart.
_MOST_LINES = 12
#: How many colours matplotlib tells lines apart by; those beyond are drawn in the next style.
_COLOURS, _STYLES = 10, ("-", "--")
#: Inches: of a figure without its panels, of a panel, and the most, which keeps a picture within what files can hold.
_MARGIN, _PANEL, _MOST = 0.7, 2.0, 200.0


def require_matplotlib() -> None:
    """Raise ImportError, with what to do, where there is no matplotlib."""
    if find_spec("matplotlib") is None:
        raise ImportError("plots need matplotlib: pip install matplotlib")


def draw(result: Result, path: Path | None, names: list[str] | None) -> Figure:
    """Draw `names`, or what is recorded by group, a panel a unit. Raises ImportError, KeyError, OSError, ValueError."""
    if path is not None and path.suffix not in SUFFIXES:
        raise ValueError(f"cannot draw to `{path.name}`: plots are {', '.join(SUFFIXES)} files")
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = result.panels() if names is None else {result.model: names}
    panels = [
        (title if i == 0 else "", unit, lines)
        for title, chosen in groups.items()
        for i, (unit, lines) in enumerate(_by_unit(result, chosen).items())
    ] or [(result.model, None, [])]
    figure = Figure(figsize=(9.0, min(_MARGIN + _PANEL * len(panels), _MOST)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (title, unit, lines) in zip(axes, panels, strict=True):
        _panel(axis, result.t, title, unit, lines)
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    if path is not None:
        _save(figure, path)
    return figure


def _by_unit(result: Result, names: list[str]) -> dict[str | None, list[_Line]]:
    """The scalars to draw by their unit, in the order of names."""
    found: dict[str | None, list[_Line]] = {}
    for name in names:
        found.setdefault(result.unit(name), []).extend(result.columns([name]).items())
    return found


def _panel(axis: Axes, t: Floats, title: str, unit: str | None, lines: list[_Line]) -> None:
    for k, (name, values) in enumerate(lines[:_MOST_LINES]):
        colour, style = f"C{k % _COLOURS}", _STYLES[k // _COLOURS]
        axis.plot(t, values, label=_label(name), linewidth=1.2, color=colour, linestyle=style)
    if len(lines) > _MOST_LINES:
        axis.plot([], [], " ", label=f"and {len(lines) - _MOST_LINES} more")
    if title:
        axis.set_title(_plain(title), loc="left", fontsize="medium", fontweight="bold")
    if unit is not None:
        axis.set_ylabel(_plain(f"[{unit}]"))
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.0)
    axis.ticklabel_format(axis="y", useOffset=False)
    if lines:
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", frameon=False)
    if not any(np.isfinite(values).any() for _, values in lines):
        axis.text(
            0.5,
            0.5,
            "no finite values" if lines else "nothing recorded",
            transform=axis.transAxes,
            ha="center",
        )


def _label(name: str) -> str:
    return " " + _plain(name)  # matplotlib hides labels that begin with `_`


def _plain(text: str) -> str:
    """Text that matplotlib shows as it is: a `$` would begin a formula."""
    return text.replace("$", r"\$")


def _save(figure: Figure, path: Path) -> None:
    def put(file: BinaryIO) -> None:
        figure.savefig(file, format=path.suffix[1:], dpi=130)

    write_whole(path, put)
