"""Agreement: when two quantities may be added, compared, assigned or coupled.

Units agree when their dimensions do. Unknown agrees with everything. A plain number takes its neighbour's unit, unless that is not
coherent with SI (E406) or units are checked strictly, when only 0 does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from hierc.compiler.units.errors import PlainBesideUnit, Side
from hierc.compiler.units.quantity import (
    UNKNOWN,
    Leaf,
    Listed,
    Measured,
    Plain,
    Quantity,
    Unknown,
    whole,
)
from hierc.compiler.units.spelling import Spellings, coherent_text
from hierc.grammar import tree
from hierc.grammar.problems import Problem
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class Operand:
    """What takes part in an operation, and what is known of its unit: the expression `node`, or a declared `name`."""

    span: Span
    quantity: Quantity
    node: tree.Expr | None = None
    name: str | None = None

    @property
    def text(self) -> str:
        """The user's text."""
        return self.span.text if self.name is None else self.name

    def item(self, place: int) -> Operand:
        """Item `place` of a list, the text's own where there is one."""
        quantity = self.quantity.items[place] if isinstance(self.quantity, Listed) else self.quantity
        if isinstance(self.node, tree.ListExpr) and place < len(self.node.items):
            return operand(self.node.items[place], quantity)
        return replace(self, quantity=quantity)


def operand(node: tree.Expr, quantity: Quantity) -> Operand:
    """An expression as an operand."""
    return Operand(node.span, quantity, node)


def named(name: tree.Name, quantity: Quantity) -> Operand:
    """A declared name as an operand."""
    return Operand(name.span, quantity, name=name.text)


#: How to word that two operands differ.
Differ = Callable[[Side, Side], Problem]


@dataclass(frozen=True, slots=True)
class Rules:
    """How operands are compared. `report` takes what is wrong; `strict`: no number but 0 takes a unit."""

    strict: bool
    spellings: Spellings
    report: Callable[[Problem], None]

    def agreed(self, left: Operand, right: Operand, differ: Differ) -> Quantity:
        """What both operands are in; reports where they differ, item by item."""
        count = _items(left.quantity, right.quantity)
        if count:
            return Listed(tuple(self.agreed(left.item(i), right.item(i), differ) for i in range(count)))
        return self._leaves(left, whole(left.quantity), right, whole(right.quantity), differ)

    def _leaves(self, left: Operand, a: Leaf, right: Operand, b: Leaf, differ: Differ) -> Leaf:
        if isinstance(a, Unknown) or isinstance(b, Unknown):
            return UNKNOWN
        if isinstance(a, Plain):
            if isinstance(b, Plain):
                return Plain(a.zero and b.zero)
            return b if self._fits(left, a, right, b) else self._refused(differ, left, a, right, b)
        if isinstance(b, Plain):
            return a if self._fits(right, b, left, a) else self._refused(differ, left, a, right, b)
        return a if a.dimension == b.dimension else self._refused(differ, left, a, right, b)

    def _fits(self, number: Operand, plain: Plain, other: Operand, measured: Measured) -> bool:
        """Whether a plain number may take the unit of the other operand; reports E406 where nobody knows which it would be."""
        if plain.zero:
            return True
        if not measured.coherent and measured.text is not None:
            si = coherent_text(measured.text, other.span)
            self.report(
                PlainBesideUnit(
                    number.span, text=number.text, literal=_is_literal(number.node), name=other.text,
                    unit=measured.text, si=si, neighbour=other.span,
                )
            )  # fmt: skip
            return True
        return measured.pure or not self.strict

    def _refused(self, differ: Differ, left: Operand, a: Leaf, right: Operand, b: Leaf) -> Unknown:
        self.report(differ(self.side(left, a), self.side(right, b)))
        return UNKNOWN

    def side(self, shown: Operand, leaf: Leaf) -> Side:
        """An operand in words."""
        return Side(shown.span, shown.text, self.unit_text(leaf))

    def unit_text(self, leaf: Leaf) -> str | None:
        """How to show a unit; None for a plain number."""
        if not isinstance(leaf, Measured):
            return None
        return leaf.text or self.spellings.of(leaf.dimension)


def _items(left: Quantity, right: Quantity) -> int:
    """How many items to compare one by one; 0: compare as a whole."""
    match left, right:
        case Listed(), Listed():
            return len(left.items) if len(left.items) == len(right.items) else 0
        case Listed(), _:
            return len(left.items)
        case _, Listed():
            return len(right.items)
        case _:
            return 0


def _is_literal(node: tree.Expr | None) -> bool:
    if isinstance(node, tree.Unary):
        node = node.operand
    return isinstance(node, tree.Number)
