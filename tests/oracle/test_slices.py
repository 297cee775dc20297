"""Random sums, extremes and products over arrays of agents, and over slices that differ from agent to agent, against the interpreter."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from judging import Case

from hierc.compiler.structure import alike, decisions, reductions

#: The ends of slices that are never empty, of the agents from 1 to N, seen from agent i, and of some that may be.
FULL = (
    "1..i",
    "i..N",
    "max(1, i-{a})..i",
    "i..min(N, i+{a})",
    "div(i, 2)+1..i",
    "1..N",
    "{a}..{b}",
    "low[i]..N",
)
ALL = (*FULL, "1..i-1", "i+1..N", "low[i]..high[i]", "i+{a}..min(N, i+{b})", "{b}..i", "max(1, i-{b})..i-{a}")
#: Of a slice `{s}`, sums that may be over nothing, then others.
SUMS = (
    "sum(car[{s}].x)", "sum(car[{s}].y)", "sum(car[{s}].x')", "sum(car[{s}].p)", "sum(car.p[{s}, 2])",
    "sum([car[k].x*car[k].y for k in {s}])", "sum([if mod(k, 3) == 1 then car[1].x else car[k-1].x^2 for k in {s}])",
    "sum([k*max(car[1..k].x) for k in {s}])", "sum([car[k].p for k in {s}])", "sum([weight[k] + car[k].y for k in {s}])",
)  # fmt: skip
EXTREMES = (
    "max(car[{s}].x)", "min(car[{s}].y)", "min(car.p[{s}, 1])", "max([car[k].x - car[k].p[2] for k in {s}])",
)  # fmt: skip
#: Over all agents.
WHOLE = (
    "dot(car.x, car.y)", "norm(car.x - 2*car.y)", "dot(weight, car.x)", "mean(car.y .* car.x)",
    "sum(k*car.x + car.y/2)", "max(car.x .* weight)", "sum(transpose(car.p)*weight)", "sum(car.p .* car.p)",
)  # fmt: skip


class Writer:
    """Writes a model by chance."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.count = self.rng.randint(2, 20)

    def slice(self, ends: tuple[str, ...]) -> str:
        a, b = sorted(self.rng.randint(1, self.count) for _ in range(2))
        return self.rng.choice(ends).format(a=a, b=b)

    def term(self) -> str:
        kind = self.rng.random()
        forms, ends = (SUMS, ALL) if kind < 0.6 else (EXTREMES, FULL) if kind < 0.8 else (WHOLE, FULL)
        return f"{self.rng.choice((0.5, -2, 3))}*{self.rng.choice(forms)}".format(s=self.slice(ends))

    def text(self) -> str:
        n, rng = self.count, self.rng
        low = [rng.randint(1, n) for _ in range(n)]
        high = [min(n, k + rng.randint(-3, n)) for k in low]
        couplings = [" + ".join(self.term() for _ in range(rng.randint(1, 3))) for _ in range(2)]
        condition = rng.choice(("i == 1", "mod(i, 2) == 0", "i <= 3", "high[i] >= 2"))
        return f"""
        func real mean(real[n] x) = sum(x)/n;
        const int N = {n};
        const int[N] low = {low};
        const int[N] high = {high};
        agent Car(real k) {{
          read real u;
          write real x = k, y;
          write real[2] p = [k, -k];
          alge {{ y = x^2 + p[1]; }}
          diff {{ x' = p[2] - k*x; p' = [u, x]; }}
        }}
        agent Road(real k = 2, real g = 0.7) {{
          const real[N] weight = [cos(3*i) for i in 1..N];
          agent car[i in 1..N] = Car(k = i/k) [u := if {condition} then {couplings[0]} else {couplings[1]}];
          agent last = Car(k = g) [u := {rng.choice(WHOLE)}];
        }}
        agent Top() {{
          agent road = Road();
          agent lane[j in 1..2] = Road(k = j);
        }}"""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("few", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_random_slices(seed: int, few: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As they are, and with nothing written out, however few there are."""
    if few:
        monkeypatch.setattr(reductions, "FEW", 1)
        monkeypatch.setattr(alike, "FEW", 1)
        monkeypatch.setattr(decisions, "FEW_LENGTHS", 1)
    text = Writer(seed).text()
    case = Case(text, "Top")
    x = np.random.default_rng(seed).normal(size=len(case.model.states))
    case.check_rates(0.3, x)
    case.check_jacobian(0.3, x, range(0, len(x), max(1, len(x) // 8)))
