"""How many step attempts a call of the kernel may make, so that Python looks at the keyboard, at progress and at limits every few hundredths of a second."""

from __future__ import annotations

#: What one call of the kernel should take, s.
SLICE = 0.02
_LEAST = 16


class Pace:
    """The budget of the next call, from the time that calls took."""

    def __init__(self) -> None:
        self.budget = 64

    def learn(self, spent: float) -> None:
        """A call has used its budget up in so many seconds."""
        wanted = self.budget * SLICE / max(spent, 1e-6)
        self.budget = int(min(max(wanted, _LEAST), self.budget * 8))
