"""The structure of a model for people and for other tools: a table for the terminal, Graphviz and JSON; pictures are in `picture.py`.

The table is the incidence of the model: one row and one column for each agent (or level with equations of its own), slow ones first. Rows
read columns. Below the diagonal stands who reads whom; above it nothing can stand, which is what lets every group have a step size of its own.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from itertools import groupby, takewhile

from hierc.compiler.diagram import Diagram, Member
from hierc.grammar.render import visible

#: What is drawn around a box, from the outside: (`level` or `group`, its name).
Clusters = tuple[tuple[str, str], ...]

#: Columns of text that are kept for what is read, however wide the matrix is.
_LEAST = 24


@dataclass(frozen=True, slots=True)
class Marks:
    """The signs of the table."""

    own: str
    array: str
    reads: str
    same_block: str
    nothing: str
    rule: str


UNICODE = Marks(own="■", array="▣", reads="●", same_block="□", nothing="·", rule="─")
ASCII = Marks(own="#", array="@", reads="x", same_block="o", nothing=".", rule="-")


def marks_for(encoding: str | None) -> Marks:
    """Box characters where the terminal's encoding has them."""
    try:
        "".join(astuple(UNICODE)).encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return ASCII
    return UNICODE


# ---- the terminal ----------------------------------------------------------------------------------------------------------------


def to_text(diagram: Diagram, marks: Marks = UNICODE, width: int = 100) -> str:
    """The table, at most `width` columns wide where names allow. The matrix is left out where there is no room for it."""
    columns = _columns(diagram, marks)
    rows = list(zip(*columns, strict=True))
    widths = [max(map(len, column)) for column in columns]
    fixed = sum(widths) + 2 * len(widths)
    reads = ["reads", *(_reads(member) for member in diagram.members)]
    least = min(_LEAST, max(map(len, reads)))
    shown = fixed + least <= width
    if not shown:
        rows, widths = [row[:-1] for row in rows], widths[:-1]
        fixed = sum(widths) + 2 * len(widths)
    room = max(width - fixed, least)
    table = [_row(row, widths, text, room) for row, text in zip(rows, reads, strict=True)]
    rule = marks.rule * max(len(line) for lines in table for line in lines)
    lines = [_title(diagram), "", *table[0], rule]
    several = len(diagram.members) > len({member.block for member in diagram.members})
    levels = _levels(diagram)
    for i, (member, row) in enumerate(zip(diagram.members, table[1:], strict=True)):
        if several and i > 0 and diagram.members[i - 1].block != member.block:
            lines.append(rule)
        lines += _heads(levels[i], levels[i - 1] if i > 0 else (), widths[0] + 2)
        lines += row
    lines += ["", *_legend(diagram, marks, shown=shown)]
    return "\n".join(lines) + "\n"


def _levels(diagram: Diagram) -> list[tuple[str, ...]]:
    """For each member the levels around it that hold several groups, from the outside."""
    divided = diagram.divided()
    return [tuple(level for level in member.levels if level in divided) for member in diagram.members]


def _heads(levels: Sequence[str], before: Sequence[str], margin: int) -> Iterator[str]:
    """A line for each of `levels` that was not around the member before."""
    common = len(list(takewhile(lambda pair: pair[0] == pair[1], zip(levels, before, strict=False))))
    for depth, level in enumerate(levels[common:], start=common):
        yield " " * (margin + 2 * depth) + level


def _title(diagram: Diagram) -> str:
    experiment = f", experiment {diagram.experiment}" if diagram.experiment else ""
    states = sum(len(member.states) * member.count for member in diagram.members)
    counts = f"{_count(diagram.group_count, 'group')}, {_count(states, 'state')}"
    return f"{diagram.model} ({visible(diagram.file)}){experiment}: {counts}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _columns(diagram: Diagram, marks: Marks) -> list[list[str]]:
    """The columns before the last: number, group, member, states, matrix. The first entry of each is its head."""
    members = diagram.members
    groups = [
        ""
        if i and members[i - 1].group == member.group and member.group
        else "  " * len(levels) + (member.group or "-")
        for i, (member, levels) in enumerate(zip(members, _levels(diagram), strict=True))
    ]
    size = len(str(len(members)))
    head = " ".join(str(i).rjust(size) for i in range(1, len(members) + 1))
    return [
        ["", *(str(i).rjust(size) for i in range(1, len(members) + 1))],
        ["group", *groups],
        ["agent", *(_label(member) for member in members)],
        ["states", *(_states(member).rjust(6) for member in members)],
        [head, *(" ".join(s.rjust(size) for s in _signs(members, i, marks)) for i in range(len(members)))],
    ]


def _label(member: Member) -> str:
    return f"{member.path}: {member.template}" if member.path != member.template else member.path


