"""`solve`, `inverse` and `det` of matrices from 4x4 to 12x12, whose factors are made at run time: values, derivatives and runs against numpy and scipy."""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from texts import Floats, model_of, module, rates, system

import hierc
from hierc.compiler import exact
from hierc.grammar.problems import ModelError

sizes = st.integers(4, 12)
seeds = st.integers(0, 2**32 - 1)


def permuted(n: int, seed: int) -> Floats:
    """A matrix with zeros on its diagonal that cannot be factored without exchanging rows; well conditioned but for the units of its rows."""
    rng = np.random.default_rng(seed)
    order = np.roll(np.arange(n), rng.integers(1, n))
    a = np.eye(n)[order] * rng.uniform(1.0, 2.0, n) + rng.uniform(-0.5, 0.5, (n, n)) / n
    np.fill_diagonal(a, 0.0)
    return a * 10.0 ** rng.integers(-6, 7, (n, 1))


def listed(a: Floats) -> str:
    """A matrix or vector as the language writes it."""
    return f"[{', '.join(listed(row) if np.ndim(row) else repr(float(row)) for row in a)}]"


def close(found: Floats, wanted: Floats, relative: float = 1e-12) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0, atol=relative * np.abs(wanted).max())


# ---- values ----------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(sizes, seeds)
def test_a_solution(n: int, seed: int) -> None:
    a, x = permuted(n, seed), np.random.default_rng(seed).normal(size=n)
    found, _ = rates(model_of("solve(A, b)", {"A": (n, n), "b": (n,)}, (n,)), {"A": a, "b": a @ x}, (n,))
    close(found, x)


@settings(max_examples=10, deadline=None)
@given(st.integers(4, 7), st.integers(1, 3), seeds)
def test_several_right_hand_sides(n: int, m: int, seed: int) -> None:
    a, x = permuted(n, seed), np.random.default_rng(seed).normal(size=(n, m))
    found, _ = rates(
        model_of("solve(A, B)", {"A": (n, n), "B": (n, m)}, (n, m)), {"A": a, "B": a @ x}, (n, m)
    )
    close(found, x)


@settings(max_examples=8, deadline=None)
@given(st.integers(4, 6), seeds)
def test_an_inverse(n: int, seed: int) -> None:
    a = permuted(n, seed)
    found, _ = rates(model_of("inverse(A)", {"A": (n, n)}, (n, n)), {"A": a}, (n, n))
    scales = np.abs(a).max(axis=1)  # its columns are in the rows' units
    close(found * scales, np.linalg.inv(a / scales[:, None]))


@settings(max_examples=10, deadline=None)
@given(sizes, seeds)
def test_a_determinant(n: int, seed: int) -> None:
    a = permuted(n, seed)
    found, _ = rates(model_of("det(A)", {"A": (n, n)}, ()), {"A": a}, ())
    close(found, np.linalg.det(a))


