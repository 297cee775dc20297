"""What a step of each method costs, and how far it reaches: the constants of `hierc.runtime.choice`.

    python benchmarks/step_costs.py

Oscillators of 2 to 32 states with right-hand sides of different length, coupled or not, are integrated in one group, non-stiff, and the
kernel's time a step is fitted by least squares to

    base + iterations*(state*n + evaluation*flops) + algebra*(updates + iterations*entries),

the last part being linear algebra. The reach is h/(T tol**(1/q)) on a harmonic oscillator of T = 1.
"""

from __future__ import annotations

import time

import numpy as np

import hierc
from hierc.runtime.choice import COSTS
from hierc.runtime.machine.program import Pieces
from hierc.runtime.model import Model
from hierc.runtime.simulation import Simulation

TOLERANCE = 1e-6


def model(pairs: int, terms: int, *, dense: bool = False) -> Model:
    """`pairs` oscillators whose forces are sums of `terms` products; `dense`: each pulled by all."""
    force = " + ".join(f"{0.1 / k:.3f}*q[i]*q[i]*s[i]" for k in range(1, terms + 1))
    pull = " - 0.001*sum(q)*sum(s)" if dense else ""
    return hierc.load(
        f"""agent Chain() {{
  write real[{pairs}] q = [{", ".join(["1"] * pairs)}], s = [{", ".join(["0"] * pairs)}];
  diff {{ for i in 1..{pairs} {{ q[i]' = s[i]; s[i]' = -q[i] - 0.1*s[i] - {force}{pull}; }} }}
}}"""
    )


def kernel(m: Model, method: str, stop: float) -> tuple[float, float, int, Pieces]:
    """Least of several: ns a step, iterations a step, steps; and the code that ran."""
    settings = {
        "rtol": TOLERANCE,
        "atol": TOLERANCE,
        "method": method,
        "max_step": float("inf"),
        "min_step": 0.0,
    }
    best = float("inf")
    for _ in range(9):
        chosen = m.engine.group_settings(settings, {})
        run = Simulation(m.engine, m.system(), chosen, m.initial(), 0.0, stop)
        began = time.perf_counter()
        assert run.advance().ok
        best = min(best, time.perf_counter() - began)
    steps = int(run.groups["steps"][0]) + int(run.groups["rejected"][0])
    iterations = int(run.groups["iterations"][0]) / steps
    return best / steps * 1e9, iterations, steps, run.program.pieces[m.engine.wiring[0].form, method]


def reach(method: str, order: int) -> float:
    """h/(T tol**(1/order)) on q'' = -q."""
    m = hierc.load("agent Circle() { write real q = 1, s = 0; diff { q' = s; s' = -q; } }")
    _, _, steps, _ = kernel(m, method, 200.0)
    return float(200.0 / steps / TOLERANCE ** (1.0 / order))


def main() -> None:
    """Print the constants, and the fit's largest relative error."""
    models = [model(pairs, terms) for pairs in (1, 2, 4, 6) for terms in (1, 8, 30)]
    models += [model(pairs, 1, dense=True) for pairs in (2, 4, 6, 8, 12, 16)]
    print("method    reach   base  state evaluation algebra iterations worst fit")
    for name, cost in COSTS.items():
        rows, times, counts = [], [], []
        for m in models:
            nanoseconds, iterations, _, pieces = kernel(m, name, 60.0)
            count = iterations or cost.iterations
            row = [1.0, count * len(m.states), count * m.plan.classes[0].flops]
            rows.append([*row, pieces.updates + iterations * pieces.entries])
            times.append(nanoseconds)
            counts.append(count)
        weighted = np.array(rows) / np.array(times)[:, None]
        fitted = np.linalg.lstsq(weighted, np.ones(len(times)), rcond=None)[0]
        worst = np.abs(weighted @ fitted - 1.0).max()
        base, state, evaluation, algebra = fitted
        print(
            f"{name:8} {reach(name, cost.order):6.2f} {base:6.0f} {state:6.1f} {evaluation:10.2f} {algebra:7.2f} "
            f"{np.mean(counts):10.1f} {worst:9.0%}"
        )


if __name__ == "__main__":
    main()
