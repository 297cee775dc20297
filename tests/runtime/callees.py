"""Model text that calls tables and externs, as machine code."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from machine_code import Floats, add_entry, callable_from, definition, over_lanes, room

from hierc.runtime.machine.callees import Callee, Links, emit
from hierc.runtime.machine.unit import Loaded, Unit, compile_object


def machine_values(
    text: str, callees: Mapping[str, Callee], points: Floats, lanes: int
) -> tuple[Floats, Links]:
    """dx of `rhs(t, x, dx)` at points (samples, states), an entry for each callee, and the links of the code."""
    found = []
    size = sum(line.strip().startswith("dx[") for line in text.splitlines())
    unit = Unit("test")
    unit.callees.update(emit(unit, "test", callees))
    add_entry(unit, definition(text), lanes)
    code = Loaded([compile_object(unit.text())])
    links = Links(code)
    links.add("test", callees)
    function = callable_from(code)
    for first in range(0, len(points), lanes):
        rows = np.arange(first, first + lanes) % len(points)
        out = room(size, lanes)
        function(room(1, lanes), over_lanes(points[rows]), out)
        found.append(out.T.copy())
    return np.concatenate(found)[: len(points)], links
