"""Systems of equations: factors and solutions against numpy, the machine's bits against CPython's, over lanes that exchange different rows."""

from __future__ import annotations

import ast
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_code import Floats, definition, interpreted, run_both

from hierc.runtime.linalg import LARGEST, determinant, factor, factor_size, substitute
from hierc.runtime.machine.allowed import check_function
from hierc.runtime.machine.split import depends, split
from hierc.runtime.machine.types import UnsupportedCode

sizes = st.integers(1, LARGEST)
seeds = st.integers(0, 2**32 - 1)


def conditioned(n: int, seed: int) -> Floats:
    """A random matrix with singular values from 1 to 100."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    return left @ np.diag(rng.uniform(1.0, 100.0, n)) @ right


def solved(a: Floats, b: Floats) -> Floats:
    n = len(a)
    return np.array(substitute(n, factor(n, *a.ravel().tolist()), *b.tolist()))


def close(found: Floats, wanted: Floats) -> bool:
    """Up to rounding, for a condition of at most 100."""
    return float(np.abs(found - wanted).max()) <= 1e-12 * float(np.abs(wanted).max())


@given(sizes, seeds)
def test_solutions(n: int, seed: int) -> None:
    a = conditioned(n, seed)
    b = np.random.default_rng(seed).normal(size=n)
    assert close(solved(a, b), np.linalg.solve(a, b))


@given(sizes, seeds)
def test_a_determinant(n: int, seed: int) -> None:
    a = conditioned(n, seed)
    found = determinant(n, factor(n, *a.ravel().tolist()))
    assert found == pytest.approx(np.linalg.det(a), rel=1e-12)


@given(st.permutations(range(LARGEST)), sizes, seeds)
def test_zero_pivots(order: list[int], n: int, seed: int) -> None:
    """A permuted triangle: without the exchange of rows most pivots are zero."""
    rng = np.random.default_rng(seed)
    rows = [k for k in order if k < n]
    a = (np.triu(rng.uniform(-1.0, 1.0, (n, n)), 1) / n + np.diag(rng.uniform(1.0, 2.0, n)))[rows]
    b = rng.normal(size=n)
    assert close(solved(a, b), np.linalg.solve(a, b))
    parity = np.linalg.det(np.eye(n)[rows])
    diagonal = np.prod([a[rows.index(k), k] for k in range(n)])
    assert determinant(n, factor(n, *a.ravel().tolist())) == pytest.approx(parity * diagonal, rel=1e-13)


@given(sizes, seeds, st.lists(st.integers(-60, 60), min_size=LARGEST, max_size=LARGEST))
def test_the_units_of_the_equations_do_not_matter(n: int, seed: int, powers: list[int]) -> None:
    """Rows scaled by powers of two, from nanometres to megameters and far beyond: the very same solution."""
    a = conditioned(n, seed)
    b = np.random.default_rng(seed).normal(size=n)
    scale = np.ldexp(1.0, powers[:n])
    assert (solved(a * scale[:, None], b * scale) == solved(a, b)).all()


def test_a_row_of_large_numbers_is_not_a_good_pivot_for_that() -> None:
    """Choosing by size alone takes the first row and loses the second one's 1."""
    a = np.array([[10.0, 1e17], [1.0, 1.0]])
    b = np.array([1e17, 2.0])
    assert close(solved(a, b), np.array([1.0, 1.0]))


@given(sizes, seeds)
def test_a_singular_matrix(n: int, seed: int) -> None:
    """Its determinant is zero, and no solution is finite; whole numbers, so that elimination is exact."""
    rng = np.random.default_rng(seed)
    a = np.eye(n)[rng.permutation(n)]
    a[:, rng.integers(n)] = 0.0
    factors = factor(n, *a.ravel().tolist())
    assert determinant(n, factors) == 0.0
    assert not np.isfinite(substitute(n, factors, *[1.0] * n)).all()


