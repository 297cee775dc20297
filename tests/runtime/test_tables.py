"""Tables: values and derivatives against scipy, at edges and outside, and as machine code bit for bit."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from callees import machine_values
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator, RegularGridInterpolator

from hierc.runtime.tables import Axis, Table

Floats = NDArray[np.float64]
SHAPES = [(2,), (3,), (9,), (40,), (4, 5), (2, 2), (3, 2, 4), (2, 3, 2, 2)]


def made(method: str, shape: tuple[int, ...], seed: int = 0) -> Table:
    """A table of random numbers on a random grid, some neighbouring values equal."""
    rng = np.random.default_rng([seed, *shape])
    axes = tuple(Axis("abcd"[k], tuple(np.sort(rng.normal(0, 3, n)).tolist())) for k, n in enumerate(shape))
    values = np.round(rng.normal(0, 2, math.prod(shape)), 1)
    return Table("t", method, axes, tuple(values.tolist()))  # type: ignore[arg-type]


def grid(table: Table) -> tuple[list[Floats], Floats]:
    return [np.array(a.knots) for a in table.axes], np.array(table.values).reshape(table.sizes)


def inside(table: Table, count: int, seed: int = 1) -> Floats:
    """Points within the grid."""
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(a.knots[0], a.knots[-1], count) for a in table.axes], axis=1)


# ---- values -------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [2, 3, 4, 9, 40])
def test_cubic_on_one_axis_is_the_monotone_cubic_of_scipy(points: int) -> None:
    table = made("cubic", (points,))
    (x,), y = grid(table)
    reference = PchipInterpolator(x, y)
    at = inside(table, 500)[:, 0]
    assert np.allclose([table(v) for v in at], reference(at), rtol=1e-12, atol=1e-12)
    assert np.allclose([table.by(0)(v) for v in at], reference(at, 1), rtol=1e-10, atol=1e-10)


def test_cubic_on_two_axes_is_made_of_cubics() -> None:
    """Interpolating values and slopes along one axis, then along the other, by scipy's Hermite pieces."""
    table = made("cubic", (5, 7))
    (x, y), f = grid(table)
    by_x, by_y = (PchipInterpolator(g, f, axis=k).derivative()(g) for k, g in enumerate((x, y)))
    mixed = (
        PchipInterpolator(y, by_x, axis=1).derivative()(y)
        + PchipInterpolator(x, by_y, axis=0).derivative()(x)
    ) / 2
    for a, b in inside(table, 200):
        values = CubicHermiteSpline(x, f, by_x)(a)
        slopes = CubicHermiteSpline(x, by_y, mixed)(a)
        assert table(a, b) == pytest.approx(CubicHermiteSpline(y, values, slopes)(b), rel=1e-11, abs=1e-11)


def test_on_a_grid_line_a_table_of_two_is_that_of_one() -> None:
    table = made("cubic", (6, 4))
    (x, y), f = grid(table)
    for j, b in enumerate(y):
        line = PchipInterpolator(x, f[:, j])
        for a in np.linspace(x[0], x[-1], 31):
            assert table(a, b) == pytest.approx(float(line(a)), rel=1e-12, abs=1e-12)


def test_the_order_of_arguments_does_not_matter() -> None:
    table = made("cubic", (4, 3, 5))
    _, f = grid(table)
    order = (2, 0, 1)
    other = Table(
        "t", "cubic", tuple(table.axes[k] for k in order), tuple(f.transpose(order).ravel().tolist())
    )
    for point in inside(table, 100):
        assert other(*point[list(order)]) == pytest.approx(table(*point), rel=1e-12, abs=1e-12)


