"""Sums, extremes, products and norms over many agents, and over slices that differ from element to element: values, derivatives and runs against numpy and
scipy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import hierc

Array = NDArray[Any]

N = 70
RNG = np.random.default_rng(5)
LOW = RNG.integers(1, N + 1, N)
HIGH = np.minimum(LOW + RNG.integers(-3, 50, N), N)
WEIGHTS = RNG.uniform(-1, 1, N).round(3)


def total(values: Array) -> Any:
    """The sum of what may be complex, from the left."""
    return sum(values.ravel().tolist(), 0.0)


def extreme(values: Array, which: Callable[[Array], np.intp]) -> Any:
    return values[which(values.real)]


class Cars:
    """States of all cars: x, v, and two in p."""

    def __init__(self, state: Array) -> None:
        self.x, self.v = state[:N], state[N : 2 * N]
        self.p = state[2 * N :].reshape(N, 2)
        self.rate = self.x - self.v  # v'


#: A coupling of watcher i, and what it is, of the cars.
CASES: dict[str, Callable[[Cars, int], Any]] = {
    "sum(car[1..i-1].v)": lambda c, i: total(c.v[: i - 1]),
    "sum(car[i+1..N].v)": lambda c, i: total(c.v[i:]),
    "sum(car[1..i].v')": lambda c, i: total(c.rate[:i]),
    "sum(car[1..i-1].e)": lambda c, i: total(c.x[: i - 1] * c.v[: i - 1]),
    "max(car[1..i].x)": lambda c, i: extreme(c.x[:i], np.argmax),
    "min(car[i..N].x)": lambda c, i: extreme(c.x[i - 1 :], np.argmin),
    "min(car[max(1, i-12)..min(N, i+5)].v)": lambda c, i: extreme(c.v[max(1, i - 12) - 1 : i + 5], np.argmin),
    "sum(car[low[i]..high[i]].v)": lambda c, i: total(c.v[LOW[i - 1] - 1 : HIGH[i - 1]]),
    "sum(car[1..i-1].p)": lambda c, i: total(c.p[: i - 1]),
    "sum(car.p[i..N,2])": lambda c, i: total(c.p[i - 1 :, 1]),
    "sum([car[k].x*car[k].v^2 for k in 1..i-1])": lambda c, i: total((c.x * c.v**2)[: i - 1]),
    "sum([car[k].p for k in i..N])": lambda c, i: total(c.p[i - 1 :]),
    "sum([car[k].x - (if k == 1 then 0 else car[k-1].x^2) for k in 1..i])": lambda c, i: (
        total(c.x[:i]) - total(c.x[: i - 1] ** 2)
    ),
    "sum([if car[k].x > 0 then car[k].v else 0 for k in i..N])": lambda c, i: total(
        (c.v * (c.x.real > 0))[i - 1 :]
    ),
    "sum([sum(car[1..k].v)*car[k].x for k in 1..i])": lambda c, i: total((np.cumsum(c.v) * c.x)[:i]),
    "if i <= 35 then sum(car[i..i+34].v) else 0": lambda c, i: total(c.v[i - 1 : i + 34]) if i <= 35 else 0,
    "mean(car.x)": lambda c, i: total(c.x) / N,
    "mean(2*car.x .* car.v)": lambda c, i: total(2 * c.x * c.v) / N,
    "i*dot(car.x, car.v)": lambda c, i: i * total(c.x * c.v),
    "dot(weights, car.v)/i": lambda c, i: total(WEIGHTS * c.v) / i,
    "norm(car.x - [j/10 for j in 1..N])": lambda c, i: np.sqrt(total((c.x - np.arange(1, N + 1) / 10) ** 2)),
    "max(car.x .* car.v)": lambda c, i: extreme(c.x * c.v, np.argmax),
    "sum(transpose(car.p)*car.v)": lambda c, i: total(c.p.T @ c.v),
    "dot(car.x, [car[mod(j, N) + 1].v for j in 1..N])": lambda c, i: total(c.x * np.roll(c.v, -1)),
}


def listed(values: Array) -> str:
    return f"[{', '.join(map(str, values.tolist()))}]"


def text() -> str:
    """The cars, and for each case an array of watchers."""
    watchers = "".join(f"agent w{k}[i in 1..N] = Watch() [u := {case}];\n" for k, case in enumerate(CASES))
    return f"""
    func real mean(real[n] x) = sum(x)/n;
    const int N = {N};
    const int[N] low = {listed(LOW)};
    const int[N] high = {listed(HIGH)};
    const real[N] weights = {listed(WEIGHTS)};
    agent Car(real k = 1) {{
      write real x = k, v = 2*k, e;
      write real[2] p = [k, k^2];
      alge {{ e = x*v; }}
      diff {{ x' = v; v' = x - v; p' = [p[2], -p[1]]; }}
    }}
    agent Watch() {{ read real u; write real z = 0; diff {{ z' = u; }} }}
    agent Road() {{
      level cars {{ agent car[i in 1..N] = Car(k = i/N); }}
      level watchers {{ {watchers} }}
    }}"""


@cache
def road() -> hierc.Model:
    with pytest.warns(UserWarning, match="W613|W013"):
        return hierc.load(text())


def places(model: hierc.Model) -> tuple[list[int], list[list[int]]]:
    """Where the states of the cars are, as `Cars` has them, and those of the watchers, case by case."""
    at = {name: k for k, name in enumerate(model.states)}
    every = range(1, N + 1)
    cars = [at[f"car[{i}].{name}"] for name in ("x", "v") for i in every]
    cars += [at[f"car[{i}].p[{j}]"] for i in every for j in (1, 2)]
    return cars, [[at[f"w{k}[{i}].z"] for i in every] for k in range(len(CASES))]


@pytest.fixture(scope="module")
def state() -> Array:
    return RNG.normal(0, 1, len(road().states))


@pytest.mark.parametrize("k", range(len(CASES)), ids=list(CASES))
def test_values_and_derivatives(k: int, state: Array) -> None:
    """Values against numpy, derivatives against complex steps of the same."""
    model, case = road(), list(CASES.values())[k]
    cars, watchers = places(model)
    rates, jacobian = model.rhs(0.3, state), model.jacobian(0.3, state)
    expected = [case(Cars(state[cars]), i) for i in range(1, N + 1)]
    assert rates[watchers[k]] == pytest.approx(expected, rel=1e-13, abs=1e-13)
    slopes = np.zeros((N, len(cars)))
    for column in range(len(cars)):
        moved = state[cars].astype(complex)
        moved[column] += 1e-30j
        slopes[:, column] = [np.imag(case(Cars(moved), i)) / 1e-30 for i in range(1, N + 1)]
    found = jacobian[np.ix_(watchers[k], cars)]
    np.testing.assert_allclose(found, slopes, rtol=1e-12, atol=1e-13 * np.abs(slopes).max())


def test_slices_in_an_array_of_arrays() -> None:
    """Each row has cars of its own, and rows differ in length."""
    model = hierc.load("""
      agent Car(real k) { read real u; write real x = k; diff { x' = u; } }
      agent Row(int n, real k) {
        agent car[i in 1..n] = Car(k = k*i) [u := sum(car[1..i-1].x) + dot(car.x, car.x)];
      }
      agent Top() { agent row[j in 1..4] = Row(n = if j <= 2 then 40 else 50, k = j/10); }""")
    rates = dict(zip(model.states, model.rhs(0.0, model.initial()), strict=True))
    for j, n in ((1, 40), (2, 40), (3, 50), (4, 50)):
        x = j / 10 * np.arange(1, n + 1)
        expected = np.cumsum(x) - x + x @ x
        assert [rates[f"row[{j}].car[{i}].x"] for i in range(1, n + 1)] == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(
    ("count", "group", "method"), [(14, "each", "auto"), (60, "", "auto"), (60, "", "tsit5")]
)
def test_a_run(count: int, group: str, method: str) -> None:
    """Each car is slowed by those in front; all in one group, or every one in its own."""
    model = hierc.load(
        f"""
        agent Car(real start) {{
          read real load, best;
          write real x = start, v = 0;
          diff {{ x' = v; v' = 1 - v - 0.05*load + 0.1*best - x; }}
        }}
        agent Road(int N) {{
          agent car[i in 1..N] = Car(start = sin(i)) [
            load := sum([car[k].v*car[k].x for k in 1..i-1]), best := if i == 1 then 0 else max(car[1..i-1].v)];
          {"group each car;" if group else "group all = car;"}
        }}
        experiment drive of Road(N = {count}) {{ stop = 2; rtol = 1e-8; }}""",
    )

    def slopes(t: float, y: Array) -> Array:
        x, v = y[:count], y[count:]
        load = np.cumsum(x * v) - x * v
        best = np.concatenate([[0.0], np.maximum.accumulate(v)[:-1]])
        return np.concatenate([v, 1 - v - 0.05 * load + 0.1 * best - x])

    start = np.concatenate([np.sin(np.arange(1, count + 1)), np.zeros(count)])
    wanted = solve_ivp(slopes, (0, 2), start, "DOP853", rtol=1e-11, atol=1e-11, max_step=0.01).y[:, -1]
    result = model.simulate(method=method)
    assert np.concatenate([result["car.x"][-1], result["car.v"][-1]]) == pytest.approx(wanted, abs=1e-6)
