"""Tables: declarations and their files become grids of numbers in SI.

In: `table` declarations, and a `Reader` that finds their files. Out: a `Table` for each that is right, and the texts that were read; everything else is
E906, with the lines of the file that are wrong. A file's content is data from anywhere: nothing of it is shown but the start of a wrong word.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

from hierc.compiler.callees.callee import METHODS, Axis, Method, Table
from hierc.compiler.callees.errors import WrongTable
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.imports.modules import Missing, Reader, Refused
from hierc.compiler.units.units import ONE, Unit, parse_unit, scale_of
from hierc.grammar import tree
from hierc.grammar.source import SourceFile, Span

#: Most arguments: the slopes of `cubic` take 2^n numbers a point.
MAX_ARGUMENTS = 4
#: Characters of a wrong word that are shown.
_SHOWN = 16
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)


def read_tables(
    declared: Mapping[str, tree.Table], reader: Reader, problems: Collector
) -> tuple[dict[str, Table], tuple[SourceFile, ...]]:
    """The tables by name, and the files they were read from."""
    found: dict[str, Table] = {}
    files: dict[str, SourceFile] = {}
    for name, item in declared.items():
        try:
            _check_declaration(item)
            file = _file(item, reader)
            found[name] = _Reading(item, file).table()
            files[file.name] = file
        except Rejected as rejection:
            problems.rejected(rejection)
    return found, tuple(files.values())


def text_span(item: tree.Table | tree.Extern) -> Span:
    """Where the string of a declaration stands: its only one."""
    text, start = item.span.text, item.span.start
    return Span(item.span.file, start + text.index('"'), start + text.rindex('"') + 1)


def _check_declaration(item: tree.Table) -> None:
    def refuse(span: Span, reason: str, advice: str | None = None) -> Rejected:
        return Rejected(WrongTable(span, item.file, reason, advice=advice))

    if item.method.text not in METHODS:
        ways = f"there are {', '.join(f'`{m}`' for m in METHODS)}"
        raise refuse(item.method.span, f"no interpolation is called `{item.method.text}`", ways)
    if not 1 <= len(item.params) <= MAX_ARGUMENTS:
        raise refuse(item.name.span, f"a table has 1 to {MAX_ARGUMENTS} arguments, not {len(item.params)}")
    for param in item.params:
        if param.type.scalar != "real" or param.type.sizes or param.default is not None:
            raise refuse(param.span, "an argument of a table is a `real` without a default")


def _file(item: tree.Table, reader: Reader) -> SourceFile:
    match reader.data(item.span.file.name, item.file):
        case SourceFile() as source:
            return source
        case Missing():
            raise Rejected(WrongTable(text_span(item), item.file, "there is no such file beside this one"))
        case Refused(reason=reason):
            raise Rejected(WrongTable(text_span(item), item.file, reason))


@dataclass(frozen=True, slots=True)
class _Row:
    """A line of the file: its number and its columns."""

    line: int
    words: tuple[str, ...]


class _Reading:
    """Reads one table."""

    def __init__(self, item: tree.Table, source: SourceFile) -> None:
        self._item = item
        self._source = source
        self._wrong: list[str] = []

    def table(self) -> Table:
        """The table. Raises Rejected (E906) with every wrong line."""
        rows = self._numbers()
        self._stop()
        axes = self._axes(rows)
        self._stop()
        values = self._values(rows, axes)
        method: Method = next(m for m in METHODS if m == self._item.method.text)
        units = [p.unit.text if p.unit else None for p in self._item.params]
        made = tuple(
            Axis(param.name.text, unit, scale_of(param.unit), tuple(axis.values()))
            for param, unit, axis in zip(self._item.params, units, axes, strict=True)
        )
        digest = hashlib.sha256(repr((method, made, values)).encode()).hexdigest()
        return Table(self._item.name.text, self._item.file, digest, method, made, values)

    def _stop(self) -> None:
        if self._wrong:
            first, *others = self._wrong
            separators = len(self._item.params) > 0 and "," not in self._source.text
            advice = "separate the columns by commas" if separators else None
            raise Rejected(WrongTable(text_span(self._item), self._item.file, first, tuple(others), advice))

    # ---- lines ------------------------------------------------------------------------------------------------------------------------

    def _numbers(self) -> list[_Row]:
        """The lines of numbers; what is wrong with others is noted."""
        good: list[_Row] = []
        columns = len(self._item.params) + 1
        first = True
        for row in self._lines():
            is_header = first and all(map(_is_heading, row.words))
            first = False
            if is_header:
                continue
            wrong = next((word for word in row.words if not _is_number(word)), None)
            if wrong is not None:
                self._note(row, _what(wrong))
            elif len(row.words) != columns:
                count = len(row.words)
                self._note(row, f"{count} column{'s' * (count != 1)}, but the table has {columns}")
            else:
                good.append(row)
        if not good and not self._wrong:
            self._wrong.append("it has no numbers")
        return good

    def _note(self, row: _Row, what: str) -> None:
        self._wrong.append(f"line {row.line}: {what}")

    def _lines(self) -> Iterator[_Row]:
        """The lines that say something."""
        for number, line in enumerate(io.StringIO(self._source.text, newline=None), start=1):
            text = line.partition("#")[0].strip()
            if text:
                words = next(csv.reader([text], skipinitialspace=True), [])
                yield _Row(number, tuple(word.strip() for word in words))

    # ---- the grid ---------------------------------------------------------------------------------------------------------------------

    def _axes(self, rows: Sequence[_Row]) -> list[dict[str, float]]:
        """The grid along each argument, increasing: numbers in SI by a word for each."""
        axes = []
        for k, param in enumerate(self._item.params):
            unit = _unit(param.unit)
            by_number: dict[float, str] = {}
            for row in rows:
                number = self._in_si(row, row.words[k], unit)
                by_number.setdefault(number, row.words[k])
            if len(by_number) < 2 and not self._wrong:
                self._wrong.append(f"there is one point along `{param.name.text}`; a table has 2 at least")
            axes.append({word: number for number, word in sorted(by_number.items())})
        return axes

    def _in_si(self, row: _Row, word: str, unit: Unit) -> float:
        number = float(word) if unit.coherent else _rounded(Fraction(word) * unit.factor)
        if not math.isfinite(number):
            self._note(row, f"`{_short(word)}` is too large")
        return number

    def _values(self, rows: Sequence[_Row], axes: Sequence[Mapping[str, float]]) -> tuple[float, ...]:
        """The values in the order of the grid. Raises Rejected where one is missing or given twice."""
        unit = _unit(self._item.unit)
        units = [_unit(param.unit) for param in self._item.params]
        found: dict[tuple[float, ...], float] = {}
        first: dict[tuple[float, ...], int] = {}
        for row in rows:
            point = tuple(self._in_si(row, w, u) for w, u in zip(row.words, units, strict=False))
            if point in found:
                self._note(row, f"the same point as on line {first[point]}")
            first[point] = row.line
            found[point] = self._in_si(row, row.words[-1], unit)
        grid = [list(axis.values()) for axis in axes]
        if len(found) < math.prod(map(len, grid)) and not self._wrong:
            missing = next(point for point in product(*grid) if point not in found)
            self._wrong.append(f"there is no value for {self._point(missing, axes)}")
        self._stop()
        return tuple(found[point] for point in product(*grid))

    def _point(self, point: tuple[float, ...], axes: Sequence[Mapping[str, float]]) -> str:
        """A point in the words of the file."""
        words = [next(w for w, n in axis.items() if n == at) for at, axis in zip(point, axes, strict=True)]
        return ", ".join(
            f"{p.name.text} = {_short(w)}" for p, w in zip(self._item.params, words, strict=True)
        )


def _unit(unit: tree.Unit | None) -> Unit:
    return ONE if unit is None else parse_unit(unit.text, unit.span)


def _rounded(number: Fraction) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf


def _is_number(word: str) -> bool:
    return _NUMBER.fullmatch(word) is not None and math.isfinite(float(word))


def _is_heading(word: str) -> bool:
    return any(c.isalpha() for c in word) and not _NUMBER.match(word) and not _NOT_FINITE.fullmatch(word)


def _what(word: str) -> str:
    """What is wrong with a word."""
    if not word:
        return "a column is empty"
    if _NOT_FINITE.fullmatch(word) or _NUMBER.fullmatch(word):
        return f"`{_short(word)}` is not a finite number"
    return f"`{_short(word)}` is not a number"


def _short(word: str) -> str:
    """The start of a word, printable."""
    shown = "".join(c if c.isprintable() else "?" for c in word)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
