"""The Radau IIA tables, derived again with 50 digits, and the order conditions that they satisfy."""

from __future__ import annotations

import itertools

import mpmath as mp
import numpy as np
import pytest

from hierc.runtime.methods.radau_tables import RADAU5, RADAU9, RADAU13, Tables

ALL = pytest.mark.parametrize("tables", [RADAU5, RADAU9, RADAU13], ids=lambda t: f"radau{t.order}")
#: Each entry was rounded once: half a spacing, and a little for the comparison itself.
ROUNDED = mp.mpf(2) ** -52


@pytest.fixture(autouse=True)
def _digits() -> object:
    with mp.workdps(50):
        yield


def zeros(s: int) -> list[mp.mpf]:
    """Zeros of d^(s-1)/dx^(s-1) [x^(s-1) (x-1)^s]: P_s - P_(s-1) of the shifted Legendre polynomials has the same."""

    def value(x: mp.mpf) -> mp.mpf:
        return mp.legendre(s, 2 * x - 1) - mp.legendre(s - 1, 2 * x - 1)

    grid = [mp.mpf(k) / 400 for k in range(400)]
    inside = [
        mp.findroot(value, (a, b), solver="anderson", tol=mp.mpf(10) ** -90)
        for a, b in itertools.pairwise(grid)
        if value(a) * value(b) < 0
    ]
    return [*inside, mp.mpf(1)]


def collocation(c: list[mp.mpf]) -> mp.matrix:
    """A with sum_j A[i,j] c[j]^k = c[i]^(k+1)/(k+1) for k < s."""
    s = len(c)
    powers = mp.matrix([[x**k for k in range(s)] for x in c])
    integrals = mp.matrix([[x ** (k + 1) / (k + 1) for k in range(s)] for x in c])
    return integrals * powers**-1


def complex_lanes(packed: tuple[float, ...]) -> list[mp.mpc]:
    """Packed numbers: one real and (s - 1)/2 complex ones."""
    half = len(packed) // 2
    return [mp.mpc(packed[k], packed[half + k]) for k in range(half)]


def close(found: object, exact: object, scale: object = 1) -> bool:
    return abs(found - exact) <= ROUNDED * max(abs(scale), abs(exact))


@ALL
def test_nodes(tables: Tables) -> None:
    exact = zeros(tables.stages)
    assert len(exact) == tables.stages
    assert all(close(mp.mpf(a), b, b) for a, b in zip(tables.nodes, exact, strict=True))


def matrix_from_tables(tables: Tables) -> mp.matrix:
    """A, from the eigenvalues and eigenvectors of its inverse as the step uses them: A^-1 v = T (lambda * (TI v))."""
    s, half = tables.stages, tables.lanes // 2
    inverse = mp.matrix(s, s)
    values = complex_lanes(tables.eigenvalues)
    for j in range(s):
        packed = complex_lanes(tables.to_eigen[j])
        scaled = [a * b for a, b in zip(values, packed, strict=True)]
        for i in range(s):
            inverse[i, j] = sum(
                scaled[k].real * tables.from_eigen[k][i] + scaled[k].imag * tables.from_eigen[half + k][i]
                for k in range(half)
            )
    return inverse**-1


@ALL
def test_eigenvalues_are_those_of_the_inverse(tables: Tables) -> None:
    exact, _ = mp.eig(collocation(zeros(tables.stages)) ** -1)
    upper = [v for v in exact if v.imag > -1e-30]
    found = complex_lanes(tables.eigenvalues)[: len(upper)]
    assert all(min(abs(v - w) for w in upper) <= 2 * ROUNDED * abs(v) for v in found)
    assert found[0].imag == 0
    assert len({min(range(len(upper)), key=lambda k: abs(upper[k] - v)) for v in found}) == len(upper)