# ---- derivatives -----------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(sizes, st.integers(1, 4), seeds)
def test_derivatives(n: int, count: int, seed: int) -> None:
    """A = A0 + sum A_k sin(q_k), b = b0 + sum b_k q_k^2: dx = inverse(A) (db - dA x), and d det = det trace(inverse(A) dA)."""
    rng = np.random.default_rng(seed)
    a0, q = permuted(n, seed), rng.uniform(-1.0, 1.0, count)
    parts = [0.1 * rng.normal(size=(n, n)) * np.abs(a0).max(axis=1)[:, None] for _ in range(count)]
    b0, b = rng.normal(size=n), rng.normal(size=(count, n))
    terms = " + ".join([listed(a0), *(f"sin(q[{k + 1}])*{listed(part)}" for k, part in enumerate(parts))])
    right = " + ".join([listed(b0), *(f"q[{k + 1}]^2*{listed(row)}" for k, row in enumerate(b))])
    text = f"""
    agent Test() {{
      write real[{count}] q = zeros({count});
      write real[{n}] x = zeros({n});
      write real d = 0;
      let A = {terms};
      diff {{ q' = 0*q; x' = solve(A, {right}); d' = det(A); }}
    }}"""
    made = system(text)
    state = np.concatenate([q, np.zeros(n + 1)])
    a = a0 + sum(np.sin(v) * part for v, part in zip(q, parts, strict=True))
    x = np.linalg.solve(a, b0 + q**2 @ b)
    wanted = np.array([
        np.append(np.linalg.solve(a, 2 * v * row - np.cos(v) * part @ x), np.linalg.det(a) * np.trace(np.linalg.solve(a, np.cos(v) * part)))
        for v, part, row in zip(q, parts, b, strict=True)
    ]).T  # fmt: skip
    found = made.jacobian(0.0, state)[count:, :count]
    for row, expected in zip(found, wanted, strict=True):
        close(row, expected, 1e-9)
    close(made.rhs(0.0, state)[count:-1], x, 1e-10)


def test_derivatives_within_a_branch() -> None:
    """The matrix stands outside of the branch that solves with it."""
    text = """
    agent Test() {
      write real[4] x = [1, 2, 3, 4];
      let A = [[0, x[1], 0, 1], [2, 0, x[2], 0], [0, 3, 0, x[3]], [x[4], 0, 1, 0]];
      diff { x' = if x[1] > 0 then solve(A, x + [A[1,2], 0, 0, 0]) else det(A)*x; }
    }"""
    made = system(text)

    def direct(x: Floats) -> Floats:
        a = np.array([[0, x[0], 0, 1], [2, 0, x[1], 0], [0, 3, 0, x[2]], [x[3], 0, 1, 0]])
        return np.linalg.solve(a, x + np.array([a[0, 1], 0, 0, 0])) if x[0] > 0 else np.linalg.det(a) * x

    for sign in (1.0, -1.0):
        x = np.array([sign * 1.3, 0.4, -0.7, 2.1])
        h = 1e-4
        slope = np.array([(direct(x + h * e) - direct(x - h * e)) / (2 * h) for e in np.eye(4)]).T
        close(made.rhs(0.0, x), direct(x))
        close(made.jacobian(0.0, x), slope, 1e-6)


def test_systems_of_systems() -> None:
    """Each solution is the next right-hand side, two hundred times; nothing recurses along the way."""
    count = 200
    lets = "\n".join(f"let y{k} = solve(A, y{k - 1});" for k in range(1, count + 1))
    text = f"""
    agent Test() {{
      write real[4] x = zeros(4);
      let A = [[0, 1, 0, 0.1], [1, 0, 0, 0], [0.1, 0, 0, 1], [0, 0.1, 1, x[1]]];
      let y0 = x;
      {lets}
      diff {{ x' = y{count}; }}
    }}"""
    made = system(text)

    def direct(x: Floats) -> Floats:
        a = np.array([[0, 1, 0, 0.1], [1, 0, 0, 0], [0.1, 0, 0, 1], [0, 0.1, 1, x[0]]])
        return np.linalg.matrix_power(np.linalg.inv(a), count) @ x

    x, h = np.array([0.01, 0.3, -0.2, 0.5]), 1e-7
    slope = np.array([(direct(x + h * e) - direct(x - h * e)) / (2 * h) for e in np.eye(4)]).T
    close(made.rhs(0.0, x), direct(x), 1e-10)
    close(made.jacobian(0.0, x), slope, 1e-5)


# ---- what is shared and what is known --------------------------------------------------------


