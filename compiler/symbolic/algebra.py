"""Algebra by sympy on what differentiation made: like terms collected, common factors and sums shared.

In: derivatives as values. Out: equal values that take fewer operations, or the same ones. Guaranteed: sympy sees objects of ours only, symbols
that we name and the four operations between them. Functions, conditions, numbers and everything the user wrote are opaque symbols, so that
nothing of the user's is reordered, no number is rounded or raised to a power, and no branch is entered. No `simplify`.

Differentiation itself is done on our own graph (`symbolic_derivative`): on the four-level cart it takes 3 ms where sympy's `diff` of substituted
expressions takes 140 ms. The Jacobians of its second and third level then take 94 and 186 flops; after this pass 77 and 183; made by
sympy's `diff` and `cse` alone they take 79 and 194.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

import sympy

from hierc.compiler.symbolic.graph import Depends, Graph
from hierc.compiler.symbolic.reduce import power
from hierc.compiler.symbolic.schedule import operations

#: Above so many operations the search for common parts takes seconds and the derivatives stay as they are.
LARGEST = 4000
#: Operations in one expression: sympy's own algorithms take time that grows faster than the expressions.
EXPRESSION = 40

_SUMS = frozenset({"add", "sub", "neg"})
_ALGEBRA = _SUMS | {"mul", "div"}


def tidy(graph: Graph, roots: Sequence[int], given: Collection[int]) -> list[int]:
    """Roots with the same values in fewer operations; `given` values are needed anyway and stay as they are."""
    inside = sorted(v for v in graph.always(roots) if v not in given and graph.values[v].op in _ALGEBRA)
    if not inside or len(inside) > LARGEST:
        return list(roots)
    try:
        tidied = _Algebra(graph, inside).tidied(roots)
    except OverflowError:  # a count of like terms beyond any float
        return list(roots)
    return (
        tidied if operations(graph, [*tidied, *given]) < operations(graph, [*roots, *given]) else list(roots)
    )


class _Algebra:
    """Translates between values and sympy's expressions. Symbol `s17` is value 17."""

    def __init__(self, graph: Graph, inside: Sequence[int]) -> None:
        self._graph = graph
        self._symbols: dict[sympy.Symbol, int] = {}
        self._expressions: dict[int, sympy.Expr] = {}
        self._inside = frozenset(inside)
        self._uses = Counter(a for v in inside for a in graph.values[v].args)
        self._sizes: dict[int, int] = {}
        self._cut: dict[
            int, sympy.Expr
        ] = {}  # values that are symbols in other expressions, as they were too large
        self._pending: dict[sympy.Symbol, sympy.Expr] = {}  # what symbols stand for, not yet a value
        for v in inside:
            self._sizes[v] = 1 + sum(self._sizes.get(a, 0) for a in graph.values[v].args)
            made = self._made(v)
            if self._sizes[v] > EXPRESSION:
                self._cut[v], made, self._sizes[v] = made, sympy.Symbol(f"s{v}"), 0
            self._expressions[v] = made

    def tidied(self, roots: Sequence[int]) -> list[int]:
        """The roots' values, like terms collected and common parts computed once."""
        expressions = [*(self._expression(v) for v in roots), *self._cut.values()]
        names = sympy.numbered_symbols("c")
        common, rest = sympy.cse(expressions, symbols=names, order="canonical")
        self._pending.update(common)
        self._pending.update(zip((self._expressions[v] for v in self._cut), rest[len(roots) :], strict=True))
        return [self._value(e) for e in rest[: len(roots)]]

    # ---- to sympy --------------------------------------------------------------------

    def _expression(self, value: int) -> sympy.Expr:
        """The expression of a value; anything but algebra is a symbol."""
        if value not in self._expressions:
            self._expressions[value] = self._symbol(value)
        return self._expressions[value]

    def _symbol(self, value: int) -> sympy.Expr:
        if self._graph.literal(value) in (0.0, 1.0, -1.0):
            return sympy.Integer(int(self._graph.values[value].number))
        symbol = sympy.Symbol(f"s{value}")
        self._symbols[symbol] = value
        return symbol

    def _made(self, value: int) -> sympy.Expr:
        v = self._graph.values[value]
        match v.op:
            case "add" | "sub" | "neg":
                return sympy.Add(*(self._signed(a, sign) for a, sign in self._terms(value)))
            case "mul":
                return sympy.Mul(*(self._expression(a) for a in v.args))
            case _:
                return sympy.Mul(self._expression(v.args[0]), sympy.Pow(self._expression(v.args[1]), -1))

    def _signed(self, value: int, sign: int) -> sympy.Expr:
        return self._expression(value) if sign > 0 else sympy.Mul(sympy.Integer(-1), self._expression(value))

    def _terms(self, value: int) -> list[tuple[int, int]]:
        """The terms of a sum, with signs, through sums used nowhere else: a long sum is built once, not once a term."""
        terms: list[tuple[int, int]] = []
        stack = [(value, 1)]
        while stack:
            v, sign = stack.pop()
            op, args = self._graph.values[v].op, self._graph.values[v].args
            if op not in _SUMS or (v != value and not (v in self._inside and self._uses[v] == 1)):
                terms.append((v, sign))
                continue
            signs = {"add": (sign, sign), "sub": (sign, -sign), "neg": (-sign,)}[op]
            stack.extend(zip(args[::-1], signs[::-1], strict=True))
        return terms

    # ---- and back ----------------------------------------------------------------------

    def _value(self, e: sympy.Expr) -> int:
        graph = self._graph
        if isinstance(e, sympy.Symbol):
            if e not in self._symbols:
                self._symbols[e] = self._value(self._pending[e])
            return self._symbols[e]
        if isinstance(e, sympy.Number):
            return graph.number(float(e))
        if isinstance(e, sympy.Add):
            return self._sum(e)
        if isinstance(e, sympy.Pow):
            return power(graph, self._value(e.base), float(e.exp))
        return self._product(e)

    def _sum(self, e: sympy.Expr) -> int:
        """A sum, what is constant during a run first."""
        terms = [self._value(a) for a in e.args]
        return self._joined("add", terms)

    def _product(self, e: sympy.Expr) -> int:
        """A product: over its divisors, what is constant during a run first."""
        above, below = [], []
        for a in e.args:
            if isinstance(a, sympy.Pow) and a.exp.is_negative:
                below.append(self._value(sympy.Pow(a.base, -a.exp)))
            else:
                above.append(self._value(a))
        product = self._joined("mul", above) if above else self._graph.number(1.0)
        return self._graph.apply("div", product, self._joined("mul", below)) if below else product

    def _joined(self, op: str, values: list[int]) -> int:
        values.sort(
            key=lambda v: bool(self._graph.depends[v] & Depends.RUN)
        )  # stable: sympy's order otherwise
        joined = values[0]
        for v in values[1:]:
            joined = self._graph.apply(op, joined, v)
        return joined
