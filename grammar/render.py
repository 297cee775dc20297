"""Problems as text for people and as data for editors.

`render` draws the user's own lines with the spans marked, in the form of rustc's messages:

    error[E111]: missing `;`
     --> cart.hier:2:23
      |
    2 |   write real x [m] = 0
      |                       ^ add `;` here

Everything that comes from the user is made safe to print first: control characters, bidirectional controls and escape
sequences are shown by their code point. Columns on the screen allow for tabs and wide characters.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from hierc.grammar.problems import Label, Problem
from hierc.grammar.source import SourceFile, Span

TAB = 4
WINDOW = 120  # characters of the user's text; longer lines are clipped around the main span
ELLIPSIS = "…"

_COLOURS = {"error": "\x1b[1;31m", "warning": "\x1b[1;33m", "secondary": "\x1b[1;34m", "bold": "\x1b[1m"}
_RESET = "\x1b[0m"


@dataclass(frozen=True, slots=True)
class _Mark:
    """One stretch of carets under one line, from column `start` to before `stop`, both counted from 0.

    The columns are characters of the line at first and columns of the screen once `_clip` has placed the mark.
    """

    line: int
    start: int
    stop: int
    main: bool
    text: str


def render(problem: Problem, *, color: bool = False) -> str:
    """The problem as lines of text, without a final line break. `color` adds ANSI colours."""
    paint = _paint if color else _plain
    head = paint(f"{problem.severity}[{problem.code}]", problem.severity)
    lines = [f"{head}{paint(': ' + visible(problem.title()), 'bold')}"]
    blocks = _blocks(problem)
    width = max((len(str(mark.line)) for _, marks in blocks for mark in marks), default=0)
    for i, (span, marks) in enumerate(blocks):
        line, column = span.file.position(span.start)
        arrow = paint(" " * width + ("-->" if i == 0 else ":::"), "secondary")
        lines.append(f"{arrow} {visible(span.file.name)}:{line}:{column}")
        lines.extend(_draw(span.file, marks, width, problem.severity, color))
    for kind, texts in (("note", problem.notes()), ("help", problem.help())):
        for text in texts:
            lines.extend(_remark_lines(kind, text, width, color))
    return "\n".join(lines)


def render_all(problems: Iterable[Problem], *, color: bool = False) -> str:
    """All problems, one below the other."""
    return "\n".join(render(problem, color=color) for problem in problems)


def to_json(problem: Problem) -> dict[str, Any]:
    """Every field of a problem as plain data; lines and columns count from 1, ends are exclusive."""
    return {
        "code": problem.code,
        "severity": problem.severity,
        "title": problem.title(),
        **_place(problem.span),
        "remark": problem.remark(),
        "labels": [{**_place(label.span), "text": label.text} for label in problem.labels()],
        "notes": list(problem.notes()),
        "help": list(problem.help()),
        "edits": [{**_place(edit.span), "text": edit.text} for edit in problem.edits()],
    }


def visible(text: str) -> str:
    """`text` with everything a terminal would act on replaced by its code point, as in `<U+001B>`."""
    return "".join(_shown(character) for character in text)


def _place(span: Span | None) -> dict[str, Any]:
    if span is None:
        return {"file": None, "line": None, "column": None, "end_line": None, "end_column": None}
    line, column = span.file.position(span.start)
    end_line, end_column = span.file.position(span.stop)
    return {
        "file": span.file.name,
        "line": line,
        "column": column,
        "end_line": end_line,
        "end_column": end_column,
    }


# ---- screen columns -----------------------------------------------------------------------------


def _shown(character: str) -> str:
    category = unicodedata.category(character)
    if category in ("Cc", "Cf", "Cs", "Zl", "Zp"):
        return f"<U+{ord(character):04X}>"
    return character


def _screen(text: str) -> tuple[str, list[int]]:
    """What is shown for a line, and the screen column of each of its characters (one more for the end)."""
    shown: list[str] = []
    columns = [0]
    for character in text:
        if character == "\t":
            piece = " " * (TAB - columns[-1] % TAB)
        else:
            piece = _shown(character)
        shown.append(piece)
        columns.append(columns[-1] + sum(map(_width, piece)))
    return "".join(shown), columns


def _width(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in ("W", "F") else 1


# ---- blocks and marks ---------------------------------------------------------------------------


def _blocks(problem: Problem) -> list[tuple[Span, list[_Mark]]]:
    """The marks of each file, the main span's file first; each block is headed by the first span in it."""
    labels = [(label, False) for label in problem.labels()]
    if problem.span is not None:
        labels.insert(0, (Label(problem.span, problem.remark()), True))
    spans: dict[SourceFile, Span] = {}
    marks: dict[SourceFile, list[_Mark]] = {}
    for label, main in labels:
        spans.setdefault(label.span.file, label.span)
        marks.setdefault(label.span.file, []).extend(_marks(label, main))
    return [(spans[file], marks[file]) for file in spans]


