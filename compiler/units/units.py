"""Units: the text between brackets as a factor to SI and exponents of the seven base units.

In: text such as `kg*m^2`, `N/m^1.5`, `1/(s*m)`, `ms`. Out: a `Unit`. Factors are exact rationals (pi and roots to 60 digits), so that a
literal such as `0.5 [ms]` is rounded once, to the double nearest to 0.0005. Units are compared in `agreement.py`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction

from hierc.compiler.collector import Rejected
from hierc.compiler.units.errors import LiteralOutOfRange, UnknownUnit
from hierc.grammar import tree
from hierc.grammar.problems import closest
from hierc.grammar.source import Span

#: Order of the exponents.
BASE = ("m", "kg", "s", "A", "K", "mol", "cd")

_PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494")
_DIGITS = Context(prec=60)
_MAX_EXPONENT = 64  # of one unit in a text; keeps the powers below small


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: one of it is `factor` in SI; `exponents` are those of `BASE`."""

    factor: Fraction
    exponents: tuple[Fraction, ...]

    def times(self, other: Unit) -> Unit:
        pairs = zip(self.exponents, other.exponents, strict=True)
        return Unit(self.factor * other.factor, tuple(a + b for a, b in pairs))

    def power(self, exponent: Fraction) -> Unit:
        return Unit(_power(self.factor, exponent), tuple(e * exponent for e in self.exponents))

    @property
    def coherent(self) -> bool:
        """Whether values in this unit are SI values."""
        return self.factor == 1

    def si_text(self) -> str:
        """The same dimension in base units, as it may be written: `m/s^2`."""
        exponents = dict(zip(BASE, self.exponents, strict=True))
        exponents = {"kg": exponents.pop("kg"), **exponents}  # as it is usually written: `kg*m/s^2`
        up = [_with_exponent(b, e) for b, e in exponents.items() if e > 0]
        down = [_with_exponent(b, -e) for b, e in exponents.items() if e < 0]
        return "/".join(["*".join(up) or "1", *down])


ONE = Unit(Fraction(1), (Fraction(0),) * 7)


def _power(base: Fraction, exponent: Fraction) -> Fraction:
    if exponent.denominator == 1:
        return base**exponent.numerator
    if base == 1:
        return base
    root = _DIGITS.power(
        _DIGITS.divide(Decimal(base.numerator), Decimal(base.denominator)),
        _DIGITS.divide(Decimal(exponent.numerator), Decimal(exponent.denominator)),
    )
    return Fraction(root)


def _with_exponent(name: str, exponent: Fraction) -> str:
    if exponent == 1:
        return name
    return f"{name}^{exponent.numerator if exponent.denominator == 1 else float(exponent)}"


def _unit(factor: Fraction | int | str, **exponents: int) -> Unit:
    return Unit(Fraction(factor), tuple(Fraction(exponents.get(b, 0)) for b in BASE))


#: Units that take prefixes.
_PREFIXED: Mapping[str, Unit] = {
    "m": _unit(1, m=1), "g": _unit("0.001", kg=1), "s": _unit(1, s=1), "A": _unit(1, A=1), "K": _unit(1, K=1),
    "mol": _unit(1, mol=1), "cd": _unit(1, cd=1), "rad": _unit(1), "sr": _unit(1), "Hz": _unit(1, s=-1),
    "N": _unit(1, kg=1, m=1, s=-2), "Pa": _unit(1, kg=1, m=-1, s=-2), "J": _unit(1, kg=1, m=2, s=-2),
    "W": _unit(1, kg=1, m=2, s=-3), "C": _unit(1, A=1, s=1), "V": _unit(1, kg=1, m=2, s=-3, A=-1),
    "F": _unit(1, kg=-1, m=-2, s=4, A=2), "ohm": _unit(1, kg=1, m=2, s=-3, A=-2), "Ω": _unit(1, kg=1, m=2, s=-3, A=-2),
    "S": _unit(1, kg=-1, m=-2, s=3, A=2), "Wb": _unit(1, kg=1, m=2, s=-2, A=-1), "T": _unit(1, kg=1, s=-2, A=-1),
    "H": _unit(1, kg=1, m=2, s=-2, A=-2), "lm": _unit(1, cd=1), "lx": _unit(1, cd=1, m=-2), "Bq": _unit(1, s=-1),
    "Gy": _unit(1, m=2, s=-2), "Sv": _unit(1, m=2, s=-2), "kat": _unit(1, mol=1, s=-1),
}  # fmt: skip

