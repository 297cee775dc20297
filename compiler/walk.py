"""Walking syntax trees of expressions without recursion, so that a sum of thousands of terms is no danger."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

from hierc.grammar import tree


@dataclass(frozen=True, slots=True)
class Visit:
    """One node of an expression on the way through it.

    `bound`: index names that hold here. `fixed`: stands in a subscript, a range or a size, so it must be known when compiling.
    `depth`: how deeply nested; the terms of one chain `a + b - c` count as equally deep.
    """

    node: tree.Expr
    bound: frozenset[str]
    fixed: bool
    depth: int


def visit(expr: tree.Expr, bound: frozenset[str] = frozenset(), *, fixed: bool = False) -> Iterator[Visit]:
    """Every node of `expr`, parents first, in text order."""
    stack = [Visit(expr, bound, fixed, 1)]
    while stack:
        here = stack.pop()
        yield here
        stack.extend(reversed(below(here)))


def below(here: Visit) -> list[Visit]:
    """The parts of a node, in text order."""
    bound, fixed, depth = here.bound, here.fixed, here.depth + 1
    match here.node:
        case tree.Number() | tree.Bool() | tree.Time():
            return []
        case tree.Ref(path=path):
            return [Visit(e, bound, True, depth) for step in path.steps for e in subscripts(step.subs)]
        case tree.Call(args=items) | tree.ListExpr(items=items):
            return [Visit(e, bound, fixed, depth) for e in items]
        case tree.Unary(operand=operand):
            return [Visit(operand, bound, fixed, depth)]
        case tree.Binary(left=left, right=right):
            return [Visit(left, bound, fixed, here.depth), Visit(right, bound, fixed, depth)]
        case tree.Cond(condition=condition, then=then, other=other):
            return [Visit(e, bound, fixed, depth) for e in (condition, then, other)]
        case tree.Comprehension(item=item, over=over):
            ends = [Visit(e, bound, True, depth) for e in (over.range.first, over.range.last)]
            return [*ends, Visit(item, bound | {over.index.text}, fixed, depth)]
        case _ as never:
            assert_never(never)


def subscripts(subs: tuple[tree.Expr | tree.Range, ...]) -> list[tree.Expr]:
    """The expressions of subscripts: ranges give both their ends."""
    found: list[tree.Expr] = []
    for sub in subs:
        if isinstance(sub, tree.Range):
            found += [sub.first, sub.last]
        else:
            found.append(sub)
    return found
