"""Numbers that the text alone determines: exponents and indices made of literals and constants."""

from __future__ import annotations

from fractions import Fraction
from typing import Protocol

from hierc.grammar import tree

#: Largest magnitude, digits and steps from constant to constant that are followed.
LIMIT = 1000
DIGITS = 12
STEPS = 20


class Constants(Protocol):
    """Where constants are found."""

    def constant(self, name: str) -> tree.Const | None:
        """The constant of this name, if it is one."""
        ...


def rational(
    expr: tree.Expr, scope: Constants, bound: frozenset[str] = frozenset(), steps: int = STEPS
) -> Fraction | None:
    """The exact value of a small expression of literals and constants; None for any other."""
    if steps == 0:
        return None
    match expr:
        case tree.Number(unit=None, text=text, value=value) if value <= LIMIT and len(text) <= DIGITS:
            # What rounds to 0 may have an exponent that no computer can expand.
            return Fraction(0) if value == 0 else Fraction(text) if value >= 1 / LIMIT else None
        case tree.Unary(op="+" | "-", operand=operand):
            inner = rational(operand, scope, bound, steps - 1)
            return -inner if inner is not None and expr.op == "-" else inner
        case tree.Binary(op="+" | "-" | "*" | "/", left=left, right=right):
            a, b = (rational(side, scope, bound, steps - 1) for side in (left, right))
            return None if a is None or b is None else _result(expr.op, a, b)
        case tree.Ref(prime=False, path=tree.Path(steps=(tree.Step(name=name, subs=()),))):
            const = None if name.text in bound else scope.constant(name.text)
            return None if const is None else rational(const.value, scope, frozenset(), steps - 1)
        case _:
            return None


def _result(op: str, a: Fraction, b: Fraction) -> Fraction | None:
    if op == "/" and b == 0:
        return None
    value = a + b if op == "+" else a - b if op == "-" else a * b if op == "*" else a / b
    return value if abs(value) <= LIMIT and value.denominator <= LIMIT else None
