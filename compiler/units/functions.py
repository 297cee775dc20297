"""Units of built-in functions: what each wants of its arguments, and the unit of its value.

In: a call's arguments with their units. Out: the value's unit; what an argument may not be is reported (E401, E403). Wrong numbers of
arguments are the business of `shapes/functions.py`: here they make the value unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

from hierc.compiler.units.agreement import Operand, Rules
from hierc.compiler.units.errors import ArgumentUnit, Side, UnitsDiffer
from hierc.compiler.units.quantity import (
    ANGLE,
    PURE,
    UNKNOWN,
    Leaf,
    Listed,
    Measured,
    Plain,
    Quantity,
    elementwise,
    power,
    product,
    quotient,
    whole,
)
from hierc.grammar import tree
from hierc.grammar.problems import Problem
from hierc.grammar.source import Span

ANY_ANGLE = "an angle or a plain number"
ANY_NUMBER = "a plain number"


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a built-in function. `inside`: the call of a user's function that it stands in."""

    node: tree.Call
    args: tuple[Operand, ...]
    rules: Rules
    inside: Span | None

    def quantity(self, place: int = 0) -> Quantity:
        """What argument `place` is in; unknown where there is none."""
        return self.args[place].quantity if place < len(self.args) else UNKNOWN

    def number(self, wanted: str) -> Leaf:
        """The first argument, which must not have a unit; reports E403."""
        if not self.args:
            return UNKNOWN
        return needed(self.args[0], f"`{self.node.function.text}`", wanted, self.rules, self.inside)

    def joined(self, args: tuple[Operand, ...]) -> Quantity:
        """What arguments of one unit are in; reports E401."""

        def differ(left: Side, right: Side) -> Problem:
            return UnitsDiffer(right.span, text=self.node.span.text, left=left, right=right, call=self.inside)

        if not args:
            return UNKNOWN
        first = args[0]
        for other in args[1:]:
            both = self.rules.agreed(first, other, differ)
            # The unit shown is that of the argument that brought it.
            first = other if isinstance(whole(first.quantity), Plain) else first
            if whole(both) == UNKNOWN:
                return UNKNOWN
        return (
            Plain(all(_is_zero(a) for a in args))
            if isinstance(whole(first.quantity), Plain)
            else first.quantity
        )


def _is_zero(argument: Operand) -> bool:
    found = whole(argument.quantity)
    return isinstance(found, Plain) and found.zero


def needed(given: Operand, function: str, wanted: str, rules: Rules, inside: Span | None) -> Leaf:
    """The unit of an argument that must not have one, or that of an angle; reports E403."""
    found = whole(given.quantity)
    if isinstance(found, Measured) and not found.pure:
        side = rules.side(given, found)
        rules.report(ArgumentUnit(given.span, function=function, wanted=wanted, given=side, call=inside))
        return UNKNOWN
    return found


def _pure(call: Call, wanted: str, result: Measured = PURE) -> Quantity:
    """A function of a number, with a number or an angle as its value."""
    found = call.number(wanted)
    if isinstance(found, Plain):
        return Plain()
    return result if isinstance(found, Measured) else UNKNOWN


def _same(call: Call) -> Quantity:
    return call.quantity()


def _common(call: Call) -> Quantity:
    """All items of a vector or matrix are in one unit, and so is the value."""
    if len(call.args) == 1 and isinstance(items := call.args[0].quantity, Listed):
        return whole(call.joined(tuple(call.args[0].item(k) for k in range(len(items.items)))))
    return whole(call.quantity())


def _trace(call: Call) -> Quantity:
    """Only the diagonal counts: other entries may be in other units."""
    matrix = call.quantity()
    if isinstance(matrix, Listed) and all(isinstance(row, Listed) for row in matrix.items):
        rows = [row.items for row in matrix.items if isinstance(row, Listed)]
        if all(len(row) == len(rows) for row in rows):
            return whole(Listed(tuple(row[k] for k, row in enumerate(rows))))
    return whole(matrix)


def _extreme(call: Call) -> Quantity:
    return _common(call) if len(call.args) == 1 else whole(call.joined(call.args))


def _sign(call: Call) -> Quantity:
    found = whole(call.quantity())
    return PURE if isinstance(found, Measured) else found


def _atan2(call: Call) -> Quantity:
    found = whole(call.joined(call.args))
    return ANGLE if isinstance(found, Measured) else found


def _dot(call: Call) -> Quantity:
    return whole(elementwise(call.quantity(0), call.quantity(1)))


def _cross(call: Call) -> Quantity:
    return product(whole(call.quantity(0)), whole(call.quantity(1)))


def _transpose(call: Call) -> Quantity:
    matrix = call.quantity()
    if isinstance(matrix, Listed):
        rows = [row.items for row in matrix.items if isinstance(row, Listed)]
        if len(rows) == len(matrix.items) and len({len(row) for row in rows}) == 1:
            return Listed(tuple(Listed(column) for column in zip(*rows, strict=True)))
    return whole(matrix)


def _det(call: Call) -> Quantity:
    """The unit to the power of the size, where the list shows it."""
    matrix = call.quantity()
    found = whole(matrix)
    if not isinstance(found, Measured) or found.pure:
        return found
    return power(found, Fraction(len(matrix.items))) if isinstance(matrix, Listed) else UNKNOWN


def _inverse(call: Call) -> Quantity:
    return quotient(Plain(), whole(call.quantity()))


def _solve(call: Call) -> Quantity:
    return quotient(whole(call.quantity(1)), whole(call.quantity(0)))


def _fixed(call: Call, value: Quantity) -> Quantity:
    return value


_RULES: Mapping[str, Callable[[Call], Quantity]] = {
    **dict.fromkeys(("sin", "cos", "tan"), partial(_pure, wanted=ANY_ANGLE)),
    **dict.fromkeys(("asin", "acos", "atan"), partial(_pure, wanted=ANY_NUMBER, result=ANGLE)),
    **dict.fromkeys(
        ("exp", "log", "log10", "sinh", "cosh", "tanh", "floor", "ceil", "round"),
        partial(_pure, wanted=ANY_NUMBER),
    ),
    **dict.fromkeys(("abs", "smooth"), _same),
    **dict.fromkeys(("sum", "norm"), _common),
    **dict.fromkeys(("min", "max", "mod", "clamp"), _extreme),
    "sqrt": lambda call: power(whole(call.quantity()), Fraction(1, 2)),
    "sign": _sign, "atan2": _atan2, "dot": _dot, "cross": _cross, "transpose": _transpose, "trace": _trace, "det": _det, "inverse": _inverse,
    "solve": _solve, "div": partial(_fixed, value=Plain()), "eye": partial(_fixed, value=Plain()),
    "zeros": partial(_fixed, value=Plain(zero=True)),
}  # fmt: skip


def value_of(call: Call) -> Quantity:
    """The unit of the value of a built-in function."""
    rule = _RULES.get(call.node.function.text)
    return UNKNOWN if rule is None else rule(call)