def _marks(label: Label, main: bool) -> Iterator[_Mark]:
    """One mark, or two for a span of several lines: to the end of its first line, and up to its end."""
    file, start, stop = label.span.file, label.span.start, label.span.stop
    first, begin = file.position(start)
    last, end = file.position(stop)
    if last > first and end == 1:  # ends with a line break
        last, end = last - 1, len(file.line(last - 1)) + 1
    if first == last:
        yield _Mark(first, begin - 1, end - 1, main, label.text)
        return
    yield _Mark(first, begin - 1, len(file.line(first)), main, "")
    text = file.line(last)
    yield _Mark(last, min(len(text) - len(text.lstrip()), end - 1), end - 1, main, label.text)


# ---- drawing ------------------------------------------------------------------------------------


def _draw(file: SourceFile, marks: list[_Mark], width: int, severity: str, color: bool) -> Iterator[str]:
    """The marked lines with their carets, in order; dots stand for lines left out."""
    paint = _paint if color else _plain
    bar = paint(" " * (width + 1) + "|", "secondary")
    yield bar
    previous: int | None = None
    for number, group in groupby(sorted(marks, key=lambda m: m.line), key=lambda m: m.line):
        if previous is not None and number == previous + 2:
            yield f"{paint(f'{previous + 1:>{width}} |', 'secondary')} {_clip(file.line(previous + 1), [])[0]}".rstrip()
        elif previous is not None and number > previous + 1:
            yield paint("...", "secondary")
        previous = number
        text, placed = _clip(file.line(number), list(group))
        yield f"{paint(f'{number:>{width}} |', 'secondary')} {text}".rstrip()
        for row in _rows(placed, severity, color):
            yield f"{bar} {row}"


def _clip(line: str, marks: list[_Mark]) -> tuple[str, list[_Mark]]:
    """What is shown of a line, chosen around the main mark, and the marks in columns of the screen."""
    focus = next((m for m in marks if m.main), marks[0] if marks else None)
    left = 0 if focus is None or focus.stop < WINDOW - 10 else max(0, focus.start - WINDOW // 3)
    if len(line) <= WINDOW:
        left = 0
    before, after = ELLIPSIS if left else "", ELLIPSIS if len(line) > left + WINDOW else ""
    shown, columns = _screen(line[left : left + WINDOW])
    placed = []
    for m in marks:
        start, stop = (
            columns[min(max(c - left, 0), len(columns) - 1)] + len(before) for c in (m.start, m.stop)
        )
        placed.append(_Mark(m.line, start, max(stop, start + 1), m.main, m.text))
    return f"{before}{shown}{after}", placed


def _rows(marks: list[_Mark], severity: str, color: bool) -> Iterator[str]:
    """Carets under one line; the rightmost remark beside them, the others below, hanging from bars."""
    cells = _Cells()
    for mark in sorted(marks, key=lambda m: m.main):  # the main mark is drawn over the others
        cells.put(mark.start, ("^" if mark.main else "-") * (mark.stop - mark.start), _style(mark, severity))
    hanging = sorted((m for m in marks if m.text), key=lambda m: (m.start, m.main))
    if hanging and hanging[-1].stop == max(m.stop for m in marks):
        mark = hanging.pop()
        cells.put(mark.stop + 1, visible(mark.text), _style(mark, severity))
    yield cells.drawn(color)
    if hanging:
        yield _bars(hanging, severity).drawn(color)
    while hanging:
        mark = hanging.pop()
        cells = _bars(hanging, severity)
        cells.put(mark.start, visible(mark.text), _style(mark, severity))
        yield cells.drawn(color)


def _bars(marks: list[_Mark], severity: str) -> _Cells:
    cells = _Cells()
    for mark in marks:
        cells.put(mark.start, "|", _style(mark, severity))
    return cells


class _Cells:
    """One row of characters with a style each."""

    def __init__(self) -> None:
        self._cells: list[tuple[str, str]] = []

    def put(self, column: int, text: str, style: str) -> None:
        """Write `text` from `column` on, over what stands there."""
        self._cells.extend([(" ", "")] * (column + len(text) - len(self._cells)))
        self._cells[column : column + len(text)] = [(character, style) for character in text]

    def drawn(self, color: bool) -> str:
        """The row as a string, neighbours of one style painted together."""
        paint = _paint if color else _plain
        runs = groupby(self._cells, key=lambda cell: cell[1])
        return "".join(paint("".join(c for c, _ in run), style) for style, run in runs)


def _style(mark: _Mark, severity: str) -> str:
    return severity if mark.main else "secondary"


def _remark_lines(kind: str, text: str, width: int, color: bool) -> Iterator[str]:
    """`= note: …`; further lines of the text are indented below the first."""
    paint = _paint if color else _plain
    first, *rest = text.split("\n")
    yield f"{' ' * (width + 1)}{paint('=', 'secondary')} {paint(kind, 'bold')}: {visible(first)}"
    for line in rest:
        yield f"{' ' * (width + 5 + len(kind))}{visible(line)}".rstrip()


def _paint(text: str, style: str) -> str:
    return f"{_COLOURS[style]}{text}{_RESET}" if style else text


def _plain(text: str, style: str) -> str:
    return text
