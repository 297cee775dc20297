"""Relations: where the right-hand sides of a model jump during a run.

In: the nodes of a model. Out: a warning at each `if` whose condition changes while time goes on, and at each `sign`, `floor`, `ceil`, `round`,
`mod` and `div` of something that changes, in what is integrated. Such places are integrated through, by small steps where the method notices
them; they are not located yet.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from hierc.compiler import unsupported
from hierc.compiler.collector import Collector
from hierc.compiler.expression import Apply, Choose, Expr, Input, Local, Number, Parameter, Rate, State, Time
from hierc.compiler.model import Node

_JUMPING = frozenset({"sign", "floor", "ceil", "round", "mod", "quotient"})


def warn_of_jumps(nodes: tuple[Node, ...], problems: Collector) -> None:
    """Add a warning for every place, once."""
    read = {(source.node, source.index) for node in nodes for source in node.inputs if source.kind == "local"}
    seen = set()
    for node in nodes:
        for jump in _jumps(node, [index for owner, index in read if owner == node.id]):
            if jump.span is not None and jump.span not in seen:
                seen.add(jump.span)
                problems.add(unsupported.Jump(jump.span))


def _jumps(node: Node, published: list[int]) -> Iterator[Choose | Apply]:
    """Jumping expressions in a node's rates and in the definitions that they, or other nodes, use. Those within another are left out."""

    @cache
    def varies(e: Expr) -> bool:
        match e:
            case Time() | State() | Rate() | Input():
                return True
            case Number() | Parameter():
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
                if op in _JUMPING and varies(e):
                    yield e
                stack += args
            case Local(index=index) if index not in visited:
                visited.add(index)
                stack.append(node.definitions[index].value)
            case _:
                pass
