"""Groups without states: what they publish, how closely, what their steps follow, and how they fail."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from array_models import a_model
from fan_models import fan
from numpy.typing import NDArray
from running import METHODS, run
from scipy.integrate import solve_ivp
from small_models import OSCILLATOR, At, a_class
from small_models import a_model as small

from hierc.runtime.machine.forms import wire
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun
from hierc.runtime.segments import HEADER
from hierc.runtime.simulation import tighten
from hierc.runtime.trajectory import GroupTrajectory

Floats = NDArray[np.float64]
#: Frequencies, 1/s, of sixteen oscillators of very different rates, and what each is worth.
RATES = {f"osc[{k + 1}].w": 0.2 * 1.35**k for k in range(16)}
LARGEST, SUM = "largest", "total"


@cache
def model(*, shared: bool = True) -> Model:
    return a_model(fan(2, shared=shared))


def group(finished: FinishedRun, name: str) -> GroupTrajectory:
    assert finished.status.ok, finished.status.message
    (found,) = (g for g in finished.groups if g.name == name)
    return found


def published(g: GroupTrajectory, t: Floats) -> Floats:
    """The one channel of a group without states."""
    rows = g.table[np.clip(np.searchsorted(g.table[:, 1], t), 0, len(g.table) - 1)]
    theta = (t - rows[:, 0]) * rows[:, 2]
    return sum(rows[:, HEADER + q] * theta**q for q in range(g.degree + 1))


def terms(finished: FinishedRun, t: Floats) -> Floats:
    """The oscillators (16, times) as their own polynomials have them."""
    return finished.groups.states(np.arange(0, 32, 2), t).T


def joins(x: Floats, t: Floats) -> tuple[Floats, Floats]:
    """What `fan` makes of sixteen oscillators: the sum of what they are worth, and the largest."""
    worth = np.array([0.3 + 0.11 * (k % 7) for k in range(16, 32)])[:, None]
    return (worth * x**2 + np.sin(t + worth)).sum(axis=0), x.max(axis=0)


# ---- what is published ---------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_channels_between_their_knots(method: str, tolerance: float) -> None:
    """They follow what their terms' polynomials say, at kinks too, but where another one is the largest for a moment; and they are continuous."""
    finished = run(model(), 4.0, tolerance, params=RATES, method=method)
    t = np.random.default_rng(5).uniform(1e-3, 4.0, 20_000)
    total, largest = joins(terms(finished, t), t)
    assert np.abs(published(group(finished, SUM), t) - total).max() < 16 * tolerance
    assert np.mean(np.abs(published(group(finished, LARGEST), t) - largest) > 2 * tolerance) < 0.01
    for name in (SUM, LARGEST):
        g = group(finished, name)
        ends = published(g, g.knots[1:-1])  # of the segments that end there
        assert ends == pytest.approx(g.table[1:, HEADER], abs=1e-11)  # powers cost some digits


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "tsit5", "dop853", "adams"])
def test_channels_against_the_solution(method: str) -> None:
    """The oscillators are cosines."""
    finished = run(model(), 4.0, 1e-7, params=RATES, method=method)
    t = np.random.default_rng(6).uniform(0.0, 4.0, 5_000)
    total, largest = joins(np.array([np.cos(w * t) for w in RATES.values()]), t)
    assert np.abs(published(group(finished, SUM), t) - total).max() < 16e-7
    assert np.mean(np.abs(published(group(finished, LARGEST), t) - largest) > 2e-7) < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_readers_against_another_solver(method: str) -> None:
    system = model(shared=False).system(RATES)
    x = system.initial(0.0)
    ends = solve_ivp(system.rhs, (0.0, 4.0), x, "DOP853", rtol=1e-11, atol=1e-11, max_step=0.02).y[:, -1]
    finished = run(model(), 4.0, 1e-6, params=RATES, method=method)
    (found,) = finished.groups.states(np.arange(len(x)), np.array([4.0]))
    assert found[-3:] == pytest.approx(ends[-3:], rel=1e-5, abs=1e-5)
    for name in (SUM, LARGEST):
        g = group(finished, name)
        assert (g.method, len(g.initial), g.coefficients.shape[1]) == ("fit", 0, 0)
        assert g(np.array([0.0, 1.0])).shape == (2, 0)


