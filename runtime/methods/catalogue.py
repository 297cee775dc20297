"""All methods by name."""

from __future__ import annotations

from hierc.runtime.methods.abm5 import ABM5
from hierc.runtime.methods.adams import Adams
from hierc.runtime.methods.dop853 import DOP853
from hierc.runtime.methods.explicit import Explicit
from hierc.runtime.methods.fit import FIT
from hierc.runtime.methods.method import Method
from hierc.runtime.methods.radau import Radau
from hierc.runtime.methods.radau_tables import RADAU5, RADAU9, RADAU13
from hierc.runtime.methods.tsit5 import TSIT5

#: Those that can be chosen.
METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Radau(RADAU5, newton_tolerance=0.02),
        Radau(RADAU9, newton_tolerance=0.01),
        Radau(RADAU13, newton_tolerance=0.01),
        Explicit(TSIT5),
        Explicit(DOP853),
        Adams(),
        ABM5(),
    )
}

#: The way of groups without states, whatever is chosen.
STATELESS = FIT.name


def every_method() -> dict[str, Method]:
    """All that groups may have."""
    return {**METHODS, STATELESS: FIT}
