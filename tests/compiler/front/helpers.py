"""Models from text or from the gallery, for the tests of this folder."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

from hierc.compiler.front import analyse
from hierc.compiler.model import Model, Node
from hierc.grammar.parser import parse
from hierc.grammar.source import SourceFile


def model_of(text: str, **choice: object) -> Model:
    return analyse(parse(SourceFile("test.hier", text)), **choice)


def gallery(name: str, **choice: object) -> Model:
    file = files("hierc.models").joinpath(f"{name}.hier")
    return analyse(parse(SourceFile(f"{name}.hier", file.read_text(encoding="utf-8"))), **choice)


def node(model: Model, path: str) -> Node:
    (found,) = (n for n in model.nodes if n.path == path)
    return found


def form(node: Node) -> Node:
    """What a node says, without where it stands and what it reads: equal for nodes of one class."""
    bare = replace(
        node,
        id=0,
        first=0,
        path="",
        levels=(),
        inputs=(),
        input_spans=(),
        parameters=tuple(range(len(node.parameters))),
    )
    states = tuple(replace(s, span=node.span, rate_span=node.span) for s in node.states)
    definitions = tuple(replace(d, span=node.span) for d in node.definitions)
    return replace(bare, states=states, definitions=definitions)


def reads(model: Model, path: str) -> list[str]:
    """What a node reads: `plan.p[1]'`."""
    from hierc.compiler.formula import Names

    return [Names(model).source(source) for source in node(model, path).inputs]


def groups(model: Model) -> dict[str, list[str]]:
    return {group.name: [model.nodes[n].path for n in group.nodes] for group in model.groups}
