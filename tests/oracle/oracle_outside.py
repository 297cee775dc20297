"""External functions of random models. The interpreter runs this text too, with `math` for its own numbers."""

import math

STIFF = 3


def soft(x):
    """Between -1 and 1."""
    return x / (1 + abs(x))


def swing(x, y):
    """Smooth in both."""
    wide = 2 + math.cos(x) * y**2 / (1 + y**2)
    return math.tanh(wide) * STIFF + soft(y)


def hill(x, y, z):
    """With a branch."""
    top = STIFF - 0.1 * z if z > 0 else STIFF + 0.5 * math.sin(z)
    return top / (1 + x**2 + soft(y) ** 2)


def noticed(x):
    """Called back: the dialect has no dictionaries."""
    return {True: x, False: -0.5 * x}[bool(x > 0)] / (1 + x * x)