@given(sizes, seeds)
def test_what_is_no_number_is_not_lost(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = conditioned(n, seed)
    a[rng.integers(n), rng.integers(n)] = math.nan
    assert np.isnan(determinant(n, factor(n, *a.ravel().tolist())))


# ---- machine code ----------------------------------------------------------------------------


def text_of(n: int) -> str:
    """Solves with the matrix in x for the first n inputs, and gives the determinant."""
    entries = ", ".join(f"x[{k}]" for k in range(n * n))
    names = [f"a{k}" for k in range(n)]
    right = ", ".join(f"u[{k}]" for k in range(n))
    stores = "".join(f"    dx[{k}] = {name}\n" for k, name in enumerate(names))
    return (
        "def rhs(t, x, u, dx):\n"
        f"    f = linalg.factor({n}, {entries})\n"
        f"    {', '.join(names)}, = linalg.substitute({n}, f, {right})\n"
        f"{stores}    dx[{n}] = linalg.determinant({n}, f)\n"
    )


def same_bits(a: Floats, b: Floats) -> bool:
    return bool(((a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b))).all())


@pytest.mark.parametrize("lanes", [1, 2, 8])
@pytest.mark.parametrize("n", [1, 2, 4, 7, 12])
def test_every_lane_has_the_bits_of_the_interpreter(n: int, lanes: int) -> None:
    """Permuted, scaled and singular matrices side by side, so that lanes exchange different rows."""
    rng = np.random.default_rng(n)
    matrices = []
    for k in range(48):
        a = rng.normal(size=(n, n)) * 10.0 ** rng.integers(-8, 8, (n, 1))
        if k % 3 == 1:
            a = np.triu(a)[rng.permutation(n)]
        if k % 8 == 5:
            a[:, rng.integers(n)] = 0.0
        matrices.append(a.ravel())
    arrays = {"t": np.zeros(48), "x": np.array(matrices), "u": rng.normal(size=(48, n))}
    expected, found = run_both(text_of(n), arrays, "dx", n + 1, lanes)
    assert same_bits(expected, found)


FACTORS = "f = linalg.factor(2, x[0], x[1], p[0], p[1])"
BRANCHES = """
def rhs(t, x, u, p, dx):
    if x[0] > 0.0:
        f = linalg.factor(2, x[0], x[1], p[0], p[1])
        a, b = linalg.substitute(2, f, u[0], 1.0)
        c = a + b
    else:
        g = linalg.factor(2, p[0], x[1], x[0], 2.0)
        d = linalg.determinant(2, g)
        c = d
    dx[0] = c
"""


@pytest.mark.parametrize("lanes", [1, 8])
def test_systems_within_branches(lanes: int) -> None:
    rng = np.random.default_rng(3)
    arrays = {
        "t": np.zeros(64),
        "x": rng.normal(size=(64, 2)),
        "u": rng.normal(size=(64, 1)),
        "p": np.array([0.3, 1.2]),
    }
    expected, found = run_both(BRANCHES, arrays, "dx", 1, lanes)
    assert same_bits(expected, found)


KEPT = """
def rhs(t, x, u, p, dx):
    f = linalg.factor(2, u[0], t, 1.0, u[0])
    a, b = linalg.substitute(2, f, x[0], 1.0)
    c, d = linalg.substitute(2, p[1:8], a, b)
    dx[0] = c*p[0]
    dx[1] = d
    dx[2] = linalg.determinant(2, f)
"""


@pytest.mark.parametrize("lanes", [1, 8])
def test_factors_that_are_kept(lanes: int) -> None:
    """In the values of a class, the same for all lanes."""
    rng = np.random.default_rng(4)
    assert factor_size(2) == 7
    arrays = {
        "t": rng.normal(size=16),
        "x": rng.normal(size=(16, 1)),
        "u": rng.normal(size=(16, 1)),
        "p": np.array([0.5, *factor(2, 0.0, 1.5, 2.0, 1.0)]),
    }
    if lanes == 1:
        expected, found = run_both(KEPT, arrays, "dx", 3)
    else:
        arrays["t"] = np.full(16, 0.7)
        expected, found = run_both(KEPT, arrays, "dx", 3, lanes)
    assert same_bits(expected, found)


