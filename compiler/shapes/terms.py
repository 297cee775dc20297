"""Scalar expressions as terms: cutting deep ones, so that everything after may recurse without care."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from hierc.compiler.expression import Apply, Choose, Expr

#: Deepest expression that leaves the front half.
MAX_DEPTH = 64


def cut(expr: Expr, define: Callable[[Expr], Expr]) -> Expr:
    """`expr` with every part that is `MAX_DEPTH` deep replaced by what `define` gives for it, a leaf."""
    todo: list[tuple[Expr, bool]] = [(expr, False)]
    done: list[tuple[Expr, int]] = []
    while todo:
        here, ready = todo.pop()
        parts = _parts(here)
        if not parts:
            done.append((here, 0))
        elif not ready:
            todo.append((here, True))
            todo.extend((part, False) for part in reversed(parts))
        else:
            built = done[-len(parts) :]
            del done[-len(parts) :]
            depth = 1 + max(d for _, d in built)
            new = _rebuilt(here, tuple(e for e, _ in built))
            done.append((define(new), 0) if depth >= MAX_DEPTH else (new, depth))
    return done[0][0]


def _parts(expr: Expr) -> tuple[Expr, ...]:
    match expr:
        case Apply(args=args):
            return args
        case Choose(condition=condition, then=then, other=other):
            return (condition, then, other)
        case _:
            return ()


def _rebuilt(expr: Expr, parts: tuple[Expr, ...]) -> Expr:
    if all(new is old for new, old in zip(parts, _parts(expr), strict=True)):
        return expr
    if isinstance(expr, Choose):
        condition, then, other = parts
        return Choose(expr.span, condition, then, other)
    if isinstance(expr, Apply):
        return replace(expr, args=parts)
    return expr


def rewritten(expr: Expr, leaf: Callable[[Expr], Expr]) -> Expr:
    """`expr`, which is not deep, with each leaf replaced by what `leaf` gives for it."""
    parts = _parts(expr)
    if not parts:
        return leaf(expr)
    return _rebuilt(expr, tuple(rewritten(part, leaf) for part in parts))
