"""Units against pint: what each unit is in SI, and what random expressions are in."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit_checks import unit_of

from hierc.compiler.units.quantity import Measured, whole
from hierc.compiler.units.units import parse_unit
from hierc.grammar.source import SourceFile, Span

pint = pytest.importorskip("pint")
UNITS = pint.UnitRegistry()

NAMES = {
    "m": "meter", "g": "gram", "s": "second", "A": "ampere", "K": "kelvin", "mol": "mole", "cd": "candela", "rad": "radian", "sr": "steradian",
    "Hz": "hertz", "N": "newton", "Pa": "pascal", "J": "joule", "W": "watt", "C": "coulomb", "V": "volt", "F": "farad", "ohm": "ohm", "Ω": "ohm",
    "S": "siemens", "Wb": "weber", "T": "tesla", "H": "henry", "lm": "lumen", "lx": "lux", "Bq": "becquerel", "Gy": "gray", "Sv": "sievert",
    "kat": "katal",
}  # fmt: skip
PREFIXES = {
    "": "", "da": "deca", "h": "hecto", "k": "kilo", "M": "mega", "G": "giga", "T": "tera", "P": "peta", "E": "exa", "d": "deci", "c": "centi",
    "m": "milli", "u": "micro", "µ": "micro", "n": "nano", "p": "pico", "f": "femto", "a": "atto",
}  # fmt: skip
PLAIN = {
    "%": "percent", "deg": "degree", "°": "degree", "rpm": "revolutions_per_minute", "min": "minute", "h": "hour",
}  # fmt: skip
PREFIXED = {
    p + n: long + name for p, long in PREFIXES.items() for n, name in NAMES.items() if p + n not in PLAIN
}
#: What is measured in these, in the order of `BASE`.
KINDS = (
    "[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]",
)  # fmt: skip


def exponents(quantity: Any) -> list[float]:
    return [float(quantity.dimensionality.get(kind, 0)) for kind in KINDS]


@pytest.mark.parametrize(("ours", "theirs"), {**PREFIXED, **PLAIN}.items())
def test_every_unit(ours: str, theirs: str) -> None:
    unit = parse_unit(ours, Span(SourceFile("test", ours), 0, len(ours)))
    expected = UNITS.Quantity(1, theirs).to_base_units()
    assert list(map(float, unit.exponents)) == exponents(expected)
    assert float(unit.factor) == pytest.approx(expected.magnitude, rel=1e-14)


# ---- random expressions --------------------------------------------------------------------------

WORLD = {
    "l": "m", "mm": "mm", "v": "m/s", "a": "m/s^2", "t": "ms", "w": "kg", "F": "N", "E": "kJ", "tau": "N*m", "q": "deg", "om": "rpm", "one": "1",
    "part": "%", "i": "mA", "u": "V", "R": "kohm", "L": "mH", "T": "K", "c": "J/(kg*K)", "k": "N/m^1.5",
}  # fmt: skip
DECLARED = f"agent A() {{ read real {', '.join(f'{n} [{u}]' for n, u in WORLD.items())};"
OURS_TO_PINT = {"%": "percent", "rpm": "revolutions_per_minute", "1": "dimensionless"}

#: An expression: a form and what it is made of.
Tree = tuple[Any, ...]


def trees() -> st.SearchStrategy[Tree]:
    """Expressions in which a number stands only as a factor or an exponent, where pint and hierc mean the same by it.

    A `twin` has the same expression on both sides: else nearly nothing that is added would agree.
    """
    leaf = st.tuples(st.sampled_from(("name", "literal")), st.sampled_from(list(WORLD)))

    def larger(inner: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
        sums = st.sampled_from(("+", "-", "min", "max", "if", "atan2", "list"))
        return st.one_of(
            st.tuples(st.just("times"), inner, inner),
            st.tuples(st.just("over"), inner, inner),
            st.tuples(st.just("twin"), sums, inner),
            st.tuples(st.just("sum"), sums, inner, inner),
            st.tuples(st.just("power"), inner, st.sampled_from((2, 3, -1, 0.5, 1.5, 0))),
            st.tuples(st.just("call"), st.sampled_from(("sqrt", "abs", "sign", "norm", "3*", "2/")), inner),
            st.tuples(st.just("pure"), st.sampled_from(("sin", "cos", "exp", "tanh", "atan")), inner),
        )

    return st.recursive(leaf, larger, max_leaves=8)


def written(tree: Tree) -> str:
    """The expression in the language."""
    match tree:
        case ("name", name):
            return name
        case ("literal", name):
            return f"2.5 [{WORLD[name]}]"
        case ("times", left, right):
            return f"({written(left)})*({written(right)})"
        case ("over", left, right):
            return f"({written(left)})/({written(right)})"
        case ("twin", form, inner):
            return written(("sum", form, inner, inner))
        case ("sum", "+" | "-" as sign, left, right):
            return f"(({written(left)}) {sign} ({written(right)}))"
        case ("sum", "if", left, right):
            return f"(if {written(left)} > {written(right)} then {written(left)} else {written(right)})"
        case ("sum", "list", left, right):
            return f"sum([{written(left)}, {written(right)}])"
        case ("sum", function, left, right):
            return f"{function}({written(left)}, {written(right)})"
        case ("power", inner, exponent):
            return f"({written(inner)})^({exponent})"
        case ("call", "norm", inner):
            return f"norm([{written(inner)}, 0])"
        case ("call" | "pure", function, inner):
            return f"{function}({written(inner)})"
    raise AssertionError(tree)


def by_pint(tree: Tree) -> Any:
    """The unit of the expression, as a quantity. Raises pint.DimensionalityError."""
    match tree:
        case ("name" | "literal", name):
            return UNITS.Quantity(1.25, OURS_TO_PINT.get(WORLD[name], WORLD[name]))
        case ("times", left, right):
            return some(by_pint(left) * by_pint(right))
        case ("over", left, right):
            return some(by_pint(left) / by_pint(right))
        case ("twin", form, inner):
            return by_pint(("sum", form, inner, inner))
        case ("sum", form, left, right):
            total = by_pint(left) + by_pint(right)
            return UNITS.Quantity(1.25, "radian") if form == "atan2" else some(total)
        case ("power", inner, exponent):
            return some(by_pint(inner) ** exponent)
        case ("call", "sqrt", inner):
            return some(by_pint(inner) ** 0.5)
        case ("call", "2/", inner):
            return some(2 / by_pint(inner))
        case ("call", "sign", inner):
            by_pint(inner)
            return UNITS.Quantity(1.25, "dimensionless")
        case ("call", _, inner):
            return by_pint(inner)
        case ("pure", _, inner):
            return some(by_pint(inner).to("dimensionless"))
    raise AssertionError(tree)


def some(quantity: Any) -> Any:
    """Any quantity of the same unit, so that no value is ever zero or too large."""
    return UNITS.Quantity(1.25, quantity.units)


@settings(max_examples=400, deadline=None)
@given(trees())
def test_random_expressions(tree: Tree) -> None:
    found, problems = unit_of(written(tree), DECLARED)
    try:
        expected = by_pint(tree)
    except pint.DimensionalityError:
        assert problems
        assert {p.code for p in problems} <= {"E401", "E403"}
    else:
        assert not problems
        unit = whole(found)
        assert isinstance(unit, Measured)
        assert list(map(float, unit.dimension)) == pytest.approx(exponents(expected), abs=1e-12)


def test_random_expressions_are_of_both_kinds() -> None:
    """Enough of what is generated agrees, and enough does not."""
    agreeing = []

    @settings(max_examples=200, deadline=None, database=None, derandomize=True)
    @given(trees())
    def count(tree: Tree) -> None:
        agreeing.append(not unit_of(written(tree), DECLARED)[1])

    count()
    assert 40 < sum(agreeing) < len(agreeing) - 20