def test_the_part_without_states_keeps_the_factors() -> None:
    """Factors of inputs are made once a step and take a row of the values that are handed on."""
    pieces = split(definition(KEPT), "dx", lambda array, index: array != "x")
    assert ast.unparse(pieces.before).splitlines()[1:] == [
        "    f = linalg.factor(2, u[0], t, 1.0, u[0])",
        "    v[0] = linalg.determinant(2, f)",
        "    v[1:8] = f",
    ]
    assert ast.unparse(pieces.after).splitlines()[1:3] == [
        "    f = v[1:8]",
        "    a, b = linalg.substitute(2, f, x[0], 1.0)",
    ]
    assert pieces.saved == 8
    assert depends(definition(KEPT), "dx", lambda array, index: array != "x") == {0, 1}
    arguments = {"t": 0.7, "x": [0.4], "u": [2.0], "p": [0.5, *factor(2, 0.0, 1.5, 2.0, 1.0)]}
    wanted, found, v = [0.0] * 3, [0.0] * 3, [0.0] * 8
    interpreted(KEPT)(**arguments, dx=wanted)
    interpreted(ast.unparse(pieces.before))(**arguments, v=v)
    interpreted(ast.unparse(pieces.after))(**arguments, dx=found, v=v)
    assert found == wanted


# ---- what is allowed -------------------------------------------------------------------------

ARRAYS = {"x": range(2), "u": range(1), "p": range(8)}


def check(*lines: str) -> None:
    text = "def rhs(t, x, u, p, dx):\n" + "".join(f"    {line}\n" for line in lines)
    check_function(definition(text), ARRAYS, "dx", range(1))


def test_what_the_compiler_writes_passes() -> None:
    check_function(definition(BRANCHES), ARRAYS, "dx", range(1))
    check_function(definition(KEPT), ARRAYS, "dx", range(3))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("f = linalg.factor(2, t, t, t)", "wrong number"),
        ("f = linalg.factor(13, *x)", "not a size"),
        ("f = linalg.factor(True, t)", "not a size"),
        ("f = linalg.factor(0)", "not a size"),
        ("f = linalg.factor(n, t)", "not a size"),
        ("f = linalg.factor(1, x[9])", "no such entry"),
        ("f = linalg.factor_size(1)", "not allowed"),
        ("a = linalg.determinant(1, t)", "not the factors"),
        ("a = linalg.determinant(1, p[0:4])", "not the factors"),
        ("a = linalg.determinant(1, p[6:9])", "not the factors"),
        ("a = linalg.determinant(1, p[-3:0])", "not the factors"),
        ("a = linalg.determinant(1, p[0:6:2])", "not the factors"),
        ("a = linalg.determinant(1, dx[0:3])", "not the factors"),
        ("a = p[0:3]", "not allowed"),
        ("a = linalg.factor(1, t) + 1.0", "not allowed"),
        ("a, b = linalg.substitute(1, p[0:3], t)", "has 1 values"),
        ("a, a = linalg.substitute(2, p[0:7], t, t)", "set twice"),
        ("a, x = linalg.substitute(2, p[0:7], t, t)", "cannot be set"),
        ("a, b = linalg.substitute(2, p[0:7], t)", "wrong number"),
        ("a, b = t, t", "not allowed"),
        ("a = linalg.substitute(1, p[0:3], t)", "not allowed"),
        ("linalg = 1.0", "cannot be set"),
    ],
)
def test_refusals(line: str, why: str) -> None:
    with pytest.raises(UnsupportedCode, match=f"line 2: .*{why}"):
        check(line, "dx[0] = 0.0")


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("dx[0] = f", "not a number"),
        ("dx[0] = linalg.determinant(3, f)", "not the factors"),
        ("f = 1.0", "set twice"),
        (FACTORS, "set twice"),
    ],
)
def test_factors_are_not_numbers(line: str, why: str) -> None:
    with pytest.raises(UnsupportedCode, match=f"line 3: .*{why}"):
        check(FACTORS, line)


def test_factors_stay_in_their_branch() -> None:
    with pytest.raises(UnsupportedCode, match="set twice"):
        check("if t > 0.0:", f"    {FACTORS}", "else:", f"    {FACTORS}", "dx[0] = linalg.determinant(2, f)")
