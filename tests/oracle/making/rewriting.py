"""Other texts that mean the same: all names changed, one more agent around the model, levels joined, other units."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from fractions import Fraction
from itertools import pairwise
from random import Random

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
    funcs = {i.name.text for i in file.items if isinstance(i, tree.Func | tree.Table | tree.Extern)}
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


def without_groups(block: Block) -> Block:
    """No `group` statement, so that groups are those of levels and circles."""
    items = [without_groups(i) if isinstance(i, Block) else i for i in block.items]
    in_agents = not block.head.startswith("experiment")
    return Block(
        block.head, [i for i in items if not (in_agents and isinstance(i, str) and i.startswith("group "))]
    )


def split(text: str, rng: Random) -> tuple[str, dict[str, str]]:
    """The same model in three files: the main one imports the other two, and one of these the other. Returns its text, and theirs by module.

    A definition uses only those before it, so the text may be cut anywhere.
    """
    items = [i for i in _parsed(text).items if not isinstance(i, tree.Experiment)]
    experiments = [i for i in _parsed(text).items if isinstance(i, tree.Experiment)]
    cuts = sorted(rng.randint(0, len(items)) for _ in range(2))
    first, second, third = items[: cuts[0]], items[cuts[0] : cuts[1]], items[cuts[1] :]
    files = {"base": _of(first, {}), "parts.more": _of(second, {"base": first})}
    return _of([*third, *experiments], {"base": first, "parts.more": second}), files


def _of(items: Sequence[tree.Item], imported: Mapping[str, Sequence[tree.Item]]) -> str:
    """A file with some definitions, which imports names that it uses: `base` by `from`, others qualified."""
    names = {
        item.name.text: module
        for module, there in imported.items()
        for item in there
        if not isinstance(item, tree.Import | tree.FromImport)
    }
    texts: list[str] = []
    used: dict[str, set[str]] = {}
    for item in items:
        changes: dict[Span, str] = {}
        own = _declared(item)
        for span, name in _foreign(item):
            if name in names and name not in own:
                module = names[name]
                used.setdefault(module, set()).add(name)
                if module != "base":
                    changes[span] = f"lib.{name}"
        texts.append(_within(item.span, changes))
    head = "".join(
        f"from base import {', '.join(sorted(found))};\n"
        if module == "base"
        else f"import {module} as lib;\n"
        for module, found in used.items()
    )
    return head + "\n".join(texts) + "\n"


def _declared(item: tree.Item) -> set[str]:
    """Names that mean something else inside a definition."""
    return {
        n.name.text
        for n in _nodes(item)
        if isinstance(n, tree.Param | tree.Declarator | tree.Let | tree.Const | tree.Instance)
        and n is not item
    }


def _foreign(item: tree.Item) -> Iterator[tuple[Span, str]]:
    """Where a definition names another: in references, calls and instances."""
    for node in _nodes(item):
        match node:
            case tree.Ref(path=path) if len(path.steps) == 1:
                yield path.steps[0].name.span, path.steps[0].name.text
            case tree.Call(function=function):
                yield function.span, function.text
            case tree.Instance(agent=agent) | tree.Experiment(agent=agent):
                yield agent.span, agent.text


def _within(span: Span, changes: dict[Span, str]) -> str:
    """The text at a place, with changes in it."""
    moved = {Span(s.file, s.start - span.start, s.stop - span.start): new for s, new in changes.items()}
    return _replaced(span.text, moved)


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
