"""Units of random models: dimensions over m, s and kg, and the ways to write them."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Literal

#: Exponents of m, s and kg.
Unit = tuple[int, int, int]
ONE: Unit = (0, 0, 0)
SECOND: Unit = (0, 1, 0)

#: Units of declarations and of what products are made of.
COMMON: tuple[Unit, ...] = (
    ONE,
    (1, 0, 0),
    (0, 1, 0),
    (1, -1, 0),
    (0, -1, 0),
    (1, -2, 0),
    (1, -2, 1),
    (0, 0, 1),
)

#: Other spellings of a unit, and what one of them is in SI.
OTHERS: dict[Unit, tuple[tuple[str, float], ...]] = {
    (1, 0, 0): (("mm", 1e-3), ("km", 1e3), ("cm", 1e-2)),
    (0, 1, 0): (("ms", 1e-3), ("min", 60.0)),
    (1, -1, 0): (("km/h", 1 / 3.6), ("mm/ms", 1.0)),
    (0, -1, 0): (("1/min", 1 / 60), ("Hz", 1.0), ("1/ms", 1e3)),
    (1, -2, 0): (("mm/s^2", 1e-3), ("N/kg", 1.0), ("m/(s*s)", 1.0)),
    (1, -2, 1): (("N", 1.0), ("mN", 1e-3), ("kg*m/s^2", 1.0)),
    (0, 0, 1): (("g", 1e-3), ("Mg", 1e3)),
}

Style = Literal["none", "coherent", "mixed"]


def times(a: Unit, b: Unit) -> Unit:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def over(a: Unit, b: Unit) -> Unit:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def coherent_text(unit: Unit) -> str:
    """A unit in base units."""
    named = list(zip(("m", "s", "kg"), unit, strict=True))
    up = "*".join(n if e == 1 else f"{n}^{e}" for n, e in named if e > 0)
    return "/".join([up or "1", *(n if e == -1 else f"{n}^{-e}" for n, e in named if e < 0)])


@dataclass(frozen=True)
class Writer:
    """Writes units and numbers in one style: without units, in SI's own, or in any that fit."""

    rng: Random
    style: Style

    def spelled(self, unit: Unit) -> tuple[str, float]:
        """A way to write a unit, and what one of it is in SI."""
        others = OTHERS.get(unit, ())
        if self.style == "mixed" and others and self.rng.random() < 0.5:
            return self.rng.choice(others)
        return coherent_text(unit), 1.0

    def declared(self, unit: Unit) -> str:
        """What stands after a declared name."""
        if self.style == "none" or (unit == ONE and self.rng.random() < 0.7):
            return ""
        return f" [{self.spelled(unit)[0]}]"

    def number(self, value: float, unit: Unit, *, loose: bool) -> str:
        """A literal, which is about `value` in SI. `loose`: it may take its neighbour's unit."""
        if self.style == "none" or value == 0 or unit == ONE:
            return _digits(value)
        if loose and self.style == "coherent" and self.rng.random() < 0.4:
            return _digits(value)  # takes its neighbour's unit
        text, size = self.spelled(unit)
        return f"{_digits(value / size)} [{text}]"


def _digits(value: float) -> str:
    return str(int(value)) if value == int(value) and value < 1e6 else repr(float(f"{value:.4g}"))
