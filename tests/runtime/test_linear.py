"""Factors and solutions of the Newton matrices, in machine code, against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from machine_code import Floats, exported, room
from small_models import a_class

from hierc.runtime.contract import Class
from hierc.runtime.machine import compose
from hierc.runtime.machine.bytable import Layout
from hierc.runtime.machine.calls import CallForm, Form
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.elimination import eliminate
from hierc.runtime.machine.unit import Unit, parse_function
from hierc.runtime.methods.radau_tables import RADAU5, RADAU9, RADAU13, Tables

RNG = np.random.default_rng(3)


def linear_class(pattern: list[tuple[int, int]], n: int) -> Class:
    """x' = J x, the nonzeros of J being values of the class."""
    rhs = {
        f"x{i}": " + ".join(f"p[{k}]*x[{j}]" for k, (row, j) in enumerate(pattern) if row == i) or "0.0"
        for i in range(n)
    }
    return a_class(
        "Linear", rhs, {e: f"p[{k}]" for k, e in enumerate(pattern)}, values=["0.0"] * len(pattern)
    )


def single(kind: Class) -> Form:
    """The form of a group of one node that reads nothing."""
    return Form(len(kind.states), 0, 0, (CallForm(0, -1, 0, 0, 0, ()),), (), ())


class Newton:
    """The three pieces of one form as callables."""

    def __init__(self, kind: Class, tables: Tables) -> None:
        self.lanes, self.n = tables.lanes, len(kind.states)
        self.pieces = {}
        for name in ("factor", "solve", "solve_real"):
            unit = Unit(name)
            composer = Composer(unit, name, single(kind), (kind,), parse_function, self.lanes)
            emitted = (
                composer.factor(tables.eigenvalues, 0) if name == "factor" else getattr(composer, name)()
            )
            self.pieces[name] = exported(unit, emitted)
            self.by_table = composer.by_table is not None
            self.factors = room(composer.factor_size // self.lanes + 1, self.lanes)

    def factor(self, h: float, values: Floats) -> None:
        x = room(self.n, self.lanes)
        self.pieces["factor"](
            np.zeros(1), np.array([h]), x, room(1, self.lanes), values, room(1, self.lanes), self.factors
        )

    def solve(self, b: Floats) -> Floats:
        self.pieces["solve"](b, self.factors)
        return b

    def solve_real(self, b: Floats) -> Floats:
        self.pieces["solve_real"](b, self.factors)
        return b


def packed(values: Floats) -> Floats:
    """Complex numbers (n, half) as lanes: real parts, then imaginary ones."""
    into = room(len(values), 2 * values.shape[1])
    into[:] = np.hstack([values.real, values.imag])
    return into


def unpacked(lanes: Floats) -> Floats:
    half = lanes.shape[1] // 2
    return lanes[:, :half] + 1j * lanes[:, half:]


def random_pattern(n: int, density: float) -> list[tuple[int, int]]:
    return sorted(zip(*(k.tolist() for k in np.nonzero(RNG.random((n, n)) < density)), strict=True))


def chain_pattern(count: int) -> list[tuple[int, int]]:
    """`count` agents of three states in a row, each of which the neighbours move."""
    own = {
        (3 * k + i, 3 * k + j)
        for k in range(count)
        for i, j in ((0, 1), (1, 0), (1, 1), (1, 2), (2, 2), (2, 0))
    }
    coupled = {(3 * k + 2, 3 * (k + d)) for k in range(count) for d in (-1, 1) if 0 <= k + d < count}
    return sorted(own | coupled)


PATTERNS = [
    random_pattern(*p) for p in ((1, 1.0), (2, 0.0), (3, 1.0), (7, 0.3), (12, 0.25), (30, 0.05), (20, 0.6))
]


@pytest.mark.parametrize("tables", [RADAU5, RADAU9, RADAU13], ids=lambda t: f"radau{t.order}")
@pytest.mark.parametrize("by_table", [False, True], ids=["written out", "by table"])
@pytest.mark.parametrize(
    ("n", "pattern"),
    [*zip((1, 2, 3, 7, 12, 30, 20), PATTERNS, strict=True), (30, chain_pattern(10))],
    ids=["1", "2", "3", "7", "12", "30", "20", "chain"],
)
def test_against_numpy(
    tables: Tables, n: int, pattern: list[tuple[int, int]], by_table: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compose, "LARGE", -1 if by_table else 10**9)
    newton = Newton(linear_class(pattern, n), tables)
    assert newton.by_table == by_table
    eigenvalues = unpacked(np.array([tables.eigenvalues]))[0]
    for scale in (0.01, 1.0):
        values = RNG.normal(0, scale, max(len(pattern), 1))
        h = 0.5
        jacobian = np.zeros((n, n))
        for (i, j), value in zip(pattern, values, strict=False):
            jacobian[i, j] = value
        newton.factor(h, values)
        b = RNG.normal(size=(n, len(eigenvalues))) + 1j * RNG.normal(size=(n, len(eigenvalues)))
        b[:, 0] = b[:, 0].real
        found = unpacked(newton.solve(packed(b)))
        for k, eigenvalue in enumerate(eigenvalues):
            # Lanes that no eigenvalue of the method uses need not hold a solution, only stay finite.
            if k < (tables.stages + 1) // 2:
                matrix = eigenvalue * np.eye(n) - h * jacobian
                residual = np.abs(matrix @ found[:, k] - b[:, k]).max()
                assert residual < 1e-12 * np.abs(matrix).sum(axis=1).max() * np.abs(found[:, k]).max()
        assert np.isfinite(found).all()
        real = newton.solve_real(b[:, 0].real.copy())
        assert real == pytest.approx(found[:, 0].real, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(("pattern", "repeats"), [(chain_pattern(10), True), (PATTERNS[-1], False)])
def test_both_ways_of_a_table(pattern: list[tuple[int, int]], repeats: bool) -> None:
    """The chain is eliminated by loops with a body of their own, the dense matrix number by number."""
    n = 1 + max(i for i, _ in pattern)
    layout = Layout(eliminate(n, frozenset(pattern)), 8)
    assert any(stretch.rounds > 1 for stretch in layout.stretches) == repeats
    assert any(layout.width(entry) == 1 for entry in layout.places) == repeats


def test_what_is_large() -> None:
    dense = [(i, j) for i in range(20) for j in range(20)]
    assert Newton(linear_class(dense, 20), RADAU5).by_table
    assert not Newton(linear_class(dense[: 20 * 8], 20), RADAU5).by_table


def test_a_singular_matrix_gives_what_is_not_finite() -> None:
    """No trap: the Newton iteration sees it and gives the step up."""
    newton = Newton(linear_class([(0, 0), (0, 1), (1, 1)], 2), RADAU5)
    newton.factor(1.0, np.array([RADAU5.eigenvalues[0], 1.0, 0.0]))
    assert not np.isfinite(newton.solve(packed(np.ones((2, 2)) + 0j))).all()
    assert not np.isfinite(newton.solve_real(np.ones(2))).all()


def test_not_a_number_in_the_jacobian_passes_through() -> None:
    newton = Newton(linear_class([(0, 0), (1, 0), (1, 1)], 2), RADAU9)
    newton.factor(0.1, np.array([1.0, np.nan, 1.0]))
    found = newton.solve(packed(np.ones((2, 4)) + 0j))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_the_order_of_elimination_fills_least() -> None:
    """An arrow, its point first: in the given order everything would fill; Markowitz takes the shaft first, and nothing does."""
    n = 9
    arrow = {(i, i) for i in range(n)} | {(0, i) for i in range(n)} | {(i, 0) for i in range(n)}
    plan = eliminate(n, frozenset(arrow))
    assert len(plan.complex_entries) + len(plan.real_entries) == 2 * (n - 1)
    assert [step.pivot for step in plan.steps].index(0) >= n - 2
    assert plan == eliminate(n, frozenset(sorted(arrow, reverse=True)))


def test_a_chain_fills_nothing() -> None:
    """A cascade inside a group: lower triangular, whatever its length."""
    n = 200
    plan = eliminate(n, frozenset({(i, i) for i in range(n)} | {(i, i - 1) for i in range(1, n)}))
    assert plan.complex_entries == ()
    assert len(plan.real_entries) == n - 1
