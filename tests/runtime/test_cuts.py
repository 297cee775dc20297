"""Steps cut at random times, as events will cut them: each group lands on times of its own, and the error stays what was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from running import METHODS
from test_runs import ALLOWED, PROBLEMS

from hierc.runtime import records
from hierc.runtime.simulation import Simulation

TOLERANCE = 1e-6
#: All but the paper's, whose steps are parts of the way to knots that others set.
CUT = [method for method in METHODS if method != "abm5"]
#: Of each group.
CUTS = 12


def cut_run(name: str, method: str, seed: int) -> tuple[Simulation, list[list[float]]]:
    """A run whose groups land on random times, and these times for each group."""
    model, stop, _ = PROBLEMS[name]
    engine, system = model.engine, model.system()
    given = {"rtol": TOLERANCE, "atol": TOLERANCE, "method": method, "max_step": np.inf, "min_step": 0.0}
    simulation = Simulation(engine, system, engine.group_settings(given, {}), system.initial(0.0), 0.0, stop)
    count = engine.elements.groups
    cuts = np.sort(np.random.default_rng(seed).uniform(0, stop, (count, CUTS))).tolist()
    left = [[*times, stop] for times in cuts]
    groups, run = simulation.groups, simulation.run
    groups["stop"][:count] = [times.pop(0) for times in left]
    while (outcome := simulation.attempt(10_000)) != records.DONE:
        g = int(run["group"][0])
        if outcome == records.FULL:
            assert simulation._grow(g)
        elif outcome == records.TOO_SMALL:  # it stands on its cut and asks in vain for a step
            assert groups["t"][g] == groups["stop"][g]
            groups["stop"][g] = left[g].pop(0)
        else:
            assert outcome == records.PAUSED
    return simulation, cuts


@pytest.mark.parametrize(
    ("name", "method"),
    [(p, m) for p in PROBLEMS for m in CUT if p != "stiff reader" or m in METHODS[:3]],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_cuts_change_nothing_beyond_the_tolerance(name: str, method: str, seed: int) -> None:
    _, stop, exact = PROBLEMS[name]
    simulation, cuts = cut_run(name, method, seed)
    groups = simulation.trajectories()
    for g, times in zip(groups, cuts, strict=True):
        assert set(times) <= set(g.knots.tolist())
    t = np.linspace(0, stop, 1001)
    found = groups.states(np.arange(simulation.system.size), t)
    assert np.abs(found - exact(t)).max() <= ALLOWED.get((name, method), 10.0) * TOLERANCE