def body(text: str, role: str) -> str:
    """One function of the class of a generated module."""
    found = re.search(rf"^def Test_{role}\(.*?(?=^def |^# ----)", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found.group()


MATRIX = "[[0, x[1], 0, k], [2, 0, x[2], 0], [0, 3, 0, x[3]], [x[4], 0, 1, 0]]"


def test_one_matrix_is_factored_once() -> None:
    text = module(f"""
    agent Test(real k = 2) {{
      write real[4] x = [1, 2, 3, 4];
      let A = {MATRIX};
      diff {{ x' = solve(A, x) + solve(A, [1, 0, 0, k]) + inverse(A)*[1, 2, 3, 4] + det(A)*x; }}
    }}""")
    assert body(text, "rhs").count("linalg.factor(") == 1
    assert body(text, "rhs").count("linalg.substitute(") == 3
    assert body(text, "jac").count("linalg.factor(") == 1


def test_a_matrix_of_parameters_is_factored_once_a_run() -> None:
    """Its factors are kept among the values of the class."""
    text = f"""
    agent Test(real k = 2, real[4] c = [3, 0, 1, 2]) {{
      write real[4] x = [1, 2, 3, 4];
      diff {{ x' = solve({MATRIX.replace("x", "c")}, x) - k*x; }}
    }}"""
    generated = module(text)
    assert "linalg.factor(" in body(generated, "values")
    assert "linalg.factor(" not in body(generated, "rhs") + body(generated, "jac")
    for k, c in ((2.0, [3.0, 0.0, 1.0, 0.5]), (-1.5, [1.0, -1.0, 0.5, 1.0])):
        a = np.array([[0, c[0], 0, k], [2, 0, c[1], 0], [0, 3, 0, c[2]], [c[3], 0, 1, 0]])
        made = system(text, k=k, c=c)
        x = np.array([0.3, -0.2, 1.4, 0.8])
        close(made.rhs(0.0, x), np.linalg.solve(a, x) - k * x)
        close(made.jacobian(0.0, x), np.linalg.inv(a) - k * np.eye(4))


def test_numbers_are_solved_when_compiling() -> None:
    """Exactly: the unknowns of a Hilbert matrix, of which doubles know nothing, but for the rounding of its own entries."""
    n = 8
    hilbert = [[1.0 / (i + j + 1) for j in range(n)] for i in range(n)]
    text = f"""
    const real[{n}] c = solve({listed(np.array(hilbert))}, {listed(np.ones(n))});
    agent Test() {{
      write real[{n}] x = c;
      let d = det({listed(np.array(hilbert))});
      diff {{ x' = d*solve({listed(np.array(hilbert))}, {listed(np.ones(n))}); }}
    }}"""
    assert "linalg" not in module(text)
    found = system(text).initial(0.0)
    rows = [[Fraction(v) for v in row] for row in hilbert]
    residual = [sum(a * Fraction(float(x)) for a, x in zip(row, found, strict=True)) - 1 for row in rows]
    sizes_ = [sum(abs(a * Fraction(float(x))) for a, x in zip(row, found, strict=True)) for row in rows]
    assert all(abs(r) <= s * Fraction(2) ** -53 for r, s in zip(residual, sizes_, strict=True))
    assert exact.determinant((2.0, 1.0, 4.0, 2.0)) == 0.0


def test_a_singular_matrix_of_numbers_is_a_mistake() -> None:
    text = """
    agent Test() {
      write real[4] x = zeros(4);
      diff { x' = solve([[1, 2, 3, 4], [2, 4, 6, 8], [0, 1, 0, 0], [0, 0, 1, 0]], x); }
    }"""
    with pytest.raises(ModelError) as caught:
        module(text)
    assert [problem.code for problem in caught.value.problems] == ["E581"]
    assert "solve" in caught.value.problems[0].title()


@pytest.mark.parametrize("call", ["det(A)", "inverse(A)", "solve(A, b)", "solve(A, A)"])
def test_larger_matrices_are_refused(call: str) -> None:
    text = model_of(f"sum([sum({call})])" if call != "det(A)" else call, {"A": (13, 13), "b": (13,)}, ())
    with pytest.raises(ModelError) as caught:
        module(text)
    assert {problem.code for problem in caught.value.problems} == {"E312"}


# ---- runs ------------------------------------------------------------------------------------

TURNING = """
/// A matrix that turns, so that its largest entries stand in other rows all the time; its slow part comes from a level above.
agent Slow() {
  write real a = 0.3, r = 1;
  diff { a' = r; r' = -4*sin(a); }
}
agent Fast() {
  read real a;
  write real[4] x = [1, 0, -1, 0.5];
  let s = sin(5*a + time);
  let c = cos(5*a + time);
  let A = [[c, s, 0, 0.1], [-s, c, 0.2, 0], [0, 0.1, s, c], [0.1*%s, 0, -c, s]];
  diff { x' = -solve(A, A*A*x) + solve(A, [1, 0, 0, s]); }
}
agent Top() {
  level slow { agent slow = Slow(); }
  level fast { agent fast = Fast() [a := slow.a]; }
}
experiment e of Top() { stop = 5; rtol = 1e-9; atol = 1e-11; }
"""


def turning(t: float, y: Floats, own: bool) -> Floats:
    """The same by numpy."""
    a, r, *x = y
    s, c = np.sin(5 * a + t), np.cos(5 * a + t)
    m = np.array([[c, s, 0, 0.1], [-s, c, 0.2, 0], [0, 0.1, s, c], [0.1 * (x[0] if own else 1.0), 0, -c, s]])
    return np.array([r, -4 * np.sin(a), *(-m @ x + np.linalg.solve(m, [1, 0, 0, s]))])


@pytest.mark.parametrize("own", [False, True], ids=["of inputs", "of states"])
@pytest.mark.parametrize("method", ["auto", "radau13", "radau5", "dop853"])
def test_a_run(tmp_path: Path, method: str, own: bool) -> None:
    """Stages side by side in lanes exchange different rows; a matrix of inputs alone is factored outside of the iteration."""
    file = tmp_path / "turning.hier"
    file.write_text(TURNING % ("x[1]" if own else "1"))
    result = hierc.load(file).simulate(method=method)
    start = [0.3, 1.0, 1.0, 0.0, -1.0, 0.5]
    wanted = solve_ivp(turning, (0, 5), start, args=(own,), method="DOP853", rtol=1e-12, atol=1e-13).y[2:, -1]
    np.testing.assert_allclose(result["fast.x"][-1], wanted, rtol=0, atol=2e-7)


def test_a_matrix_that_becomes_singular_stops_the_run(tmp_path: Path) -> None:
    """At time 1, for good: the state and the line of its equation are named."""
    file = tmp_path / "singular.hier"
    file.write_text("""
agent Test() {
  write real[4] x = [1, 1, 1, 1];
  let g = max(1 - time, 0);
  let A = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, g], [0, 0, g, 0]];
  diff { x' = solve(A, [1, 1, 0, 1]); }
}
experiment e of Test() { stop = 3; }
""")
    with pytest.raises(hierc.SimulationError) as caught:
        hierc.load(file).simulate()
    assert 0.9 <= float(re.search(r"t = ([\d.]+)", str(caught.value)).group(1)) <= 1.001  # type: ignore[union-attr]
    assert "state `x[" in str(caught.value)
    assert "line 6" in str(caught.value)


def test_a_matrix_that_is_singular_from_the_start(tmp_path: Path) -> None:
    file = tmp_path / "singular.hier"
    file.write_text("""
agent Test() {
  write real[4] x = [0, 1, 1, 1];
  diff { x' = solve([[x[1], 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], [1, 0, 0, 0]); }
}
experiment e of Test() { stop = 3; }
""")
    with pytest.raises(hierc.SimulationError) as caught:
        hierc.load(file).simulate()
    assert "t = 0 s" in str(caught.value)
    assert "`x[1]`" in str(caught.value)
    assert "line 4" in str(caught.value)
