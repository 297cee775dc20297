"""Runs of small models, down to their trajectories."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun

METHODS = ("radau5", "radau9", "radau13", "tsit5", "dop853", "adams", "abm5")


def run(
    model: Model,
    stop: float,
    tolerance: float = 1e-6,
    groups: Mapping[str, Mapping[str, Any]] | None = None,
    params: Mapping[str, float] | None = None,
    most_steps: int | None = None,
    progress: Any = None,
    **settings: Any,
) -> FinishedRun:
    """A run with the same tolerance, relative and absolute, for all groups; it may fail."""
    given = {
        "start": 0.0, "stop": stop, "rtol": tolerance, "atol": tolerance, "method": "radau9", "max_step": math.inf,
        "min_step": 0.0, **settings,
    }  # fmt: skip
    return model.engine.run(model.system(params), given, groups or {}, most_steps, progress)
