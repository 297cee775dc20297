"""The language's own examples: they parse, and every span is exact."""

from __future__ import annotations

import re
import typing
from itertools import pairwise
from pathlib import Path

import pytest

from hierc.grammar import tree
from hierc.grammar.parser import parse
from hierc.grammar.reading import read_source
from hierc.grammar.source import SourceFile

EXAMPLES = sorted((Path(__file__).parent / "examples").glob("*.hier"))
EXPRESSIONS = typing.get_args(tree.Expr)


def children(node: tree.Node) -> list[tree.Node]:
    """The nodes directly inside a node, in the order of the text."""
    values = [getattr(node, name) for kind in type(node).__mro__ for name in getattr(kind, "__slots__", ())]
    inner = [child for value in values for child in (value if isinstance(value, tuple) else (value,))]
    return sorted((c for c in inner if isinstance(c, tree.Node)), key=lambda c: (c.span.start, -c.span.stop))


def walk(root: tree.Node) -> list[tree.Node]:
    """All nodes below and including `root`."""
    found, waiting = [], [root]
    while waiting:
        node = waiting.pop()
        found.append(node)
        waiting.extend(children(node))
    return found


@pytest.fixture(params=EXAMPLES, ids=lambda path: path.stem)
def example(request: pytest.FixtureRequest) -> tree.File:
    return parse(read_source(request.param))


def test_there_are_examples_of_the_whole_language() -> None:
    seen = {type(node) for path in EXAMPLES for node in walk(parse(read_source(path)))}
    every = {kind for kind in vars(tree).values() if isinstance(kind, type) and issubclass(kind, tree.Node)}
    assert every - seen == {tree.Node}


def test_spans_lie_within_their_parents_and_do_not_overlap(example: tree.File) -> None:
    for node in walk(example):
        assert node.span.file is example.source
        inner = children(node)
        for child in inner:
            assert node.span.start <= child.span.start < child.span.stop <= node.span.stop
        for left, right in pairwise(inner):
            assert left.span.stop <= right.span.start


def test_leaves_carry_their_text(example: tree.File) -> None:
    for node in walk(example):
        match node:
            case tree.Name():
                assert node.span.text == node.text
            case tree.Unit():
                assert node.span.text[1:-1].strip() == node.text
            case tree.Binary():
                assert node.op_span.text == node.op
                assert node.left.span.stop <= node.op_span.start < node.op_span.stop <= node.right.span.start
            case tree.Number():
                assert node.span.text.startswith(node.text)
                assert node.value == float(node.text)


def test_every_expression_reads_the_same_from_its_own_text(example: tree.File) -> None:
    for node in walk(example):
        if isinstance(node, EXPRESSIONS):
            again = parse(SourceFile("again", f"const real x = {node.span.text};"))
            assert isinstance(const := again.items[0], tree.Const)
            assert const.value == node


def test_every_item_ends_where_its_text_ends(example: tree.File) -> None:
    for item in example.items:
        again = parse(SourceFile("again", item.span.text)).items
        assert [without_doc(i) for i in again] == [without_doc(item)]


def without_doc(item: tree.Item) -> str:
    return re.sub(r"doc='[^']*'", "", repr(item))


def test_all_comments_are_kept_in_order(example: tree.File) -> None:
    text = example.source.text
    without_strings = re.sub(r'"(?:\\.|[^"\n])*"', lambda m: " " * len(m.group()), text)
    marks = [m.start() for m in re.finditer(r"(?<!/)//|/\*", without_strings)]
    assert [c.span.start for c in example.comments] == marks
    assert all(c.text == c.span.text and "\n" not in c.text for c in example.comments)


def test_layout_means_nothing(example: tree.File) -> None:
    text = example.source.text
    for comment in reversed(example.comments):
        if not comment.text.startswith("///"):
            text = text[: comment.span.start] + text[comment.span.stop :]
    loose = re.sub(r"(?m)^(?!\s*///)(.*)$", r"\1  /* here */  ", text.replace(";", "\t;"))
    assert parse(SourceFile("loose", loose)).items == example.items


def test_docs_are_the_lines_right_above() -> None:
    source = SourceFile(
        "docs",
        "/// Of the file.\n\n/// First\n///   second\nagent A() {\n  /// of x\n  read real x; /// trailing\n"
        "  read real z;\n  //// ruler\n  read real y;\n  /// of the level\n  level l {\n    /// of p\n    agent p = P(); } }\n"
        "/// of e\nexperiment e of A() { }\n",
    )
    agent, experiment = parse(source).items
    assert isinstance(agent, tree.Agent)
    assert agent.doc == "First\n  second"
    x, z, y, level = agent.items
    assert isinstance(x, tree.Decl)
    assert isinstance(y, tree.Decl)
    assert isinstance(z, tree.Decl)
    assert isinstance(level, tree.Level)
    assert (x.doc, z.doc, y.doc, level.doc) == ("of x", "", "", "of the level")
    assert isinstance(part := level.items[0], tree.Instance)
    assert part.doc == "of p"
    assert isinstance(experiment, tree.Experiment)
    assert experiment.doc == "of e"