#: Units without prefixes.
_PLAIN: Mapping[str, Unit] = {
    "%": _unit("0.01"), "deg": _unit(_PI / 180), "°": _unit(_PI / 180), "rpm": _unit(_PI / 30, s=-1),
    "min": _unit(60, s=1), "h": _unit(3600, s=1),
}  # fmt: skip

_PREFIXES: Mapping[str, Fraction] = {
    name: Fraction(10) ** power
    for name, power in {
        "da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12, "P": 15, "E": 18, "d": -1, "c": -2, "m": -3, "u": -6, "µ": -6,
        "μ": -6, "n": -9, "p": -12, "f": -15, "a": -18,
    }.items()
}  # fmt: skip

#: What units are often called instead.
_SPELLINGS: Mapping[str, str] = {
    "sec": "s", "hr": "h", "hour": "h", "kph": "km/h", "mps": "m/s", "kmh": "km/h", "kmph": "km/h", "rps": "1/s",
    "degree": "deg", "radian": "rad", "metre": "m", "meter": "m", "second": "s", "minute": "min", "gram": "g", "kilogram": "kg",
    "newton": "N", "volt": "V", "ampere": "A", "amp": "A", "watt": "W", "joule": "J", "pascal": "Pa", "hertz": "Hz", "ohm": "ohm",
    "farad": "F", "henry": "H", "tesla": "T", "weber": "Wb", "kelvin": "K", "mole": "mol", "candela": "cd", "l": "dm^3", "L": "dm^3",
    "millimeter": "mm", "centimeter": "cm", "kilometer": "km", "millisecond": "ms", "percent": "%",
}  # fmt: skip

#: Scales whose zero is not that of the quantity.
_OFFSETS = frozenset({"degC", "degF", "celsius", "Celsius", "fahrenheit", "Fahrenheit", "°C", "°F", "℃", "℉"})

_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")

_TOKEN = re.compile(r"\s*(?:(?P<number>[+-]?\d+(?:\.\d+)?)|(?P<name>[A-Za-zµμΩ°%]+)|(?P<mark>[*/^()]))")


def named_unit(name: str) -> Unit | None:
    """The unit with this name, prefix included; None when there is none."""
    known = _PLAIN.get(name) or _PREFIXED.get(name)
    if known is not None:
        return known
    for prefix, factor in _PREFIXES.items():
        rest = name.removeprefix(prefix)
        if rest != name and rest in _PREFIXED:
            return Unit(factor, ONE.exponents).times(_PREFIXED[rest])
    return None


def coherent_name(name: str) -> str | None:
    """The unit of SI behind a single name: `m` for `mm`, `kg` for `g`, `rad` for `deg`; None where it is no single name."""
    other = {"g": "kg", "deg": "rad", "°": "rad", "min": "s", "h": "s", "%": "1", "rpm": "rad/s"}
    if name in other or name in _PREFIXED:
        return other.get(name, name)
    rests = (name.removeprefix(prefix) for prefix in _PREFIXES if name.startswith(prefix))
    return next((other.get(rest, rest) for rest in rests if rest in _PREFIXED), None)


def parse_unit(text: str, span: Span) -> Unit:
    """The unit that `text` says; raises Rejected (E404) with a suggestion when it says none. `span` is where it stands."""
    return _Parser(text, span).unit()


def scale_of(unit: tree.Unit | None) -> float:
    """One of a declared unit in SI: values in that unit are multiplied by it. Raises Rejected for an unknown unit."""
    return 1.0 if unit is None else float(parse_unit(unit.text, unit.span).factor)


