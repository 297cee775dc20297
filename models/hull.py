"""The hull of `boat.hier`: what an external function of a model looks like.

Made of arithmetic, `if` and `math` alone, it is compiled into the model's machine code.
"""

from __future__ import annotations

import math

#: Wetted length, m, and its resistance at walking pace, N.
LENGTH = 3.2
CREEP = 18.0


def resistance(v: float) -> float:
    """Resistance, N, at the speed v, m/s: friction, and the waves that the hull begins to make at its own length."""
    friction = CREEP * math.tanh(v / 0.25) + 9.0 * v
    froude = abs(v) / math.sqrt(9.81 * LENGTH)
    if froude < 0.2:
        return friction
    return friction + math.copysign(310.0 * (froude - 0.2) ** 2, v)
