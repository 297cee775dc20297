"""Spelling of units: in the user's own words where there are any."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction

from hierc.compiler.collector import Rejected
from hierc.compiler.units.units import Unit, coherent_name, parse_unit
from hierc.grammar.source import Span

_NAME = re.compile(r"[A-Za-zµμΩ°%]+")


def rate_text(text: str) -> str:
    """The unit of a derivative, from that of what is derived: `m` gives `m/s`."""
    match = re.fullmatch(r"(.*)/s(?:\^(\d+))?", text)
    if text == "1":
        return "1/s"
    if match is None:
        return f"{text}/s"
    return f"{match[1]}/s^{int(match[2] or 1) + 1}"


def coherent_text(text: str, span: Span) -> str:
    """The unit of SI that values in the unit `text` are converted to: `m/s` for `km/h`."""
    unit = parse_unit(text, span)
    candidate = _NAME.sub(lambda found: coherent_name(found[0]) or found[0], text).replace("/s/s", "/s^2")
    try:
        again = parse_unit(candidate, span)
    except Rejected:
        return unit.si_text()
    return candidate if again == Unit(Fraction(1), unit.exponents) else unit.si_text()


class Spellings:
    """How to show units that the user did not spell: as base units, or as a unit of the same dimension that the text has somewhere."""

    def __init__(self, written: Iterable[tuple[str, Unit]]) -> None:
        self._written: Mapping[tuple[Fraction, ...], str] = {
            unit.exponents: text for text, unit in reversed(list(written)) if unit.coherent
        }

    def of(self, dimension: tuple[Fraction, ...]) -> str:
        """The shortest spelling; base units where both are as short."""
        base = Unit(Fraction(1), dimension).si_text()
        return min(base, self._written.get(dimension, base), key=len)
