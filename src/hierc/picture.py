"""The structure of a model as a picture: its block-triangular incidence, rows reading columns, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, BinaryIO

from hierc.compiler.diagram import Diagram, Member
from hierc.runtime.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Kinds of files that can be written.
SUFFIXES = (".svg", ".png", ".pdf")
#: More members than this, and cells have marks instead of the names of what is read.
_MOST_NAMED = 8
#: More members than this, and only groups are labelled.
_MOST_LABELLED = 60
#: Inches of a cell without names; a picture is never larger than `_LARGEST`.
_CELL, _LARGEST = 0.3, 14.0

#: How long a label may be, and a line of the title; points of both.
_LONGEST, _LINE = 40, 80
_LABEL, _TITLE = 8, 10

_TINTS = ("#dbe9f6", "#fde5cc", "#d8efd3", "#f5d9e6", "#e4dcf1", "#f3efc9")
_UNGROUPED = "#f4f4f4"
_INK, _FAINT, _READ = "#222222", "#d0d0d0", "#3b6ea5"


def draw(diagram: Diagram, path: Path | None) -> Figure:
    """Draw a diagram and save it if `path` is given. Raises ImportError without matplotlib, OSError."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError('pictures need matplotlib: pip install "hierc[plot]"') from None
    size = len(diagram.members)
    named = size <= _MOST_NAMED
    width, height = (min(_CELL * size, _LARGEST),) * 2
    if named:
        columns = [_fitted(member.path) for member in diagram.members]
        width, height = max(1.35, _inches(columns, _LABEL) + 0.2) * size, 0.62 * size
    rows = _row_labels(diagram) if size <= _MOST_LABELLED else []
    title = wrap(f"{diagram.model}: rows read columns, slow groups first", _LINE)
    whole = max(width + max(2.2, _inches(rows, _LABEL) + 0.5), _inches(title, _TITLE) + 0.3)
    figure = Figure(figsize=(whole, height + 1.4), layout="constrained")
    FigureCanvasAgg(figure)
    # Over all of the picture: labels beside the axes may leave these little room.
    figure.suptitle("\n".join(title).replace("$", r"\$"), fontsize=_TITLE)
    axes = figure.subplots()
    axes.set_xlim(-0.02, size + 0.02)
    axes.set_ylim(size + 0.02, -0.02)
    axes.set_aspect("auto" if named else "equal")
    _draw_blocks(axes, diagram)
    _draw_levels(axes, diagram)
    if named:
        _draw_names(axes, diagram)
    else:
        _draw_dots(axes, diagram, max(width / size, 0.02))
    _label_axes(axes, diagram)
    if path is not None:
        _save(figure, path)
    return figure


def _inches(texts: Sequence[str], points: int) -> float:
    """How wide the widest of some texts is."""
    from matplotlib.textpath import TextPath

    widths = (TextPath((0, 0), text.replace("$", r"\$"), size=points).get_extents().width for text in texts)
    return max(widths, default=0.0) / 72


def _draw_blocks(axes: Axes, diagram: Diagram) -> None:
    """The grid below the diagonal, and a tinted square for each block."""
    from matplotlib.patches import Rectangle

    size = len(diagram.members)
    if size <= _MOST_LABELLED:
        for i in range(size):
            axes.plot((0, i + 1), (i, i), color=_FAINT, linewidth=0.6, zorder=0)
            axes.plot((i + 1, i + 1), (i, size), color=_FAINT, linewidth=0.6, zorder=0)
    first = 0
    for number, (_, members) in enumerate(groupby(diagram.members, key=lambda member: member.block)):
        groups = [member.group for member in members]
        count, grouped = len(groups), any(groups)
        tint = _TINTS[number % len(_TINTS)] if grouped else _UNGROUPED
        square = Rectangle((first, first), count, count, facecolor=tint, edgecolor=_INK, linewidth=0.8)
        axes.add_patch(square)
        first += count


