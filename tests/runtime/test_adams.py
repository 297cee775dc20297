"""Adams' methods: their coefficients for any steps, the observed order of each, and how orders and steps are chosen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from types import FunctionType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from running import run
from small_models import OSCILLATOR, PENDULUM, At, a_class, a_model
from test_orders import SPEAKER, TRACKER, WARP, observed, rotation, tracker, warp

import hierc
from hierc.runtime.contract import Class
from hierc.runtime.methods import adams, adams_pieces
from hierc.runtime.methods.adams import Adams
from hierc.runtime.methods.adams_pieces import BASIS, FIRST, HIGHEST, MEAN, PAST, ROWS, SCALE, begin_tables
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.model import Model
from hierc.runtime.simulation import Simulation
from hierc.runtime.trajectory import Trajectories

Floats = NDArray[np.float64]

# ---- coefficients ------------------------------------------------------------------------------


def a_group() -> SimpleNamespace:
    """What `coefficients` sees of a group before its first step."""
    g = SimpleNamespace(work=np.zeros((FIRST, 1)), regular=1, alike=0, previous=0.0, trial=0.0)
    constants = {"EQUAL_STEPS": adams.equal_steps(), "LEFT_OUT": adams.left_out()}
    FunctionType(begin_tables.__code__, {**vars(adams_pieces), **constants})(
        g.work
    )  # as the lowering binds it
    return g


def advance(g: SimpleNamespace, h: float, *, accepted: bool = True) -> None:
    """The tables for a trial of size h; where it is accepted, the history that it leaves."""
    g.trial = h
    adams.coefficients(g)
    if accepted:
        g.alike, g.previous = adams.in_a_row(g), h
        past = g.work[PAST : PAST + ROWS, 0]
        past[1:] = past[:-1] + h


def tables(g: SimpleNamespace) -> dict[str, Floats]:
    work = g.work[:, 0]
    rows = {name: work[at : at + ROWS].copy() for name, at in (("scale", SCALE), ("mean", MEAN))}
    return {**rows, "basis": work[BASIS : BASIS + ROWS * ROWS].reshape(ROWS, ROWS).copy()}


def product(roots: Sequence[Fraction]) -> list[Fraction]:
    """Coefficients of the monic polynomial with these roots, lowest power first."""
    made = [Fraction(1)]
    for root in roots:
        made = [a - root * b for a, b in zip([Fraction(0), *made], [*made, Fraction(0)], strict=True)]
    return made


def cardinal(nodes: Sequence[Fraction], k: int) -> list[Fraction]:
    """Coefficients of Lagrange's polynomial that is 1 at node k."""
    others = [n for n in nodes if n != nodes[k]]
    scale = math.prod((nodes[k] - n for n in others), start=Fraction(1))
    return [c / scale for c in product(others)]


def modified(values: Sequence[Fraction], knots: Sequence[Fraction]) -> list[Fraction]:
    """Differences of the values at the knots, the last knot first: divided ones times the distances from the last knot."""
    divided, found, scale = list(values), [], Fraction(1)
    for j in range(len(values)):
        found.append(divided[0] * scale)
        scale *= knots[0] - knots[j + 1] if j + 1 < len(knots) else 1
        divided = [(a - b) / (knots[i] - knots[i + j + 1]) for i, (a, b) in enumerate(pairwise(divided))]
    return found


@pytest.mark.parametrize("seed", range(4))
def test_coefficients_of_any_steps(seed: int) -> None:
    """The rows of the basis, with the scaled differences, are the polynomial through all earlier values; the means integrate it."""
    random = np.random.default_rng(seed)
    sizes = [Fraction(int(s), 64) for s in random.choice([32, 64, 64, 64, 128, 57], size=2 * ROWS)]
    g = a_group()
    for h in sizes:
        advance(g, float(h))
    h, last = sizes[-1], sum(sizes[:-1], Fraction(0))
    knots = [sum(sizes[: len(sizes) - 1 - j], Fraction(0)) for j in range(ROWS)]
    made = tables(g)
    for order in range(1, ROWS + 1):
        nodes = [(t - last) / h for t in knots[:order]]
        for k in range(order):
            values = [Fraction(int(j == k)) for j in range(order)]
            found = np.array([float(d) for d in modified(values, knots[:order])]) * made["scale"][:order]
            exact = cardinal(nodes, k)
            size = max(abs(float(c)) for c in exact)
            powers = found @ made["basis"][:order]
            assert powers[:order] == pytest.approx(
                [float(c) for c in exact], abs=1e-13 * max(size, 1.0) * 2**order
            )
            integral = float(sum(c / (q + 1) for q, c in enumerate(exact)))
            assert found @ made["mean"][:order] == pytest.approx(
                integral, abs=1e-13 * max(size, 1.0) * 2**order
            )


