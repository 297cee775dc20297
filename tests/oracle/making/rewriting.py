"""Other texts that mean the same: all names changed, one more agent around the model, levels joined, other units."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from fractions import Fraction
from itertools import pairwise

from hierc.grammar import tree
from hierc.grammar.parser import parse
from hierc.grammar.source import SourceFile, Span
from making.text import Block


def _parsed(text: str) -> tree.File:
    return parse(SourceFile("model.hier", text))


def _nodes(node: object) -> Iterator[tree.Node]:
    """All nodes of a tree, but names of settings and of built-in functions."""
    if isinstance(node, tuple):
        for item in node:
            yield from _nodes(item)
    elif isinstance(node, tree.Node):
        yield node
    if is_dataclass(node) and not isinstance(node, tree.Setting | Span | SourceFile):
        for field in fields(node):
            yield from _nodes(getattr(node, field.name))


def _replaced(text: str, changes: dict[Span, str]) -> str:
    for span in sorted(changes, key=lambda s: -s.start):
        text = text[: span.start] + changes[span] + text[span.stop :]
    return text


def _new(name: str) -> str:
    return f"r_{name[::-1]}"


def renamed_path(path: str) -> str:
    """A path after `renamed`."""
    return re.sub(r"[A-Za-z_]\w*", lambda name: _new(name[0]), path)


def renamed(text: str) -> str:
    """Every name that the text gives is another one."""
    file = _parsed(text)
    funcs = {i.name.text for i in file.items if isinstance(i, tree.Func)}
    foreign = {
        n.function.span
        for n in _nodes(file.items)
        if isinstance(n, tree.Call) and n.function.text not in funcs
    }
    foreign |= {i.name.span for i in file.items if isinstance(i, tree.Experiment)}
    changes = {
        n.span: _new(n.text)
        for n in _nodes(file.items)
        if isinstance(n, tree.Name) and n.span not in foreign and n.text != "pi"
    }
    return _replaced(text, changes)


def wrapped(text: str, *, level: bool) -> str:
    """The model as agent `inner` of another one, which is what runs then."""
    *_, run = (i for i in _parsed(text).items if isinstance(i, tree.Experiment))
    own = [a for a in run.args if len(a.path.steps) == 1]
    args = ", ".join(a.span.text for a in own)
    binds = ", ".join(b.span.text for b in run.bindings)
    instance = f"agent inner = {run.agent.text}({args}){f' [{binds}]' * bool(binds)};"
    outer = f"agent Outer() {{ {f'level only {{ {instance} }}' if level else instance} }}"
    changes = {
        n.path.span: f"inner.{n.path.span.text}"
        for n in _nodes(run.items)
        if isinstance(n, tree.Initial | tree.Pattern | tree.GroupSettings)
    }
    _, _, items = _replaced(text, changes)[run.span.start :].partition("{")
    given = ", ".join(f"inner.{a.span.text}" for a in run.args if a not in own)
    return f"{text[: run.span.start]}{outer}\nexperiment run of Outer({given}) {{{items}"


def joined(block: Block) -> Block:
    """In every agent, the last two levels in a row that have none inside are one."""
    items = [joined(i) if isinstance(i, Block) else i for i in block.items]
    levels = [i for i in items if isinstance(i, Block) and i.is_level]
    pairs = [
        pair
        for pair in pairwise(levels)
        if not any(isinstance(i, Block) and i.is_level for level in pair for i in level.items)
    ]
    if pairs:
        first, second = pairs[-1]
        both = Block(first.head, [*first.items, *second.items])
        items = [both if i is first else i for i in items if i is not second]
    return Block(block.head, items)


_LEADING = re.compile(r"(m|kg)(?![\w^])")


def in_thousandths(text: str) -> str:
    """Metres and kilograms that begin a unit are millimetres and grams, with numbers to match."""
    changes: dict[Span, str] = {}
    numbers = {
        n.unit.span: n
        for n in _nodes(_parsed(text).items)
        if isinstance(n, tree.Number) and n.unit is not None
    }
    for unit in _nodes(_parsed(text).items):
        if not isinstance(unit, tree.Unit) or (found := _LEADING.match(unit.text)) is None:
            continue
        other = f"[{'mm' if found[0] == 'm' else 'g'}{unit.text[found.end() :]}]"
        number = numbers.get(unit.span)
        if number is None:
            changes[unit.span] = other
        else:
            changes[number.span] = f"{float(Fraction(number.text) * 1000)!r} {other}"
    return _replaced(text, changes)
