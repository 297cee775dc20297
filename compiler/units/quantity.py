"""Quantities: what is known of an expression's unit, and the algebra of it.

An expression is `Measured`; or `Plain`, made of literals and integers; or `Unknown`, because it holds a name declared without a unit.
`Listed` keeps the items of a list apart as long as they may differ. Nothing here reports anything: what does not fit is `Unknown`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

from hierc.compiler.units.spelling import rate_text
from hierc.compiler.units.units import ONE, parse_unit
from hierc.grammar import tree

#: Exponents of the seven base units, in the order of `units.BASE`.
Dimension = tuple[Fraction, ...]

NONE: Dimension = ONE.exponents
SECOND: Dimension = tuple(Fraction(k == 2) for k in range(7))

#: Largest exponent that is followed; a unit beyond it is no unit of anything.
MAX_EXPONENT = 1000


@dataclass(frozen=True, slots=True)
class Measured:
    """In a unit. `text` is the user's own spelling, where it has one; `coherent`: whether values in that spelling are SI values."""

    dimension: Dimension
    text: str | None = None
    coherent: bool = True

    @property
    def pure(self) -> bool:
        """Whether it is a ratio or an angle."""
        return self.dimension == NONE


@dataclass(frozen=True, slots=True)
class Plain:
    """Literals and integers. `zero`: it is 0, which is 0 in every unit."""

    zero: bool = False


@dataclass(frozen=True, slots=True)
class Unknown:
    pass


@dataclass(frozen=True, slots=True)
class Listed:
    """A list, item by item; never empty."""

    items: tuple[Quantity, ...]


Leaf = Measured | Plain | Unknown
Quantity = Leaf | Listed

UNKNOWN = Unknown()
PURE = Measured(NONE)
ANGLE = Measured(NONE, "rad")
TIME = Measured(SECOND, "s")


def in_unit(unit: tree.Unit) -> Measured:
    """What a unit in the text says. Raises Rejected (E404) if it is none."""
    parsed = parse_unit(unit.text, unit.span)
    return Measured(parsed.exponents, unit.text, parsed.coherent)


def declared(unit: tree.Unit | None, scalar: str) -> Quantity:
    """A declared name: integers are plain, others without a unit unknown."""
    if unit is not None:
        return in_unit(unit)
    return Plain() if scalar == "int" else UNKNOWN


# ---- products and powers --------------------------------------------------------------------------------------------------------------


def product(left: Quantity, right: Quantity) -> Quantity:
    """`left * right`, which may be a product of matrices."""
    return _combined(left, right, _times)


def quotient(left: Quantity, right: Quantity) -> Quantity:
    """`left / right`, where `right` is a scalar."""
    return _combined(left, right, _over)


def elementwise(left: Quantity, right: Quantity, *, divide: bool = False) -> Quantity:
    """`left .* right` or `left ./ right`."""
    if isinstance(left, Listed) and isinstance(right, Listed) and len(left.items) == len(right.items):
        pairs = zip(left.items, right.items, strict=True)
        return Listed(tuple(elementwise(a, b, divide=divide) for a, b in pairs))
    return _combined(left, right, _over if divide else _times)


def power(base: Quantity, exponent: Fraction) -> Quantity:
    """`base ^ exponent`, item by item."""

    def raised(leaf: Leaf) -> Leaf:
        if not isinstance(leaf, Measured) or exponent == 1:
            return leaf
        return _measured(e * exponent for e in leaf.dimension)

    return mapped(base, raised)


def rate(quantity: Quantity) -> Quantity:
    """The derivative by time."""

    def per_second(leaf: Leaf) -> Leaf:
        if not isinstance(leaf, Measured):
            return leaf
        dimension = tuple(a - b for a, b in zip(leaf.dimension, SECOND, strict=True))
        return Measured(dimension, rate_text(leaf.text) if leaf.text else None, leaf.coherent)

    return mapped(quantity, per_second)


def _combined(left: Quantity, right: Quantity, combine: Callable[[Leaf, Leaf], Leaf]) -> Quantity:
    """Both as a whole; a list of differing items only with something that is no list."""
    a, b = uniform(left), uniform(right)
    if a is not None and b is not None:
        return combine(a, b)
    if a is not None and not isinstance(left, Listed):
        return mapped(right, lambda leaf: combine(a, leaf))
    if b is not None and not isinstance(right, Listed):
        return mapped(left, lambda leaf: combine(leaf, b))
    return UNKNOWN


def _times(left: Leaf, right: Leaf) -> Leaf:
    if isinstance(left, Unknown) or isinstance(right, Unknown):
        return UNKNOWN
    if isinstance(left, Plain):
        return Plain(left.zero or right.zero) if isinstance(right, Plain) else left if left.zero else right
    if isinstance(right, Plain):
        return right if right.zero else left
    return _measured(a + b for a, b in zip(left.dimension, right.dimension, strict=True))


def _over(left: Leaf, right: Leaf) -> Leaf:
    match right:
        case Measured():
            return _times(left, _measured(-e for e in right.dimension))
        case Plain():
            return left
        case Unknown():
            return UNKNOWN
        case _ as never:
            assert_never(never)


def _measured(exponents: Iterable[Fraction]) -> Leaf:
    dimension = tuple(exponents)
    if any(abs(e.numerator) > MAX_EXPONENT or e.denominator > MAX_EXPONENT for e in dimension):
        return UNKNOWN
    return Measured(dimension)


# ---- lists ----------------------------------------------------------------------------------------------------------------------------


def mapped(quantity: Quantity, change: Callable[[Leaf], Leaf]) -> Quantity:
    """`quantity` with `change` for each of its leaves."""
    if isinstance(quantity, Listed):
        return Listed(tuple(mapped(item, change) for item in quantity.items))
    return change(quantity)


def leaves(quantity: Quantity) -> list[Leaf]:
    """What a quantity is made of, from left to right."""
    if isinstance(quantity, Listed):
        return [leaf for item in quantity.items for leaf in leaves(item)]
    return [quantity]


def uniform(quantity: Quantity) -> Leaf | None:
    """What all leaves have in common, where plain numbers take the unit of the others; None where units differ."""
    found = leaves(quantity)
    if UNKNOWN in found:
        return UNKNOWN
    measured = [leaf for leaf in found if isinstance(leaf, Measured)]
    if not measured:
        return Plain(all(isinstance(leaf, Plain) and leaf.zero for leaf in found))
    return measured[0] if all(leaf.dimension == measured[0].dimension for leaf in measured) else None


def whole(quantity: Quantity) -> Leaf:
    """The common unit, unknown where units differ."""
    found = uniform(quantity)
    return UNKNOWN if found is None else found
