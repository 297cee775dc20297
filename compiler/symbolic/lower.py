"""Lowering: a node's expressions become values of the graph.

In: a `Node` whose expressions may be deep trees (a sum of ten thousand terms). Out: value numbers. Guaranteed: nothing here recurses; `Local`
and `Rate` are what they stand for, at no cost, since equal values are shared.

The right operand of `and` and `or` is evaluated in vain at most when it cannot fail: `x > 0 and log(x) < 1` becomes an `if`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import assert_never

from hierc.compiler.arrays.columns import Index
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
from hierc.compiler.symbolic.graph import Graph


class Lowering:
    """Lowers expressions of one node. With `initial`, states stand for their initial values.

    Values of parameters have no node: `entry` gives the value of what they use of the parameter vector.
    """

    def __init__(
        self,
        graph: Graph,
        node: Node | None = None,
        *,
        initial: bool = False,
        entry: Callable[[Index], int] | None = None,
    ) -> None:
        self._graph = graph
        self._node = node
        self._initial = initial
        self._entry = entry
        self._done: dict[int, int] = {}  # by identity: comparing deep trees would recurse

    def value(self, expression: Expr) -> int:
        """The value of an expression."""
        stack = [expression]
        open_: set[int] = set()
        while stack:
            e = stack[-1]
            if id(e) in self._done:
                stack.pop()
                continue
            missing = [p for p in self._parts(e) if id(p) not in self._done]
            if not missing:
                self._graph.at(e.span)
                self._done[id(e)] = self._lower(e)
                stack.pop()
                continue
            if id(e) in open_:
                raise ValueError(f"cyclic definitions reached code generation: {missing[0]}")
            open_.add(id(e))
            stack.extend(missing)
        return self._done[id(expression)]

    def _parts(self, e: Expr) -> tuple[Expr, ...]:
        """The expressions that `e` needs first."""
        match e:
            case Apply(args=args):
                return args
            case Choose(condition=condition, then=then, other=other):
                return (condition, then, other)
            case Local(index=index):
                return (self._owner().definitions[index].value,)
            case Rate(index=index):
                return (self._owner().states[index].rate,)
            case State(index=index) if self._initial:
                return (self._owner().states[index].initial,)
            case Number() | Time() | State() | Input() | Parameter() | Gather():
                return ()
            case _:
                assert_never(e)

    def _lower(self, e: Expr) -> int:
        graph = self._graph
        parts = [self._done[id(p)] for p in self._parts(e)]
        match e:
            case Apply(op="and"):
                return self._and(*parts)
            case Apply(op="or"):
                return self._or(*parts)
            case Apply(op="det"):
                return graph.determinant(graph.factor(parts))
            case Apply(op="solve", args=(Number(value=index), *_)):
                n = math.isqrt(len(parts) - 1)  # n*n + n is less than (n + 1)^2
                return graph.unknown(graph.factor(parts[1 : 1 + n * n]), parts[1 + n * n :], int(index))
            case Apply(op="call", callee=callee) if callee is not None:
                return graph.call(callee, parts)
            case Apply(op=op):
                return graph.apply(op, *parts)
            case Choose():
                return graph.choose(*parts)
            case Local() | Rate():
                return parts[0]
            case State(index=index):
                return parts[0] if self._initial else graph.leaf("state", index)
            case Number(value=value):
                return graph.number(value)
            case Time():
                return graph.leaf("time")
            case Input(index=index):
                return graph.leaf("input", index)
            case Parameter(index=index) | Gather(kind="parameter", at=index) if self._entry is not None:
                return self._entry(index)
            case Parameter(index=index):
                return graph.leaf("parameter", index)
            case Gather():
                raise ValueError("what elements gather was not made an input or parameter of their node")
            case _:
                assert_never(e)

    def _and(self, a: int, b: int) -> int:
        if is_total(self._graph, b):
            return self._graph.apply("and", a, b)
        return self._graph.choose(a, b, self._graph.number(0.0))

    def _or(self, a: int, b: int) -> int:
        if is_total(self._graph, b):
            return self._graph.apply("or", a, b)
        return self._graph.choose(a, self._graph.number(1.0), b)

    def _owner(self) -> Node:
        if self._node is None:
            raise ValueError("a parameter's value refers to a variable")
        return self._node


def is_total(graph: Graph, value: int) -> bool:
    """Whether a value can be evaluated in vain: nothing in it has a domain."""
    return all(graph.is_total(v) for v in graph.reach([value]))
