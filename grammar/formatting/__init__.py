"""The formatter: the same model in the one style of `.hier` files.

In: a source file. Out: its text laid out anew, with the same tree and the same comments, which is checked before anybody gets it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

from hierc.grammar import tree
from hierc.grammar.formatting.layout import layout
from hierc.grammar.formatting.statements import Printer
from hierc.grammar.parser import parse
from hierc.grammar.recovery import DEEPEST
from hierc.grammar.source import SourceFile

WIDTH = 100

#: Five for each of the operators between two brackets, and some.
CALLS_A_LEVEL = 50


class UnsafeFormat(Exception):
    """The formatter would have damaged a file: a fault of its own. The message names the file and the damage."""


def format_source(source: SourceFile, width: int = WIDTH) -> str:
    """The text of `source` in lines of at most `width` columns, as far as words and strings allow.

    Line breaks are of the kind that the text begins with. Raises ModelError if the text does not parse, UnsafeFormat if the
    result would not mean the same, would lose a comment, or would come out different the next time.
    """
    crlf = source.text.partition("\n")[0].endswith("\r")
    before = parse(SourceFile(source.name, source.text.replace("\r\n", "\n")))
    text = _laid_out(before, width)
    after = parse(SourceFile(source.name, text))
    if not same_tree(before.items, after.items):
        raise UnsafeFormat(f"formatting `{source.name}` would change its meaning")
    if _remarks(before) != _remarks(after):
        raise UnsafeFormat(f"formatting `{source.name}` would lose a comment")
    if _laid_out(after, width) != text:
        raise UnsafeFormat(f"formatting `{source.name}` twice would change it twice")
    return text.replace("\n", "\r\n") if crlf else text


def _laid_out(file: tree.File, width: int) -> str:
    with _calls_as_deep_as_trees():
        doc = Printer(file.source.text).file(file)
    return layout(doc, width)


@contextmanager
def _calls_as_deep_as_trees() -> Iterator[None]:
    """Room for the calls of the printer, which follow the nesting of a text; the parser sets that a limit."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(limit + DEEPEST * CALLS_A_LEVEL)
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


def _remarks(file: tree.File) -> list[list[str]]:
    """The comments without the blanks at the ends of their lines."""
    return [[line.rstrip() for line in comment.text.split("\n")] for comment in file.comments]


def same_tree(first: object, second: object) -> bool:
    """Whether two trees say the same; `analog`, said or left out, is the same. Does not recurse."""
    waiting = [(first, second)]
    while waiting:
        a, b = waiting.pop()
        if type(a) is not type(b):
            return False
        if isinstance(a, tree.Decl) and isinstance(b, tree.Decl):
            waiting.append((a.kind or "analog", b.kind or "analog"))
        if isinstance(a, tuple) and isinstance(b, tuple):
            if len(a) != len(b):
                return False
            waiting.extend(zip(a, b, strict=True))
        elif isinstance(a, tree.Node):
            names = [
                f.name for f in fields(a) if f.compare and not (isinstance(a, tree.Decl) and f.name == "kind")
            ]
            waiting.extend((getattr(a, name), getattr(b, name)) for name in names)
        elif a != b:
            return False
    return True
