"""Friction of the boat."""

import math


def coulomb(v: float) -> float:
    """Force, N, at the speed v, m/s."""
    return 12.0 * math.tanh(v / 0.05)
