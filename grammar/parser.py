"""Parsing: the text of a `.hier` file to its syntax tree.

In: a source file. Out: a frozen tree with exact spans, doc comments and all comments; or `ModelError` with every syntax
problem found. Anything is taken, from an empty file to noise; nothing is executed, imported or cached on disk.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib.resources import files

from lark import Lark, Token
from lark.lexer import PatternRE, TerminalDef

from hierc.grammar import tree
from hierc.grammar.build import build_items
from hierc.grammar.problems import ModelError, in_source_order
from hierc.grammar.recovery import RecoveringParser, words_of
from hierc.grammar.source import SourceFile, Span


def parse(source: SourceFile) -> tree.File:
    """The syntax tree of `source`. Raises ModelError with all syntax problems, in source order."""
    reading = RecoveringParser(_lark(), source)
    parsed = reading.run()
    if parsed is None:
        raise ModelError(in_source_order(reading.problems))
    comments = tuple(_comments(source, reading.tokens))
    items = build_items(parsed, source, _docs(source, comments))
    return tree.File(Span(source, 0, len(source.text)), source, items, comments)


@cache
def _lark() -> Lark:
    """The parser, its table built once a process (about 0.1 s)."""
    grammar = files("hierc.grammar").joinpath("hier.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", propagate_positions=True, edit_terminals=whole_words)


#: These may stand beside a name. There lark reads a name first and then looks what it is, so they keep their plain pattern.
BESIDE_NAMES = frozenset({"RECORD", "SAVE", "HISTORY", "EACH"})


def whole_words(terminal: TerminalDef) -> None:
    """Let a word end where it ends, so that `integer` is never read as `int eger`."""
    if words_of(terminal) and terminal.name not in BESIDE_NAMES:
        terminal.pattern = PatternRE(terminal.pattern.to_regexp() + r"\b")


def _comments(source: SourceFile, tokens: Sequence[Token]) -> Iterator[tree.Comment]:
    """All comments: whatever stands between tokens and is not blank."""
    comment = re.compile(_lark().get_terminal("COMMENT").pattern.to_regexp())
    starts = [0, *(t.end_pos or 0 for t in tokens)]
    stops = [*(t.start_pos or 0 for t in tokens), len(source.text)]
    for start, stop in zip(starts, stops, strict=True):
        for match in comment.finditer(source.text, start, stop):
            yield tree.Comment(Span(source, *match.span()), match.group())


def _docs(source: SourceFile, comments: Iterable[tree.Comment]) -> dict[int, str]:
    """Doc text by the offset of what it documents: the run of `///` lines that ends right above."""
    docs: dict[int, str] = {}
    for comment in comments:
        before = source.text[source.text.rfind("\n", 0, comment.span.start) + 1 : comment.span.start]
        if before.strip() or not re.match(r"///(?!/)", comment.text):
            continue
        above = docs.pop(comment.span.start, None)
        line = comment.text[3:].rstrip().removeprefix(" ")
        docs[_next_line(source, comment.span.stop)] = line if above is None else f"{above}\n{line}"
    return docs


def _next_line(source: SourceFile, offset: int) -> int:
    """Offset of the first character after one line break and blanks; a blank line is not crossed."""
    match = re.compile(r"[ \t\f\r]*\n[ \t\f]*").match(source.text, offset)
    return match.end() if match else offset