@ALL
def test_transforms_are_inverse_to_each_other(tables: Tables) -> None:
    """Stages to eigen-components and back; entries are up to 50, so errors of rounding up to some 1e-14."""
    product = np.array(tables.to_eigen) @ np.array(tables.from_eigen)[:, : tables.stages]
    largest = np.abs(tables.to_eigen).max() * np.abs(tables.from_eigen).max()
    assert np.abs(product - np.eye(tables.stages)).max() <= 4 * tables.lanes * 2.0**-53 * largest


@ALL
def test_the_spectral_form_is_the_collocation_method(tables: Tables) -> None:
    exact, found = collocation(zeros(tables.stages)), matrix_from_tables(tables)
    # The transforms' condition number (below 300) times the rounding of their entries.
    assert max(abs(a - b) for a, b in zip(exact, found, strict=True)) <= 300 * 2.0**-53


@ALL
def test_order_conditions(tables: Tables) -> None:
    """B(2s-1), C(s), D(s-1) of the method that the tables make (Butcher 1964: order 2s-1)."""
    s = tables.stages
    a = matrix_from_tables(tables)
    c = [mp.mpf(x) for x in tables.nodes]
    b = [a[s - 1, j] for j in range(s)]
    small = 300 * 2.0**-53
    for k in range(1, 2 * s):
        assert abs(sum(b[j] * c[j] ** (k - 1) for j in range(s)) - mp.mpf(1) / k) < small, f"B({k})"
    assert (
        abs(sum(b[j] * c[j] ** (2 * s - 1) for j in range(s)) - mp.mpf(1) / (2 * s)) > 1e-9 / 4**s
    )  # B(2s) fails
    for k in range(1, s + 1):
        for i in range(s):
            assert abs(sum(a[i, j] * c[j] ** (k - 1) for j in range(s)) - c[i] ** k / k) < small, f"C({k})"
    for k in range(1, s):
        for j in range(s):
            left = sum(b[i] * c[i] ** (k - 1) * a[i, j] for i in range(s))
            assert abs(left - b[j] * (1 - c[j] ** k) / k) < small, f"D({k})"


@ALL
def test_error_weights(tables: Tables) -> None:
    """e . z is mu (b^ - b) . f, with b^ of order s that takes f at the start with weight 1/mu (Hairer and Wanner, IV.8)."""
    s = tables.stages
    c = zeros(s)
    a = collocation(c)
    mu = max((v for v in mp.eig(a**-1)[0] if abs(v.imag) < 1e-30), key=lambda v: v.real).real
    weights = (
        mp.matrix([tables.error]) * a
    )  # what the estimate makes of the derivatives, beside h f at the start
    for k in range(s):
        moment = sum(weights[j] * c[j] ** k for j in range(s)) + (1 if k == 0 else 0)
        assert abs(moment) <= 60 * 2.0**-53, k  # vanishes for polynomials that both formulas integrate
    assert abs(sum(weights[j] * c[j] ** s for j in range(s))) > 1e-6
    assert close(mp.mpf(tables.eigenvalues[0]), mu, mu)


@ALL
def test_powers_of_the_collocation_polynomial(tables: Tables) -> None:
    """Increments of theta^k at the stages give the coefficient of theta^k alone."""
    table = np.array(tables.to_powers)
    for k in range(1, tables.stages + 1):
        increments = np.array(tables.nodes) ** k
        wanted = np.zeros(tables.lanes)
        wanted[k] = 1.0
        assert np.abs(increments @ table - wanted).max() <= 8 * 2.0**-53 * np.abs(table).max()


@ALL
def test_unused_lanes_are_harmless(tables: Tables) -> None:
    s, half = tables.stages, tables.lanes // 2
    pairs = (s + 1) // 2
    unused = [*range(pairs, half), *range(half + pairs, tables.lanes)]
    assert all(complex_lanes(tables.eigenvalues)[k] == 1 for k in range(pairs, half))
    for row in tables.to_eigen:
        assert [row[k] for k in unused] == [0.0] * len(unused)
    for k in unused:
        assert set(tables.from_eigen[k]) == {0.0}