def test_equal_steps() -> None:
    """The means are those of Adams and Bashforth, the differences between them those of Adams and Moulton."""
    g = a_group()
    for _ in range(2 * ROWS):
        advance(g, 0.125)
    means = tables(g)["mean"]
    known = ["1", "1/2", "5/12", "3/8", "251/720", "95/288", "19087/60480", "5257/17280", "1070017/3628800"]
    assert means[:9] == pytest.approx([float(Fraction(x)) for x in known], rel=1e-14)
    assert means[:-1] - means[1:] == pytest.approx(adams.equal_steps()[1:], rel=1e-12)
    corrector = ["1/2", "1/12", "1/24", "19/720", "3/160", "863/60480", "275/24192", "33953/3628800"]
    assert adams.equal_steps()[1:9] == pytest.approx([float(Fraction(x)) for x in corrector], rel=1e-14)
    assert tables(g)["scale"].tolist() == [1.0] * ROWS


def test_what_one_knot_fewer_leaves_out() -> None:
    s = np.linspace(0.0, 1.0, 2001)
    for j in range(2, ROWS):
        largest = np.abs(np.prod([(s + m - 1) / (m + 1) for m in range(j)], axis=0)).max()
        assert adams.left_out()[j] == pytest.approx(largest, rel=1e-3)


def test_rows_that_stay_are_those_computed_anew() -> None:
    """Whatever steps came before, and whatever trials failed between them."""
    random = np.random.default_rng(7)
    g = a_group()
    h = 1.0
    for _ in range(400):
        h = float(random.choice([h] * 6 + [0.5 * h, min(2.0 * h, 4.0)]))
        for factor in random.choice([0.5, 2.0, 0.9], size=random.choice([0, 0, 0, 1, 2])):
            advance(g, factor * h, accepted=False)
        before = g.work.copy(), g.regular
        g.regular = 1
        advance(g, h, accepted=False)
        anew = tables(g)
        g.work, g.regular = before
        advance(g, h)
        for name, rows in tables(g).items():
            assert rows == pytest.approx(anew[name], rel=1e-11), name


# ---- observed orders ---------------------------------------------------------------------------

STOP = 40.0
#: So loose that `max_step` alone decides.
LOOSE = 100.0
ORDERS = range(1, 7)


@pytest.fixture(autouse=True, scope="module")
def _each_order(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Methods of one order each, beside the others; their machine code is kept apart."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HIERC_CACHE", str(tmp_path_factory.mktemp("cache")))
        for k in ORDERS:
            method = Adams(k, k)
            patch.setitem(METHODS, method.name, method)
        yield


def fixed_steps(model: Model, order: int, sizes: Sequence[float]) -> Trajectories:
    """A run of one order with steps of one size for each group, after some that are so small that the way to this order leaves no error."""
    settings = {
        "start": 0.0, "stop": STOP, "rtol": LOOSE, "atol": LOOSE, "method": f"adams{order}to{order}", "max_step": math.inf,
        "min_step": 0.0,
    }  # fmt: skip
    chosen = model.engine.group_settings(settings, {})
    simulation = Simulation(model.engine, model.system(), chosen, model.initial(), 0.0, STOP)
    most = simulation.groups["max_step"]
    most[: len(sizes)] = 1e-7 * np.array(sizes)
    simulation.attempt(4 * len(sizes))
    most[: len(sizes)] = sizes
    assert simulation.advance().ok
    return simulation.trajectories()


def errors(tracks: Trajectories, g: int, exact: Callable[[Floats], Floats]) -> tuple[float, float]:
    """Largest errors at and between the knots of a group, up to where the last steps land on the stop."""
    track = tracks[g]
    sizes = np.diff(track.knots)
    assert np.ptp(sizes[45:-2]) < 1e-9  # the steps are indeed fixed
    knots = track.knots[track.knots < STOP - 2.5 * sizes.max()]
    times = np.linspace(0.0, knots[-1], 2000)
    at, between = (np.abs(track(t) - exact(t)).max() for t in (knots, times))
    return float(at), float(between)


@pytest.mark.parametrize(
    ("kind", "exact"), [(OSCILLATOR, rotation), (WARP, warp)], ids=["linear", "nonlinear"]
)
@pytest.mark.parametrize("order", ORDERS)
def test_orders_alone(order: int, kind: Class, exact: Callable[[Floats], Floats]) -> None:
    """The predictor's order and one more, for the corrected solution is kept; at the knots and between them."""
    model = a_model({"o": At(kind, (), 1)}, None, {"rate": 1.0})
    steps = (0.1 if kind is WARP else 0.25) / 1.25 ** np.arange(6)
    found = np.array([errors(fixed_steps(model, order, [h]), 0, exact) for h in steps])
    assert observed(steps, found[:, 0]) >= order + 1 - 0.25
    assert observed(steps, found[:, 1]) >= order + 1 - 0.25