def test_a_product_of_curves_is_interpolated_by_the_product() -> None:
    rng = np.random.default_rng(5)
    x, y = np.arange(6.0), np.arange(5.0) * 2
    f, g = rng.normal(size=6), rng.normal(size=5)
    table = Table(
        "t", "cubic", (Axis("x", tuple(x)), Axis("y", tuple(y))), tuple(np.outer(f, g).ravel().tolist())
    )
    a, b = PchipInterpolator(x, f), PchipInterpolator(y, g)
    for point in inside(table, 100):
        assert table(*point) == pytest.approx(float(a(point[0]) * b(point[1])), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_is_scipys(shape: tuple[int, ...]) -> None:
    table = made("linear", shape)
    axes, f = grid(table)
    reference = RegularGridInterpolator(axes, f)
    for point in inside(table, 100):
        assert table(*point) == pytest.approx(float(reference(point)[0]), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_hold_has_the_value_of_the_point_before(shape: tuple[int, ...]) -> None:
    table = made("hold", shape)
    axes, f = grid(table)
    for point in inside(table, 100):
        before = tuple(np.searchsorted(x, v, side="right") - 1 for x, v in zip(axes, point, strict=True))
        assert table(*point) == f[before]
        assert [table.by(k)(*point) for k in range(len(shape))] == [0.0] * len(shape)


@pytest.mark.parametrize("method", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("shape", SHAPES)
def test_at_its_points_a_table_has_their_values(method: str, shape: tuple[int, ...]) -> None:
    table = made(method, shape)
    axes, f = grid(table)
    for place in product(*map(range, shape)):
        assert table(*(x[k] for x, k in zip(axes, place, strict=True))) == f[place]


def test_cubic_stays_between_neighbours() -> None:
    table = made("cubic", (12,))
    (x,), y = grid(table)
    for k in range(11):
        values = [table(v) for v in np.linspace(x[k], x[k + 1], 101)]
        low, high = sorted((y[k], y[k + 1]))
        assert low - 1e-12 <= min(values)
        assert max(values) <= high + 1e-12


# ---- derivatives --------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["linear", "cubic"])
@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_are_those_of_the_values(method: str, shape: tuple[int, ...]) -> None:
    table = made(method, shape)
    axes, _ = grid(table)
    for point in inside(table, 60):
        for k, x in enumerate(axes):
            h = 1e-5 * float(np.min(np.diff(x)))
            ahead, behind = point.copy(), point.copy()
            ahead[k], behind[k] = point[k] + h, point[k] - h
            if np.searchsorted(x, ahead[k]) != np.searchsorted(x, behind[k]) or not x[0] < behind[k] < x[-1]:
                continue
            difference = (table(*ahead) - table(*behind)) / (ahead[k] - behind[k])
            assert table.by(k)(*point) == pytest.approx(difference, rel=1e-4, abs=1e-4)


def test_the_derivative_of_cubic_has_no_jumps() -> None:
    table = made("cubic", (8,))
    slope = table.by(0)
    for knot in table.axes[0].knots[1:-1]:
        assert slope(np.nextafter(knot, -9)) == pytest.approx(
            slope(np.nextafter(knot, 9)), rel=1e-9, abs=1e-9
        )


# ---- outside ------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["hold", "linear", "cubic"])
def test_outside_there_is_the_value_of_the_edge(method: str) -> None:
    table = made(method, (5, 4))
    (x, y), _ = grid(table)
    middle = float(y.mean())
    assert table(x[0] - 3, middle) == table(x[0], middle)
    assert table(x[-1] + 3, y[-1] + math.inf) == table(x[-1], y[-1])
    assert table.by(0)(x[0] - 3, middle) == 0.0
    assert table.by(1)(x[0] - 3, middle) == table.by(1)(x[0], middle)


def test_outside_is_remembered_and_rounding_is_not() -> None:
    table = Table(
        "t", "linear", (Axis("n", (0.0, 2.0), "rpm", 0.5), Axis("v", (1.0, 3.0))), (0.0, 1.0, 2.0, 3.0)
    )
    table(-1e-12, 3.0 + 1e-12)
    assert table.excursions(table.outside) == []
    table.by(1)(2.1, 2.0)
    table(1.0, 0.0)
    assert table.excursions(table.outside) == ["n > 4 rpm", "v < 1"]


@pytest.mark.parametrize("method", ["hold", "linear", "cubic"])
def test_not_a_number_stays(method: str) -> None:
    table = made(method, (5, 4))
    assert math.isnan(table(math.nan, 0.0))
    assert math.isnan(table(0.0, math.nan))


# ---- machine code -------------------------------------------------------------------------------


@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("method", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("shape", [(2,), (9,), (4, 5), (3, 2, 4)])
def test_machine_code_has_the_very_bits(method: str, shape: tuple[int, ...], lanes: int) -> None:
    table = made(method, shape)
    callees = {"callee0": table, **{f"callee{k + 1}": table.by(k) for k in range(len(shape))}}
    spread = np.random.default_rng(9).normal(0, 5, (160, len(shape)))
    spread[0, 0] = math.nan
    spread[1] = [a.knots[0] for a in table.axes]
    spread[2] = [a.knots[-1] for a in table.axes]
    spread[3] = [math.inf] * len(shape)
    arguments = ", ".join(f"x[{k}]" for k in range(len(shape)))
    lines = [f"    dx[{k}] = {name}({arguments})" for k, name in enumerate(callees)]
    found, links = machine_values("\n".join(["def rhs(t, x, dx):", *lines]), callees, spread, lanes)
    expected = np.array([[callee(*point) for callee in callees.values()] for point in spread])
    assert np.array_equal(found, expected, equal_nan=True)
    assert links.marked()
    assert not links.marked()


def test_large_tables_are_data_not_code() -> None:
    """A hundred thousand points: the search takes 17 steps, and the code is as long as for two."""
    x = np.cumsum(np.random.default_rng(3).uniform(0.1, 1, 100_000))
    table = Table("t", "cubic", (Axis("x", tuple(x.tolist())),), tuple(np.sin(x / 50).tolist()))
    points = np.random.default_rng(4).uniform(x[0], x[-1], (64, 1))
    found, _ = machine_values("def rhs(t, x, dx):\n    dx[0] = callee0(x[0])", {"callee0": table}, points, 8)
    assert np.array_equal(found[:, 0], [table(*p) for p in points])
    assert np.allclose(found[:, 0], np.sin(points[:, 0] / 50), atol=1e-4)
