"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

StatusName = Literal[
    "DONE",
    "INTERRUPTED",
    "STEP_TOO_SMALL",
    "NOT_FINITE",
    "BAD_START",
    "TOO_MANY_STEPS",
    "OUT_OF_MEMORY",
    "EXTERN_FAILED",
]


@dataclass(frozen=True, slots=True)
class Status:
    """A named end, and a sentence with time, group, state and step size where it failed."""

    name: StatusName
    message: str

    @property
    def ok(self) -> bool:
        """Whether the run reached its stop time."""
        return self.name == "DONE"
