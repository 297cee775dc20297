"""Relations: where the right-hand sides of a model jump during a run.

In: the nodes of a model. Out: a warning at each `if` whose condition changes while time goes on, and at each `sign`, `floor`, `ceil`, `round`,
`mod`, `div` and `hold` table of something that changes, in what is integrated. Such places are integrated through, by small steps where the method notices
them; they are not located yet.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache

from hierc.compiler import unsupported
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.callees.callee import Table
from hierc.compiler.collector import Collector
from hierc.compiler.expression import (
    Apply,
    Choose,
    Expr,
    Gather,
    Input,
    Local,
    Number,
    Parameter,
    Rate,
    State,
    Time,
)
from hierc.compiler.model import Node
from hierc.grammar.problems import Problem
from hierc.grammar.source import SourceFile, Span

_JUMPING = frozenset({"sign", "floor", "ceil", "round", "mod", "quotient"})


def warn_of_jumps(nodes: tuple[Node, ...], problems: Collector) -> None:
    """Add a warning for every place, once; a place inside another says no more."""
    published: dict[int, set[int]] = {node.id: set() for node in nodes}
    elements = Elements(node.first for node in nodes)
    for node in nodes:
        for source in (source for source in node.inputs if source.kind == "local"):
            for block, index in elements.touched(source, node.count):
                published[block].add(index)
    jumps = (jump.span for node in nodes for jump in _jumps(node, published[node.id]))
    for span in _outermost({span for span in jumps if span is not None}):
        problems.add(unsupported.Jump(span))


def told_once(problems: Sequence[Problem]) -> tuple[Problem, ...]:
    """The same problems, in source order, with the background of jumps only at the first one in each file."""
    told: set[SourceFile] = set()
    result: list[Problem] = []
    for problem in problems:
        span = problem.span
        if isinstance(problem, unsupported.Jump) and span is not None:
            result.append(replace(problem, first=span.file not in told))
            told.add(span.file)
        else:
            result.append(problem)
    return tuple(result)


def _holds(e: Apply) -> bool:
    """Whether it is a table that jumps from value to value."""
    return isinstance(e.callee, Table) and e.callee.method == "hold"


def _outermost(spans: Iterable[Span]) -> Iterator[Span]:
    """Spans that lie in no other one."""
    last: Span | None = None
    for span in sorted(spans, key=lambda s: (s.file.name, s.start, -s.stop)):
        if last is None or span.file != last.file or span.stop > last.stop:
            last = span
            yield span


def _jumps(node: Node, published: Iterable[int]) -> Iterator[Choose | Apply]:
    """Jumping expressions in a node's rates and in the definitions that they, or other nodes, use. Those within another are left out."""

    @cache
    def varies(e: Expr) -> bool:
        match e:
            case Time() | State() | Rate() | Input():
                return True
            case Number() | Parameter() | Gather():
                return False
            case Local(index=index):
                return varies(node.definitions[index].value)
            case Apply(args=args):
                return any(map(varies, args))
            case Choose(condition=condition, then=then, other=other):
                return any(map(varies, (condition, then, other)))

    visited: set[int] = set()
    stack: list[Expr] = [state.rate for state in node.states]
    stack += [node.definitions[index].value for index in published]
    while stack:
        match stack.pop():
            case Choose(condition=condition, then=then, other=other) as e:
                if varies(condition):
                    yield e
                else:
                    stack += [then, other]
                stack.append(condition)
            case Apply(op=op, args=args) as e:
                if (op in _JUMPING or _holds(e)) and varies(e):
                    yield e
                stack += args
            case Local(index=index) if index not in visited:
                visited.add(index)
                stack.append(node.definitions[index].value)
            case _:
                pass