class _Parser:
    """Products, quotients and powers: `a*b/c^2`, from left to right, with parentheses."""

    def __init__(self, text: str, span: Span) -> None:
        self._text = text
        self._span = span
        self._tokens: list[tuple[str, str]] = []
        place = 0
        while text[place:].strip():
            match = _TOKEN.match(text, place)
            if match is None or len(self._tokens) >= 200:
                raise self._unknown()
            self._tokens.append((match.lastgroup or "", match.group(match.lastgroup or 0)))
            place = match.end()
        self._next = 0

    def _unknown(self, name: str | None = None) -> Rejected:
        wrong = self._text if name is None else name
        respelt = _respelt(self._text)
        meant = respelt if respelt is not None and self._is_unit(respelt) else self._meant(wrong)
        return Rejected(UnknownUnit(self._span, unit=wrong, meant=meant, offset=wrong in _OFFSETS))

    def _meant(self, wrong: str) -> str | None:
        """All of the text with what the wrong name may stand for, if that makes a unit."""
        meant = _meant(wrong)
        if meant is None or wrong == self._text:
            return meant
        whole = re.sub(rf"(?<![A-Za-z]){re.escape(wrong)}(?![A-Za-z])", meant, self._text)
        return whole if self._is_unit(whole) else meant

    def _is_unit(self, text: str) -> bool:
        try:
            _Parser(text, self._span).unit()
        except Rejected:
            return False
        return True

    def _take(self, *wanted: str) -> str | None:
        """The next token if its kind or text is wanted."""
        if self._next < len(self._tokens):
            kind, text = self._tokens[self._next]
            if kind in wanted or text in wanted:
                self._next += 1
                return text
        return None

    def unit(self) -> Unit:
        result = self._product()
        if self._next < len(self._tokens):
            raise self._unknown()
        return result

    def _product(self) -> Unit:
        result = self._factor()
        while (mark := self._take("*", "/")) is not None:
            factor = self._factor()
            result = result.times(factor if mark == "*" else factor.power(Fraction(-1)))
        return result

    def _factor(self) -> Unit:
        base = self._atom()
        if self._take("^") is None:
            return base
        exponent = self._take("number")
        if exponent is None or len(exponent) > 6 or abs(Fraction(exponent)) > _MAX_EXPONENT:
            raise self._unknown()
        return base.power(Fraction(exponent))

    def _atom(self) -> Unit:
        if self._take("("):
            inside = self._product()
            if self._take(")") is None:
                raise self._unknown()
            return inside
        if self._take("1"):
            return ONE
        name = self._take("name")
        unit = named_unit(name) if name else None
        if unit is None:
            raise self._unknown(name)
        return unit


def _respelt(text: str) -> str | None:
    """A unit in other signs, `N m`, `N·m`, `m/s²` or `m**2`, in those of the language; None where that changes nothing."""
    raised = re.sub(r"[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"^{found[0].translate(_SUPERSCRIPTS)}", text)
    plain = re.sub(r"\s*[·⋅×]\s*|(?<=[\w%°])\s+(?=[A-Za-zµμΩ°%(])", "*", raised.replace("**", "^").strip())
    return plain if plain != text.strip() else None


def _meant(name: str) -> str | None:
    """What an unknown unit may stand for: a product without its `*`, or a name like it."""
    if name in _OFFSETS:
        return None
    for word in (name, name.casefold(), name.casefold().removesuffix("s")):
        if word in _SPELLINGS:
            return _SPELLINGS[word]
    if name.startswith("K") and named_unit(f"k{name[1:]}"):
        return f"k{name[1:]}"
    for cut in range(len(name) - 1, 0, -1):
        if named_unit(name[:cut]) and named_unit(name[cut:]):
            return f"{name[:cut]}*{name[cut:]}"
    return closest(name, [n for n in (*_PREFIXED, *_PLAIN) if len(n) > 1 or n.casefold() == name.casefold()])


def literal_in_si(number: tree.Number) -> float:
    """The value of a literal in SI, rounded once. Raises Rejected for an unknown unit or a value that no double can hold."""
    if number.unit is None or number.value == 0.0:
        if number.unit is not None:
            parse_unit(number.unit.text, number.unit.span)
        return number.value
    unit = parse_unit(number.unit.text, number.unit.span)
    try:
        return float(Fraction(number.text) * unit.factor)
    except OverflowError:
        raise Rejected(LiteralOutOfRange(number.span, text=number.span.text)) from None
