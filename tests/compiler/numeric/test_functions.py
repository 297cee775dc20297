"""Functions and operators on vectors and matrices of sizes 1 to 5, compiled, against numpy: values, and derivatives against differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from texts import Floats, differences, model_of, rates, system

FUNCTIONS = """
func real[n] doubled(real[n] x) = [2*x[i] for i in 1..n];
func real[n,m] scaled(real[n,m] A, real k) = [[k*A[i,j] for j in 1..m] for i in 1..n];
func real quadratic(real[n,n] A, real[n] x) = dot(x, A*x);
func real[m,n] flipped(real[n,m] A) = transpose(A);
func real[n] row(real[n,n] A, int i) = [A[i,j] for j in 1..n];
func real cosine(real[n] x, real[n] y) = dot(x, y)/(norm(x)*norm(y));
"""
#: Shapes by the sizes n, m and k that a case is drawn with.
Shapes = Callable[[int, int, int], dict[str, tuple[int, ...]]]


def square(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"A": (n, n), "x": (n,)}


def vectors(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"x": (n,), "y": (n,)}


def matrices(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"A": (n, m), "B": (n, m), "s": ()}


def chain(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"A": (n, m), "B": (m, k), "x": (m,)}


def pair(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"A": (n, n), "B": (n, m)}


def numbers(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"a": (), "b": (), "c": ()}


def three(n: int, m: int, k: int) -> dict[str, tuple[int, ...]]:
    return {"x": (3,), "y": (3,)}


@dataclass(frozen=True)
class Case:
    """An expression, and what it is in numpy. `{n}`, `{m}`, `{k}` stand for the sizes."""

    text: str
    shapes: Shapes
    numpy: Callable[..., Floats]


def smooth_round(a: Floats) -> Floats:
    """Half away from zero."""
    return np.copysign(np.floor(np.abs(a) + 0.5), a)


CASES = [
    Case("A + B", matrices, lambda A, B, s: A + B),
    Case("A - B", matrices, lambda A, B, s: A - B),
    Case("-A", matrices, lambda A, B, s: -A),
    Case("s*A", matrices, lambda A, B, s: s * A),
    Case("A*s", matrices, lambda A, B, s: A * s),
    Case("A/s", matrices, lambda A, B, s: A / s),
    Case("A .* B", matrices, lambda A, B, s: A * B),
    Case("A ./ B", matrices, lambda A, B, s: A / B),
    Case("transpose(A)", matrices, lambda A, B, s: A.T),
    Case("[sum(A), min(B), max(A)]", matrices, lambda A, B, s: np.array([A.sum(), B.min(), A.max()])),
    Case("A*B", chain, lambda A, B, x: A @ B),
    Case("A*x", chain, lambda A, B, x: A @ x),
    Case("A*B*transpose(B)*x", chain, lambda A, B, x: A @ B @ B.T @ x),
    Case("A*x - x", square, lambda A, x: A @ x - x),
    Case("transpose(A)*x", square, lambda A, x: A.T @ x),
    Case("det(A)", square, lambda A, x: np.linalg.det(A)),
    Case("trace(A)", square, lambda A, x: np.trace(A)),
    Case("inverse(A)", square, lambda A, x: np.linalg.inv(A)),
    Case("solve(A, x)", square, np.linalg.solve),
    Case("solve(A, solve(transpose(A), x))", square, lambda A, x: np.linalg.solve(A, np.linalg.solve(A.T, x))),
    Case("inverse(A)*x - solve(A, 2*x)", square, lambda A, x: -np.linalg.solve(A, x)),
    Case("solve(A, B)", pair, np.linalg.solve),
    Case("A*eye({n}) + eye({n})", square, lambda A, x: A + np.eye(len(x))),
    Case("x + zeros({n})", square, lambda A, x: x),
    Case("A - zeros({n}, {n})", square, lambda A, x: A),
    Case("quadratic(A, x)", square, lambda A, x: x @ A @ x),
    Case("row(A, {n})", square, lambda A, x: A[-1]),
    Case("A[{n},1..{n}]", square, lambda A, x: A[-1]),
    Case("A[1..{n},{n}]", square, lambda A, x: A[:, -1]),
    Case("A[1..{n},{n}..{n}]", square, lambda A, x: A[:, -1:]),
    Case("A[1,1..{n}] + A[1..{n},1]", square, lambda A, x: A[0] + A[:, 0]),
    Case("x[1..{n}] + x[1]*x", square, lambda A, x: x + x[0] * x),
    Case("[[A[j,i] for j in 1..{n}] for i in 1..{n}]", square, lambda A, x: A.T),
    Case("[dot([A[i,j] for j in 1..{n}], x) for i in 1..{n}]", square, lambda A, x: A @ x),
    Case("[x[i]^2 + i for i in 1..{n}]", square, lambda A, x: x**2 + np.arange(1, len(x) + 1)),
    Case("[sum([A[i,j]*x[j] for j in 1..i]) for i in 1..{n}]", square, lambda A, x: np.tril(A) @ x),
    Case("[[if i == j then x[i] else A[i,j] for j in 1..{n}] for i in 1..{n}]",
         square, lambda A, x: A - np.diag(np.diag(A)) + np.diag(x)),
    Case("[[1, x[1]], [A[1,1], time]]", square, lambda A, x: np.array([[1, x[0]], [A[0, 0], 0.5]])),
    Case("dot(x, y)", vectors, lambda x, y: x @ y),
    Case("norm(x)", vectors, lambda x, y: np.linalg.norm(x)),
    Case("norm(x - y)*x", vectors, lambda x, y: np.linalg.norm(x - y) * x),
    Case("x .* y - x ./ y", vectors, lambda x, y: x * y - x / y),
    Case("doubled(x + y)", vectors, lambda x, y: 2 * (x + y)),
    Case("cosine(x, y)", vectors, lambda x, y: x @ y / np.linalg.norm(x) / np.linalg.norm(y)),
    Case("[min(x), max(x), min(x[1], y[1]), max(x[1], y[1], 0.5)]", vectors,
         lambda x, y: np.array([x.min(), x.max(), min(x[0], y[0]), max(x[0], y[0], 0.5)])),
    Case("[sum(x), sum(x[1..1]), sum([x[i] for i in 1..0])]", vectors, lambda x, y: np.array([x.sum(), x[0], 0])),
    Case("if x[1] > y[1] then x else 2*y", vectors, lambda x, y: x if x[0] > y[0] else 2 * y),
    Case("scaled(A, s) + transpose(flipped(B))", matrices, lambda A, B, s: s * A + B),
    Case("cross(x, y)", three, np.cross),
    Case("cross(x, cross(x, y)) + dot(x, y)*y", three, lambda x, y: np.cross(x, np.cross(x, y)) + x @ y * y),
    Case("abs(a)*sign(b)", numbers, lambda a, b, c: np.abs(a) * np.sign(b)),
    Case("sqrt(abs(a)) + exp(b) + log(abs(c)) + log10(abs(a))", numbers,
         lambda a, b, c: np.sqrt(abs(a)) + np.exp(b) + np.log(abs(c)) + np.log10(abs(a))),
    Case("sin(a) + cos(b) + tan(c/4)", numbers, lambda a, b, c: np.sin(a) + np.cos(b) + np.tan(c / 4)),
    Case("asin(tanh(a)) + acos(tanh(b)) + atan(c)", numbers,
         lambda a, b, c: np.arcsin(np.tanh(a)) + np.arccos(np.tanh(b)) + np.arctan(c)),
    Case("atan2(a, b) + sinh(b)*cosh(c)", numbers, lambda a, b, c: np.arctan2(a, b) + np.sinh(b) * np.cosh(c)),
    Case("floor(3*a) + 2*ceil(3*b) + 4*round(3*c)", numbers,
         lambda a, b, c: np.floor(3 * a) + 2 * np.ceil(3 * b) + 4 * smooth_round(3 * c)),
    Case("mod(a, b)", numbers, lambda a, b, c: np.mod(a, b)),
    Case("clamp(a, -1, abs(b))", numbers, lambda a, b, c: np.clip(a, -1, np.abs(b))),
    Case("abs(a)^b + a^3 - b^-2 + abs(c)^0.5", numbers, lambda a, b, c: np.abs(a) ** b + a**3 - b**-2.0 + np.abs(c) ** 0.5),
    Case("div(7, n) + mod(-7, n)*a", numbers, lambda a, b, c: 2 + 2 * a),
    Case("smooth(a)*k", numbers, lambda a, b, c: 0.75 * a),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.text)
@settings(max_examples=12, deadline=None)
@given(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_against_numpy(case: Case, n: int, m: int, k: int, seed: int) -> None:
    shapes = case.shapes(n, m, k)
    values = drawn(np.random.default_rng(seed), shapes)
    wanted = np.asarray(case.numpy(*values.values()), np.float64)
    text = model_of(case.text.format(n=n, m=m, k=k), shapes, wanted.shape, FUNCTIONS)
    found, jacobian = rates(text, values, wanted.shape)
    scale = 1.0 + np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * scale)
    slope = differences(case.numpy, values)
    np.testing.assert_allclose(jacobian, slope, rtol=0, atol=1e-7 * (1.0 + np.abs(slope).max()))


def drawn(rng: np.random.Generator, shapes: dict[str, tuple[int, ...]]) -> dict[str, Floats]:
    """Values of different sizes, away from the kinks of the functions; square matrices are well conditioned."""
    total = sum(int(np.prod(shape)) for shape in shapes.values())
    sizes = 0.55 + 0.35 * (rng.permutation(total) + 0.5) / total + 0.004 * rng.uniform(-1, 1)
    packed = iter(sizes * rng.choice([-1.0, 1.0], total))
    values = {
        name: np.array([next(packed) for _ in range(int(np.prod(s)))]).reshape(s)
        for name, s in shapes.items()
    }
    for name, value in values.items():
        if value.ndim == 2 and value.shape[0] == value.shape[1]:
            values[name] = 0.25 * value + np.eye(len(value))[rng.permutation(len(value))]
    return values


@settings(max_examples=10, deadline=None)
@given(st.integers(3, 6), st.integers(0, 2**32 - 1))
def test_equations_element_by_element(n: int, seed: int) -> None:
    """`for`, slices and single elements on the left, `for` in algebraic equations: a rod that is heated at one end."""
    text = f"""
    agent Rod(real k = 0.7) {{
      write real[{n}] T = zeros({n});
      write real[{n},2] E = zeros({n}, 2);
      write real[{n - 1}] flow;
      alge {{ for i in 1..{n - 1} {{ flow[i] = k*(T[i] - T[i + 1]); }} }}
      diff {{
        T[1]' = 1 - flow[1];
        for i in 2..{n - 1} {{ T[i]' = flow[i - 1] - flow[i]; }}
        T[{n}]' = flow[{n - 1}] - T[{n}];
        E[1..{n},1]' = T;
        for i in 1..{n} {{ E[i,2]' = i*E[i,1]; }}
      }}
    }}"""
    x = np.random.default_rng(seed).normal(size=3 * n)
    t, e = x[:n], x[n:].reshape(n, 2)
    between = 0.7 * (t[:-1] - t[1:])
    wanted = np.concatenate([[1 - between[0]], between[:-1] - between[1:], [between[-1] - t[-1]]])
    energy = np.stack([t, np.arange(1, n + 1) * e[:, 0]], axis=1)
    np.testing.assert_allclose(system(text).rhs(0.0, x), [*wanted, *energy.ravel()], rtol=0, atol=1e-14)
