"""Laying out: from a document, which says where lines may end, to text of a given width.

In: a document of text, possible line ends, groups and indentation. Out: the text. A group stands on one line where it
fits, otherwise its lines end; a wrap ends a line only where its item does not fit. This is the algebra of Wadler ("A
prettier printer", 2003) in the greedy, iterative form that most formatters use: depth and length of a document do not matter.

A line break is due until the next text is written, so several of them are one, and no line ends in blanks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple, assert_never

INDENT = 2


@dataclass(frozen=True, slots=True)
class Aside:
    """Text that may stick out: a comment at the end of a line does not break what stands before it."""

    text: str


@dataclass(frozen=True, slots=True)
class Line:
    """A line break in a broken group, with a blank line if `blank`; otherwise the text `flat`."""

    flat: str = " "
    blank: bool = False


@dataclass(frozen=True, slots=True)
class Break:
    """A line break that no group can do without."""

    blank: bool = False


@dataclass(frozen=True, slots=True)
class _Compound:
    #: Columns on one line, and whether it cannot stand on one line.
    width: int = field(init=False)
    forced: bool = field(init=False)

    def _measure(self, parts: Iterable[Doc], *, broken: bool = False) -> None:
        width, forced = 0, broken
        for part in parts:
            width += width_of(part)
            forced = forced or is_forced(part)
        object.__setattr__(self, "width", width)  # derived once, in the constructor only
        object.__setattr__(self, "forced", forced)


@dataclass(frozen=True, slots=True)
class Concat(_Compound):
    """The parts one after the other."""

    parts: tuple[Doc, ...]

    def __post_init__(self) -> None:
        self._measure(self.parts)


@dataclass(frozen=True, slots=True)
class Indent(_Compound):
    """Lines inside begin one step further right."""

    inner: Doc

    def __post_init__(self) -> None:
        self._measure((self.inner,))


@dataclass(frozen=True, slots=True)
class Group(_Compound):
    """On one line if it fits and need not be `broken`; otherwise all lines directly inside end."""

    inner: Doc
    broken: bool = False

    def __post_init__(self) -> None:
        self._measure((self.inner,), broken=self.broken)


@dataclass(frozen=True, slots=True)
class Wrap(_Compound):
    """An item of a longer row. In a broken group it begins a line if it does not fit on the last one, or if that is `kept`."""

    flat: str
    item: Doc
    kept: bool = False

    def __post_init__(self) -> None:
        self._measure((self.flat, self.item))


Doc = str | Aside | Line | Break | Concat | Indent | Group | Wrap


def concat(*parts: Doc) -> Doc:
    """The parts one after the other."""
    present = tuple(part for part in parts if part != "")
    if not present:
        return ""
    return present[0] if len(present) == 1 else Concat(present)


def spaced(*parts: Doc | None) -> Doc:
    """The parts with a space between; what is None is left out."""
    present = [part for part in parts if part is not None]
    return concat(*[piece for part in present for piece in (" ", part)][1:])


def width_of(doc: Doc) -> int:
    """Columns that a document takes on one line."""
    match doc:
        case str():
            return len(doc)
        case Line():
            return len(doc.flat)
        case Aside() | Break():
            return 0
        case _:
            return doc.width


def is_forced(doc: Doc) -> bool:
    """Whether a document cannot stand on one line."""
    match doc:
        case str():
            return "\n" in doc
        case Aside() | Line():
            return False
        case Break():
            return True
        case _:
            return doc.forced


class _Task(NamedTuple):
    """A document to be written."""

    indent: int
    flat: bool
    doc: Doc


def layout(doc: Doc, width: int) -> str:
    """The text of a document, its lines no longer than `width` columns where that is possible; it ends with a line break."""
    page = _Page()
    tasks = [_Task(0, False, doc)]
    while tasks:
        indent, flat, doc = tasks.pop()
        match doc:
            case str():
                page.write(doc, indent)
            case Aside():
                page.write(doc.text, indent)
            case Line() if flat:
                page.write(doc.flat, indent)
            case Line() | Break():
                page.end_line(blank=doc.blank)
            case Concat():
                tasks.extend(_Task(indent, flat, part) for part in reversed(doc.parts))
            case Indent():
                tasks.append(_Task(indent + INDENT, flat, doc.inner))
            case Group():
                flat = flat or (not doc.forced and _fits(doc.inner, width - page.at(indent), tasks))
                tasks.append(_Task(indent, flat, doc.inner))
            case Wrap():
                room = width - page.at(indent) - len(doc.flat)
                if flat or (not doc.kept and _fits(doc.item, room, tasks)):
                    page.write(doc.flat, indent)
                else:
                    page.end_line()
                tasks.append(_Task(indent, flat, doc.item))
            case _:
                assert_never(doc)
    return page.text()


def _fits(first: Doc, room: int, later: list[_Task]) -> bool:
    """Whether `first` on one line and what is written after it, up to where a line may end, take at most `room` columns."""
    waiting, below = [(True, first)], len(later)
    while room >= 0:
        if not waiting:
            if below == 0:
                return True
            below -= 1
            waiting.append(later[below][1:])
        flat, doc = waiting.pop()
        if flat and not is_forced(doc):
            room -= width_of(doc)
            continue
        match doc:
            case str():
                room -= len(doc.partition("\n")[0])
                if "\n" in doc:
                    return room >= 0
            case Break():
                return True
            case Line() | Wrap() if not flat:
                return True
            case Wrap():
                waiting += [(flat, doc.item), (flat, doc.flat)]
            case Concat():
                waiting.extend((flat, part) for part in reversed(doc.parts))
            case Indent():
                waiting.append((flat, doc.inner))
            case Group():
                waiting.append((flat and not doc.forced, doc.inner))
            case Aside() | Line():
                room -= width_of(doc)
            case _:
                assert_never(doc)
    return False


class _Page:
    """What has been written."""

    def __init__(self) -> None:
        self._parts: list[str] = []
        self._column = 0
        self._due = 0

    def at(self, indent: int) -> int:
        """The column where text would go."""
        return indent if self._due or not self._parts else self._column

    def end_line(self, *, blank: bool = False) -> None:
        """Let the next text begin a line."""
        self._due = max(self._due, 2 if blank else 1)

    def write(self, text: str, indent: int) -> None:
        """Write text; at the start of a line without the blanks that would set it off from the text before."""
        if self._due or not self._parts:
            text = text.lstrip(" ")
            if not text:
                return
            self._begin_line(indent)
        self._parts.append(text)
        last = text.rpartition("\n")
        self._column = len(last[2]) if last[1] else self._column + len(text)

    def _begin_line(self, indent: int) -> None:
        if self._parts:
            self._strip()
            self._parts.append("\n" * self._due)
        self._parts.append(" " * indent)
        self._column, self._due = indent, 0

    def _strip(self) -> None:
        while self._parts and not self._parts[-1].strip(" "):
            self._parts.pop()

    def text(self) -> str:
        """All that was written, and a line break."""
        self._strip()
        return "".join(self._parts) + "\n" if self._parts else ""
