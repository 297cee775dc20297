"""Units: every unit in the text is known, and declared ones are coherent with SI.

In: a `Library`. Units are not compared with each other: `E401` to `E406` are not checked.
"""

from __future__ import annotations

from collections.abc import Iterator

from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.units.units import parse_unit
from hierc.compiler.unsupported import DeclaredUnit
from hierc.grammar import tree


def check_declared_units(library: Library, problems: Collector) -> None:
    """Report declared units that are unknown (E404) or not coherent with SI (E009)."""
    for unit in _declared(library):
        if unit is None:
            continue
        try:
            parsed = parse_unit(unit.text, unit.span)
        except Rejected as rejection:
            problems.rejected(rejection)
        else:
            if not parsed.coherent:
                problems.add(DeclaredUnit(unit.span, si=parsed.si_text()))


def _declared(library: Library) -> Iterator[tree.Unit | None]:
    yield from (const.unit for const in library.consts.values())
    yield from (param.unit for func in library.funcs.values() for param in func.params)
    for agent in library.agents.values():
        yield from _declared_in(agent)


def _declared_in(agent: Agent) -> Iterator[tree.Unit | None]:
    yield from (param.unit for param in agent.params.values())
    yield from (const.unit for const in agent.consts.values())
    yield from (variable.declarator.unit for variable in agent.variables.values())
    yield from (let.let.unit for let in agent.lets.values())
