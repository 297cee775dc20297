"""The size of units in SI, from a table of its own: exact rationals, so that a literal is rounded once."""

from __future__ import annotations

import re
from fractions import Fraction
from functools import cache

from hierc.grammar import tree

PI = Fraction(314159265358979323846264338327950288419716939937510, 10**50)
SIZES = {
    "g": Fraction(1, 1000), "deg": PI / 180, "°": PI / 180, "rpm": PI / 30, "%": Fraction(1, 100),
    "min": Fraction(60), "h": Fraction(3600),
    **dict.fromkeys(["m", "s", "A", "K", "mol", "cd", "rad", "sr", "Hz", "N", "Pa", "J", "W", "C", "V", "F"], Fraction(1)),
    **dict.fromkeys(["ohm", "Ω", "S", "Wb", "T", "H", "lm", "lx", "Bq", "Gy", "Sv", "kat"], Fraction(1)),
}  # fmt: skip
PREFIXES = {"da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12}


def _name(name: str) -> Fraction:
    if name in SIZES:
        return SIZES[name]
    (size,) = (
        10 ** Fraction(e) * SIZES[name[len(p) :]]
        for p, e in PREFIXES.items()
        if name.startswith(p) and name[len(p) :] in SIZES
    )
    return size


@cache
def size(text: str) -> Fraction | float:
    """One of a unit such as `km/h` or `N/m^1.5` in SI."""
    python = re.sub(r"[A-Za-zµΩ°%]+", lambda found: f"size('{found[0]}')", text.replace("^", "**"))
    value: Fraction | float = eval(python, {"size": _name})
    return value


def literal(number: tree.Number) -> float:
    """The double nearest to a literal's value in SI."""
    return number.value if number.unit is None else float(Fraction(number.text) * size(number.unit.text))


def declared(unit: tree.Unit | None) -> float:
    """One of a declared unit in SI."""
    return 1.0 if unit is None else float(size(unit.text))