def _draw_levels(axes: Axes, diagram: Diagram) -> None:
    """A thick outline around each level that holds several groups, where its members follow each other."""
    from matplotlib.patches import Rectangle

    for level in diagram.divided():
        inside = enumerate(level in member.levels for member in diagram.members)
        for within, run in groupby(inside, key=lambda item: item[1]):
            places = [place for place, _ in run]
            if within:
                corner, size = (places[0], places[0]), len(places)
                axes.add_patch(
                    Rectangle(corner, size, size, fill=False, edgecolor=_INK, linewidth=1.8, zorder=3)
                )


def _draw_names(axes: Axes, diagram: Diagram) -> None:
    for row, member in enumerate(diagram.members):
        states = (
            f"{len(member.states)} state{'s' * (len(member.states) != 1)}" if member.states else "no states"
        )
        states += " each" * (member.count > 1)
        inside = any(reading.owner == row for reading in member.reads)
        axes.text(
            row + 0.5,
            row + (0.25 if inside else 0.5),
            states,
            ha="center",
            va="center",
            fontsize=8,
            color=_INK,
        )
        for reading in member.reads:
            text = _folded([_short(name, diagram.members[reading.owner]) for name in reading.names])
            below = 0.15 if reading.owner == row else 0.0  # what is read of the same array
            axes.text(
                reading.owner + 0.5, row + 0.5 + below, text, ha="center", va="center", fontsize=8, color=_READ, weight="bold"
            )  # fmt: skip


def _short(name: str, owner: Member) -> str:
    """A name without the path of the agent that has it; elements of arrays are left out."""
    return name.rpartition("].")[2] if owner.count > 1 else name.removeprefix(f"{owner.path}.")


def _folded(names: list[str], most: int = 6) -> str:
    """Names in lines of three; the last ones counted where there are too many."""
    shown = names if len(names) <= most else [*names[: most - 1], f"+{len(names) - most + 1}"]
    lines = [", ".join(shown[i : i + 3]) for i in range(0, len(shown), 3)]
    return ",\n".join(lines).replace("$", r"\$")


def _draw_dots(axes: Axes, diagram: Diagram, cell: float) -> None:
    """A mark for each pair; `cell` in inches."""
    pairs = [(reading.owner + 0.5, row + 0.5) for row, m in enumerate(diagram.members) for reading in m.reads]
    own = [i + 0.5 for i, member in enumerate(diagram.members) if member.states]
    points = (cell * 72 * 0.5) ** 2
    axes.scatter(own, own, s=points, marker="s", color=_INK, linewidths=0)
    if pairs:
        x, y = zip(*pairs, strict=True)
        axes.scatter(x, y, s=points, marker="o", color=_READ, linewidths=0)


def _label_axes(axes: Axes, diagram: Diagram) -> None:
    members = diagram.members
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, labelsize=_LABEL)
    axes.xaxis.tick_top()
    if len(members) > _MOST_LABELLED:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlabel(f"{len(members)} agents in {diagram.group_count} groups", fontsize=8)
        return
    centres = [i + 0.5 for i in range(len(members))]
    axes.set_xticks(centres, [_fitted(member.path) for member in members])
    if len(members) > _MOST_NAMED:
        axes.tick_params(axis="x", labelrotation=90)
    axes.set_yticks(centres, _row_labels(diagram))


def _row_labels(diagram: Diagram) -> list[str]:
    """The names of agents, with the groups that they are in."""
    return [
        _fitted(member.path)
        if member.group is None or member.group == member.path
        else f"{_fitted(member.group)} | {_fitted(member.path)}"
        for member in diagram.members
    ]


def _fitted(name: str) -> str:
    """A name with its middle left out where it is too long."""
    half = _LONGEST // 2
    return name if len(name) <= _LONGEST else f"{name[: half - 1]}…{name[-half:]}"


def _save(figure: Figure, path: Path) -> None:
    def put(file: BinaryIO) -> None:
        figure.savefig(file, format=path.suffix[1:], dpi=130)

    write_whole(path, put)