@pytest.mark.parametrize("ratio", [0.63, 1.37, 2.0])
@pytest.mark.parametrize(("writer", "angular"), [("state", 1.0), ("out", 2.0)])
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_orders_of_readers(order: int, writer: str, angular: float, ratio: float) -> None:
    """The reader's step is `ratio` times the writer's."""
    kind = OSCILLATOR if writer == "state" else SPEAKER
    exact = tracker(0.6, angular)
    parameters = {"rate": 1.0, "speed": 0.6, "first": float(exact(np.zeros(1))[0, 0])}
    model = a_model({"w": At(kind, (), 1), "r": At(TRACKER, ((0, writer, 0),), 2)}, None, parameters)
    steps = 0.2 / 1.4 ** np.arange(5) / max(ratio, 1.0)
    worst = np.array([max(errors(fixed_steps(model, order, [h, ratio * h]), 1, exact)) for h in steps])
    assert observed(steps, worst) >= order + 1 - 0.25


# ---- how orders and steps are chosen -----------------------------------------------------------


def orders_used(model: Model, tolerance: float) -> list[int]:
    """The order of each step, from the degree of its polynomial."""
    track = run(model, STOP, tolerance, method="adams").groups[0]
    return [int(np.flatnonzero(row.any(axis=0)).max()) - 1 for row in track.coefficients]


def test_orders_rise_with_accuracy() -> None:
    model = a_model({"p": At(PENDULUM)})
    used = [orders_used(model, tolerance) for tolerance in (1e-2, 1e-5, 1e-8, 1e-11)]
    assert all(orders[:3] == [1, 2, 3] for orders in used)
    assert all(min(orders) >= 1 and max(orders) <= HIGHEST for orders in used)
    means = [float(np.mean(orders)) for orders in used]
    assert means == sorted(means)
    assert means[0] < 7.5 < 9.0 < means[-1]


def test_two_evaluations_a_step() -> None:
    group = run(a_model({"o": At(OSCILLATOR, (), 1)}, None, {"w": 1.0}), STOP, 1e-7, method="adams").groups[0]
    assert group.stats["rejected"] == 0
    assert group.stats["evaluations"] == 2 * group.stats["steps"] + 1


def test_fewer_evaluations_than_runge_kutta() -> None:
    """For as small an error."""
    model = a_model({"p": At(PENDULUM)})
    t = np.linspace(0.0, 20.0, 201)
    exact = run(model, 20.0, 1e-13, method="radau13").groups[0](t)
    for tolerance in (1e-4, 1e-6, 1e-8):
        errors, counts = [], []
        for method in ("adams", "dop853"):
            group = run(model, 20.0, tolerance, method=method).groups[0]
            errors.append(np.abs(group(t) - exact).max())
            counts.append(group.stats["evaluations"])
        assert errors[0] <= errors[1]
        assert counts[0] < 0.75 * counts[1]


def test_a_jump_lowers_the_order() -> None:
    """Across a jump of the derivative, with what others read of it: the run goes through by small steps of low order, then builds up again."""
    kind = a_class(
        "Jump",
        {"x": "a - x[0]"},
        {(0, 0): "-1.0"},
        first=["if t < 2.0:", "    a = 1.0", "else:", "    a = -3.0"],
    )
    track = run(a_model({"j": At(kind)}), 8.0, 1e-8, method="adams").groups[0]
    t = np.linspace(0.0, 8.0, 801)
    peak = 1.0 - math.exp(-2.0)
    exact = np.where(t < 2.0, 1.0 - np.exp(-t), -3.0 + (peak + 3.0) * np.exp(-(t - 2.0)))
    assert np.abs(track(t)[:, 0] - exact).max() < 1e-7
    orders = np.array([int(np.flatnonzero(row.any(axis=0)).max()) - 1 for row in track.coefficients])
    at = int(np.searchsorted(track.knots, 2.0))
    assert orders[: at - 40].max() >= 5
    assert orders[at - 2 : at + 4].min() <= 2
    assert orders[at + 30 :].max() >= 5


# ---- models ------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("name", "params", "stop"),
    [("cart", {}, 10.0), ("platoon", {"N": 4}, 60.0), ("quadrotor", {}, 6.0)],
    ids=str,
)
def test_models_of_the_gallery(name: str, params: dict[str, float], stop: float) -> None:
    """At most ten times the tolerance, beside a run of the implicit method of order 13 that goes nearly to rounding."""
    model = hierc.load(name, params=params)
    t = np.linspace(0.0, stop, 301)
    truth = model.simulate(stop=stop, rtol=1e-12, atol=1e-12, method="radau13")
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        found = model.simulate(stop=stop, rtol=tolerance, atol=tolerance, method="adams")
        for state in model.states:
            exact = truth(state, t)
            size = np.abs(exact).max() + 1.0
            assert np.abs(found(state, t) - exact).max() <= 10 * tolerance * size, state
