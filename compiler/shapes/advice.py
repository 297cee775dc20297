"""How to write what was meant: for operators and functions of numbers that were given vectors or matrices.

In: the operands of a rejected expression, with their values. Out: text of the language, or None where that would not be short and certain.
"""

from __future__ import annotations

from collections.abc import Sequence

from hierc.compiler.shapes.values import Shape, Value
from hierc.grammar import tree

Operand = tuple[tree.Expr, Value]


def of_function(function: str, operands: Sequence[Operand]) -> str | None:
    """A function of numbers, applied to each element."""

    def call(texts: Sequence[str]) -> str:
        return f"{function}({', '.join(texts)})"

    shape = _shape(operands)
    return None if shape is None else f"write `{_each(shape, call(_elements(operands, shape)))}`"


def of_operator(node: tree.Binary, left: Value, right: Value) -> str | None:
    """An operator that does not take these operands."""
    a, b = node.left.span.text, node.right.span.text
    match node.op, left.shape, right.shape:
        case "*", (_,), (_,):
            return f"write `dot({a}, {b})`, or `.*` for the product of each pair"
        case "*", (n,), (m, _) if n == m:
            return f"a vector is a column: write `transpose({b})*{a}`"
        case "/", _, _ if left.shape == right.shape:
            return "write `./` to divide element by element"
        case "^", (n, m), () if b == "2" and n == m and _name(node.left):
            return f"write `{a}*{a}` for the product of matrices, `{a} .* {a}` for each element"
        case "^", (n, m), () if b == "-1" and n == m:
            return f"write `inverse({a})`, or `solve({a}, b)` for its product with `b`"
        case (("+" | "-" | "^"), _, _) if (
            shape := _shape([(node.left, left), (node.right, right)])
        ) is not None:
            first, second = _elements([(node.left, left), (node.right, right)], shape)
            between = node.op if node.op == "^" else f" {node.op} "
            return f"write `{_each(shape, f'{first}{between}{second}')}`"
    return None


def _shape(operands: Sequence[Operand]) -> Shape | None:
    """The shape of all operands that are not scalars, if they are names and have the same; scalars must be short."""
    shapes = {value.shape for _, value in operands if value.shape}
    simple = all(_name(expr) if value.shape else _is_short(expr) for expr, value in operands)
    return shapes.pop() if len(shapes) == 1 and simple else None


def _elements(operands: Sequence[Operand], shape: Shape) -> list[str]:
    index = "[i]" if len(shape) == 1 else "[i,j]"
    return [expr.span.text + (index if value.shape else "") for expr, value in operands]


def _each(shape: Shape, item: str) -> str:
    """A list of `item` for all elements."""
    if len(shape) == 1:
        return f"[{item} for i in 1..{shape[0]}]"
    return f"[[{item} for j in 1..{shape[1]}] for i in 1..{shape[0]}]"


def _name(expr: tree.Expr) -> bool:
    """Whether an expression is a plain name, that is not one of the indices used here."""
    return (
        isinstance(expr, tree.Ref)
        and not expr.prime
        and not expr.path.steps[-1].subs
        and expr.path.text not in ("i", "j")
    )


def _is_short(expr: tree.Expr) -> bool:
    return isinstance(expr, tree.Number) or _name(expr)
