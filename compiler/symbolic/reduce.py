"""Reductions on whole functions: powers become products, and what depends on parameters alone is computed once a run.

In: the values that functions store. Out: values to store instead. Guaranteed: a value of parameters alone is taken out of a function only if
it was needed there whichever branch is taken, or cannot fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from hierc.compiler.symbolic.graph import Depends, Graph

#: Up to this power products are used; above, `pow` is as fast and more accurate.
LARGEST_PRODUCT = 32


def expand(graph: Graph, roots: Iterable[int]) -> dict[int, int]:
    """Writes powers with small whole or half exponents as products and roots. Maps everything the roots are made of."""

    def rule(value: int, args: tuple[int, ...]) -> int:
        if graph.values[value].op == "pow":
            exponent = graph.literal(args[1])
            return graph.rebuild(value, args) if exponent is None else power(graph, args[0], exponent)
        return graph.rebuild(value, args)

    return _rewrite(graph, roots, rule)


def power(graph: Graph, base: int, exponent: float) -> int:
    """A power by a literal: by repeated squaring, and a root for a half, if the exponent is small; otherwise `pow`."""
    if not (2.0 * exponent).is_integer() or abs(exponent) > LARGEST_PRODUCT:
        return graph.apply("pow", base, graph.number(exponent))
    if exponent < 0.0:
        return graph.apply("div", graph.number(1.0), power(graph, base, -exponent))
    whole, square, result = int(exponent), base, None
    while whole:
        if whole & 1:
            result = square if result is None else graph.apply("mul", result, square)
        whole >>= 1
        if whole:
            square = graph.apply("mul", square, square)
    if not exponent.is_integer():
        root = graph.apply("sqrt", base)
        result = root if result is None else graph.apply("mul", result, root)
    return graph.number(1.0) if result is None else result


def constants(graph: Graph, functions: Sequence[Iterable[int]], extra: Iterable[int] = ()) -> tuple[int, ...]:
    """The largest values of parameters alone in what functions store; each is to be computed once a run.

    What only `extra` needs is taken out if it cannot fail: a variable without a value must not stop the run.
    """
    roots = [*(v for stored in functions for v in stored), *extra]
    certain = {v for stored in functions for v in graph.always(stored)}
    total: set[int] = set()
    for v in graph.reach(roots):
        if graph.is_total(v) and total.issuperset(graph.values[v].args):
            total.add(v)
    found: set[int] = set()
    seen: set[int] = set()
    stack = roots
    while stack:
        v = stack.pop()
        if v in seen:
            continue
        seen.add(v)
        is_sign = graph.values[v].op == "neg"  # costs nothing where it is used
        if graph.depends[v] == Depends.PARAMETER and not is_sign and (v in certain or v in total):
            found.add(v)
        else:
            stack.extend(graph.values[v].args)
    return tuple(sorted(found))


def replace(graph: Graph, roots: Iterable[int], by: Mapping[int, int]) -> dict[int, int]:
    """Puts the values `by` in the place of others. Maps everything the roots are made of."""

    def rule(value: int, args: tuple[int, ...]) -> int:
        return by[value] if value in by else graph.rebuild(value, args)

    return _rewrite(graph, roots, rule)


def _rewrite(
    graph: Graph, roots: Iterable[int], rule: Callable[[int, tuple[int, ...]], int]
) -> dict[int, int]:
    new: dict[int, int] = {}
    for v in graph.reach(roots):
        new[v] = rule(v, tuple(new[a] for a in graph.values[v].args))
    return new
