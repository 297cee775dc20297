"""Checks of declared units that need no dimensions: known, and coherent with SI."""

from __future__ import annotations

from hierc.compiler.collector import Rejected
from hierc.compiler.units import parse_unit
from hierc.compiler.unsupported import DeclaredUnit
from hierc.grammar import tree


def check_declared(unit: tree.Unit | None) -> str | None:
    """The text of a declared unit; raises Rejected when it is unknown (E404) or not coherent with SI (E009)."""
    if unit is None:
        return None
    parsed = parse_unit(unit.text, unit.span)
    if not parsed.coherent:
        raise Rejected(DeclaredUnit(unit.span, si=parsed.si_text()))
    return unit.text