def test_nothing_is_integrated_and_little_is_looked_at() -> None:
    """Three looks a trial; a smooth sum takes about the steps of its terms."""
    finished = run(model(), 4.0, 1e-6, params=RATES, method="radau13")
    steps = max(g.stats["steps"] for g in finished.groups if g.name.startswith("osc"))
    total = group(finished, SUM).stats
    assert total["steps"] < 3 * steps
    assert total["evaluations"] == 3 * (total["steps"] + total["rejected"])
    assert total["jacobians"] == total["iterations"] == 0


def test_it_steps_apart_from_its_terms() -> None:
    """With steps cut to a hundredth of those of its terms, the sum is the same; its terms have not noticed."""
    free = run(model(), 4.0, 1e-8, params=RATES)
    cut = run(model(), 4.0, 1e-8, params=RATES, groups={SUM: {"max_step": 1e-3}})
    assert np.diff(group(cut, SUM).knots).max() <= 1e-3 * (1 + 1e-12)
    t = np.linspace(0.01, 4.0, 999)
    assert published(group(cut, SUM), t) == pytest.approx(published(group(free, SUM), t), abs=16e-8)
    knots = [[g.knots.tolist() for g in f.groups if g.name.startswith("osc")] for f in (free, cut)]
    assert knots[0] == knots[1]


def test_the_way_to_a_reader_tightens_once() -> None:
    """By way of a sum or not, the terms have the same tolerances; the sum has those of its terms' reader, one edge tighter."""
    depths = []
    for shared in (False, True):
        elements = model(shared=shared).engine.elements
        factors, depth = tighten(elements, wire(elements), 0.3, 0.03)
        depths.append({elements.group_name(g): factors[depth[g]] for g in range(elements.groups)})
    apart, together = depths
    assert {name: together[name] for name in apart} == apart
    assert together[SUM] == pytest.approx(0.09)  # read by the reader, whom the last one reads
    assert apart["osc[1]"] == together["osc[1]"] == pytest.approx(0.09)
    assert together["reader"] == pytest.approx(0.3)


# ---- terms that cancel, jumps, failures ------------------------------------------------------------

_READER = a_class(
    "Reader",
    {"y": "u[0] - x[0]"},
    {(0, 0): "-1.0", (0, 1): "1.0"},
    start=["0.0"],
    inputs=1,
)


def joined(out: str, derivatives: tuple[str, str], count: int = 2) -> Model:
    """Two oscillators of different rates, a group without states that makes something of them, and a reader of that."""
    kind = a_class(
        "Join", {}, dict(zip([(0, 0), (0, 1)], derivatives, strict=True)), inputs=2, outs=[(out, (0, 1))]
    )
    nodes = {
        "a": At(OSCILLATOR, (), 1),
        "b": At(OSCILLATOR, (), 1),
        "join": At(kind, ((0, "state", 0), (1, "state", 0))),
        "reader": At(_READER, ((2, "out", 0),)),
    }
    return small(nodes, {name: [name] for name in nodes}, {"a.w": 1.0, "b.w": 1.0 + 1e-9})


@pytest.mark.parametrize("method", METHODS)
def test_a_difference_is_known_as_well_as_its_terms(method: str) -> None:
    """Of two terms that are equal but for a billionth, the difference has the kinks of their knots; they are not followed."""
    finished = run(
        joined("1e6*u[0] - 1e6*u[1]", ("1e6", "-1e6")), 6.0, 1e-5, method=method, groups={"b": {"rtol": 3e-6}}
    )
    steps = max(g.stats["steps"] for g in finished.groups if g.name in ("a", "b"))
    assert group(finished, "join").stats["steps"] <= 3 * steps