def _states(member: Member) -> str:
    """How many states it has; for an array, the elements times the states of each."""
    several = member.count > 1 and member.states
    return f"{member.count}x{len(member.states)}" if several else str(len(member.states))


def _signs(members: Sequence[Member], row: int, marks: Marks) -> Iterator[str]:
    """A row of the matrix."""
    here = members[row]
    read = {reading.owner for reading in here.reads}
    for column, member in enumerate(members):
        if column == row:
            yield marks.array if column in read else marks.own
        elif column in read:
            yield marks.reads
        elif member.block == here.block:
            yield marks.same_block
        else:
            yield marks.nothing if column < row else " "


def _reads(member: Member) -> str:
    return ", ".join(name for reading in member.reads for name in reading.names)


def _row(cells: Sequence[str], widths: Sequence[int], reads: str, room: int) -> list[str]:
    """A row as lines: what is read may need several."""
    begin = "".join(cell.ljust(width) + "  " for cell, width in zip(cells, widths, strict=True))
    first, *rest = textwrap.wrap(reads, room, break_long_words=False) or [""]
    return [(begin + first).rstrip(), *(" " * len(begin) + line for line in rest)]


def _legend(diagram: Diagram, marks: Marks, *, shown: bool) -> Iterator[str]:
    if not shown:
        yield "The matrix has no room here: -o graph.svg draws it."
    else:
        pairs = [
            (a, b) for a, b in zip(diagram.members, diagram.members[1:], strict=False) if a.block == b.block
        ]
        array = any(reading.owner == i for i, m in enumerate(diagram.members) for reading in m.reads)
        own = f"{marks.own} own equations" + (
            f"   {marks.array} the same, reading others of the array" * array
        )
        rounds = any(a.group != b.group and None not in (a.group, b.group) for a, b in pairs)
        inside = f"   {marks.same_block} same group{', or reading in turn' * rounds}" if pairs else ""
        yield f"Rows read columns: {own}   {marks.reads} reads{inside}"
    if any(member.group is None for member in diagram.members):
        yield "What has no states is in no group (-): it is computed where it is read, or once, if many groups read it."


# ---- other tools -----------------------------------------------------------------------------------------------------------------


def to_json(diagram: Diagram) -> str:
    """The diagram as JSON: groups in cascade order, and agents with what they read."""
    members = diagram.members
    data = {
        "model": diagram.model,
        "file": diagram.file,
        "experiment": diagram.experiment,
        "groups": [
            {"name": group, "agents": [m.path for m in members if m.group == group]}
            for group in diagram.groups
        ],
        "agents": [
            {
                "path": member.path,
                "agent": member.template,
                "levels": list(member.levels),
                "group": member.group,
                **({"count": member.count} if member.count > 1 else {}),
                "states": list(member.states),
                "reads": [
                    {"of": members[reading.owner].path, "variables": list(reading.names)}
                    for reading in member.reads
                ],
            }
            for member in members
        ],
    }
    return json.dumps(data, indent=2) + "\n"


def to_dot(diagram: Diagram) -> str:
    """The diagram for Graphviz: a cluster for each group, and for each level that holds several; arrows lead from members to those that read them."""
    lines = [f"digraph {_quoted(diagram.model)} {{", "  rankdir=LR;", "  node [shape=box];"]
    clusters = [
        (*(("level", level) for level in levels), *((("group", m.group),) if m.group else ()))
        for m, levels in zip(diagram.members, _levels(diagram), strict=True)
    ]
    boxes = [
        f"n{i} [label={_quoted(_label(m))}{'' if m.states else ', style=dashed'}];"
        for i, m in enumerate(diagram.members)
    ]
    lines += (f"  {line}" for line in _clustered(list(zip(clusters, boxes, strict=True))))
    for i, member in enumerate(diagram.members):
        for reading in member.reads:
            lines.append(f"  n{reading.owner} -> n{i} [label={_quoted(', '.join(reading.names))}];")
    return "\n".join([*lines, "}"]) + "\n"


def _clustered(items: Sequence[tuple[Clusters, str]]) -> Iterator[str]:
    """Boxes in their clusters, which may be nested. Graphviz takes clusters of one name for one."""
    for cluster, run in groupby(items, key=lambda item: item[0][0] if item[0] else None):
        if cluster is None:
            yield from (box for _, box in run)
            continue
        kind, name = cluster
        yield f"subgraph {_quoted(f'cluster {kind} {name}')} {{"
        yield f"  label={_quoted(name)};"
        yield from (f"  {line}" for line in _clustered([(inner[1:], box) for inner, box in run]))
        yield "}"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


#: What writes each kind of file.
WRITERS: Mapping[str, Callable[[Diagram], str]] = {".dot": to_dot, ".json": to_json}