def test_whichever_two_terms_cancel() -> None:
    """Of ten terms two count, with opposite signs."""
    count = 10
    kind = a_class(
        "Weighed",
        {},
        {(0, k): f"p[{k}]" for k in range(count)},
        inputs=count,
        values=[f"q[{k}]" for k in range(count)],
        outs=[(" + ".join(f"p[{k}]*u[{k}]" for k in range(count)), tuple(range(count)))],
    )
    nodes = {f"o{k}": At(OSCILLATOR, (), 1) for k in range(count)}
    nodes["join"] = At(kind, tuple((k, "state", 0) for k in range(count)), count)
    nodes["reader"] = At(_READER, ((count, "out", 0),))
    rates = {f"o{k}.w": 1.0 + 1e-9 * k for k in range(count)}
    weighed = small(
        nodes, {name: [name] for name in nodes}, {**rates, **{f"join.{k}": 0.0 for k in range(count)}}
    )
    for first, second in itertools.combinations(range(count), 2):
        settings = {f"o{second}": {"max_step": 0.37}}  # knots of its own, and the same tolerance
        params = {f"join.{first}": 1e6, f"join.{second}": -1e6}
        finished = run(weighed, 6.0, 1e-5, method="radau13", groups=settings, params=params, most_steps=1000)
        assert group(finished, "join").stats["steps"] < 50, (first, second)


def test_a_jump_is_gone_through() -> None:
    """The reader of a jump is as exact as elsewhere; the jumps are at odd multiples of pi/2."""
    finished = run(joined("1.0 if u[0] > 0.0 else 0.0", ("0.0", "0.0")), 6.0, 1e-8)
    a, b = np.pi / 2, 3 * np.pi / 2
    end = (1 - np.exp(-a)) * np.exp(-(6 - a)) + (1 - np.exp(-(6 - b)))
    (y,) = finished.groups.states(np.array([4]), np.array([6.0]))[0]
    assert y == pytest.approx(end, rel=1e-7)


def test_what_is_not_a_number_is_named() -> None:
    finished = run(joined("math.sqrt(u[0])", ("0.5/math.sqrt(u[0])", "0.0")), 6.0)
    assert finished.status.name == "NOT_FINITE"
    assert "`join` is not a number just after t = 1.57079" in finished.status.message
    assert finished.t_reached == pytest.approx(np.pi / 2, abs=1e-6)


def test_a_least_step_that_is_too_large_is_named() -> None:
    kinked = joined("abs(u[0])", ("1.0 if u[0] > 0.0 else -1.0", "0.0"))
    finished = run(kinked, 6.0, groups={"join": {"min_step": 0.01}})
    assert finished.status.name == "STEP_TOO_SMALL"
    assert "group `join` needs a step smaller than its `min_step` of 0.01 s" in finished.status.message


def test_a_group_that_takes_too_many_steps_is_named() -> None:
    finished = run(
        joined("u[0]*u[1]", ("u[1]", "u[0]")), 6.0, groups={"join": {"max_step": 1e-3}}, most_steps=100
    )
    assert finished.status.message == "group `join` took 100 steps and is only at t = 0.1 s"


def test_a_method_does_not_matter_but_must_be_one() -> None:
    given = joined("u[0]*u[1]", ("u[1]", "u[0]"))
    runs = [run(given, 6.0, groups={"join": {"method": m}}) for m in ("tsit5", "radau5")]
    assert group(runs[0], "join").table.tobytes() == group(runs[1], "join").table.tobytes()
    with pytest.raises(ValueError, match="unknown method `fit`; there are auto, radau5"):
        run(given, 6.0, groups={"join": {"method": "fit"}})


def test_what_moves_faster_than_its_terms() -> None:
    """A function that turns hundreds of times in a step of its terms."""
    finished = run(joined("math.sin(200.0*u[0])", ("200.0*math.cos(200.0*u[0])", "0.0")), 3.0, 1e-6)
    t = np.linspace(0.001, 3.0, 50_001)
    assert np.abs(published(group(finished, "join"), t) - np.sin(200 * np.cos(t))).max() < 2e-4
