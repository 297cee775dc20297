"""Expressions: vectors, matrices, functions and literals against numpy."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from helpers import model_of
from hypothesis import given
from hypothesis import strategies as st
from interpreter import Interpreter

from hierc.compiler.collector import Rejected
from hierc.compiler.units.units import literal_in_si, parse_unit
from hierc.grammar import tree
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile, Span

A = np.array([[2.0, -1.0, 0.5], [0.3, 1.7, -0.4], [1.1, 0.2, -2.2]])
B = np.array([[0.5, 2.0, 1.0], [-1.0, 0.7, 0.1], [0.4, -0.6, 1.9]])
V = np.array([1.5, -0.7, 2.25])
W = np.array([0.3, 0.9, -1.6])
PRELUDE = """
func real[n] twice(real[n] x) = [2*x[i] for i in 1..n];
func real[m,n] scaled(real[m,n] x, real k) = k*x;
func real third(real[3] x) = x[3];
func real element(real[3] x, int i) = x[i];
"""


def value_of(expression: str, shape: str) -> np.ndarray:
    """The value of an expression over states A, B, V, W, s and n = 3, as an agent's algebraic variable."""
    text = f"""{PRELUDE}
    agent Test(int n = 3) {{
      write real[3,3] A = zeros(3, 3), B = zeros(3, 3);
      write real[3] V = zeros(3), W = zeros(3);
      write real s = 0;
      write real{shape} result;
      diff {{ A' = 0*A; B' = 0*B; V' = 0*V; W' = 0*W; s' = 0; }}
      alge {{ result = {expression}; }}
    }}
    """
    model = model_of(text)
    interpreter = Interpreter(model)
    names = list(interpreter.start())
    interpreter.set(0.25, dict(zip(names, [*A.flat, *B.flat, *V, *W, 0.625], strict=True)))
    return np.array(interpreter.variable("result"))


S = 0.625
CASES = {
    "A + B": A + B, "A - B": A - B, "A*B": A @ B, "A*V": A @ V, "s*A": S * A, "A*s": A * S, "A/s": A / S,
    "A .* B": A * B, "A ./ B": A / B, "V .* W": V * W, "V ./ W": V / W, "-V": -V, "+V": V,
    "dot(V, W)": V @ W, "cross(V, W)": np.cross(V, W), "norm(V)": np.linalg.norm(V), "transpose(A)": A.T,
    "det(A)": np.linalg.det(A), "det(A[1..2,2..3])": np.linalg.det(A[:2, 1:]), "inverse(A)": np.linalg.inv(A),
    "inverse(A[1..2,1..2])": np.linalg.inv(A[:2, :2]), "solve(A, V)": np.linalg.solve(A, V), "solve(A, B)": np.linalg.solve(A, B),
    "solve(A[2..3,2..3], V[1..2])": np.linalg.solve(A[1:, 1:], V[:2]), "solve([[s]], [2])": [2 / S],
    "inverse([[s]])": [[1 / S]], "trace(A)": np.trace(A), "eye(3)": np.eye(3), "zeros(2)": np.zeros(2), "zeros(2, 3)": np.zeros((2, 3)),
    "sum(V)": V.sum(), "sum(A)": A.sum(), "sum([i for i in 1..n])": 6, "sum([i for i in 2..1])": 0, "min(V)": V.min(), "max(V, W)": None,
    "max(s, 1, 0.5)": 1, "min(s, 1)": S, "abs(V[2])": 0.7, "sign(V[2])": -1, "sqrt(s)": math.sqrt(S), "exp(s)": math.exp(S),
    "log(s)": math.log(S), "log10(s)": math.log10(S), "sin(s)": math.sin(S), "cos(s)": math.cos(S), "tan(s)": math.tan(S),
    "asin(s)": math.asin(S), "acos(s)": math.acos(S), "atan(s)": math.atan(S), "atan2(s, -2)": math.atan2(S, -2),
    "sinh(s)": math.sinh(S), "cosh(s)": math.cosh(S), "tanh(s)": math.tanh(S), "floor(-s)": -1, "ceil(s)": 1, "round(s)": 1,
    "mod(-s, 0.5)": 0.375, "div(7, 2)": 3, "mod(7, 3)": 1, "7/2": 3.5, "clamp(s, 0, 0.5)": 0.5, "clamp(s, 0.7, 2)": 0.7, "smooth(s)": S,
    "[V[1], s]": [1.5, S], "[[1, s], [2, 3]]": [[1, S], [2, 3]], "[i*V[i] for i in 1..n]": V * [1, 2, 3],
    "[[A[j,i] for i in 1..3] for j in 2..3]": A[1:], "A[2,1..3]": A[1], "A[1..3,3]": A[:, 2], "V[2..3]": V[1:], "A[2,3]": A[1, 2],
    "twice(V)": 2 * V, "twice(V[1..2])": 2 * V[:2], "scaled(A, s)": S * A, "third(A*V)": (A @ V)[2], "element(V, n - 1)": V[1],
    "2^-1": 0.5, "s^2": S**2, "-s^2": -(S**2), "2^3^2": 512, "time + pi": 0.25 + math.pi, "1 - 2 - 3": -4, "2/4/8": 0.0625,
    "if s > 1 then V else W": W, "if s > 1 or not (s < 0) and true then 1 else 2": 1, "if s == 1 then 1 else if s != 1 then 2 else 3": 2,
    "if s >= 0.625 and s <= 0.625 then 1 else 0": 1, "V*s + s*W - 2*V": V * S + S * W - 2 * V,
}  # fmt: skip


@pytest.mark.parametrize("expression", [e for e, expected in CASES.items() if expected is not None])
def test_against_numpy(expression: str) -> None:
    expected = np.array(CASES[expression], dtype=float)
    shape = f"[{','.join(map(str, expected.shape))}]" if expected.shape else ""
    np.testing.assert_allclose(value_of(expression, shape), expected.ravel(), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize(
    "expression",
    ["max(V, W)", "V*W", "A + V", "s + V", "A^2", "V == W", "twice(A)", "scaled(V, 1)", "V[1,2]"],
)
def test_shapes_that_do_not_fit(expression: str) -> None:
    with pytest.raises(ModelError):
        value_of(expression, "[3]")


# ---- literals and units --------------------------------------------------------------------------


def literal(text: str, unit: str) -> float:
    source = SourceFile("test", f"{text} [{unit}]")
    span = Span(source, 0, len(source.text))
    return literal_in_si(tree.Number(span, text, float(text), text.isdigit(), tree.Unit(span, unit)))


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("0.5", "ms", 5e-4), ("0.2", "ms", 2e-4), ("0.1", "mm", 1e-4), ("3", "%", 0.03), ("90", "deg", math.pi / 2), ("60", "rpm", 2 * math.pi),
        ("1", "h", 3600.0), ("1.5", "min", 90.0), ("7", "kN*m", 7000.0), ("1", "g/cm^3", 1000.0), ("36", "km/h", 10.0), ("100", "Hz", 100.0),
        ("1", "mohm", 1e-3), ("2", "kΩ", 2000.0), ("5", "µs", 5e-6), ("1", "1/(ms*mm)", 1e6), ("2", "mm^0.5", 2 * math.sqrt(1e-3)), ("0", "km", 0.0),
        ("4", "N/m^1.5", 4.0), ("1", "mm^-1", 1000.0),
    ],
)  # fmt: skip
def test_literals_with_units(text: str, unit: str, expected: float) -> None:
    assert literal(text, unit) == expected


@given(st.floats(min_value=1e-300, max_value=1e290))
def test_literals_are_rounded_once(value: float) -> None:
    assert literal(repr(value), "ms") == float(Fraction(repr(value)) / 1000)
    assert literal(repr(value), "km") == float(Fraction(repr(value)) * 1000)


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [("N", (1, 1, -2, 0, 0, 0, 0)), ("V*s/rad", (2, 1, -2, -1, 0, 0, 0)), ("kat*K/cd", (0, 0, -1, 0, 1, 1, -1)), ("m/s/s", (1, 0, -2, 0, 0, 0, 0))],
)  # fmt: skip
def test_dimensions(unit: str, exponents: tuple[int, ...]) -> None:
    span = Span(SourceFile("test", unit), 0, len(unit))
    assert tuple(map(int, parse_unit(unit, span).exponents)) == exponents


@pytest.mark.parametrize(
    "unit", ["Nm", "m^", "m*", "(m", "m)", "m^99", "2", "m m", "", "kh", "mmin", "m^1e9", "*" * 500]
)
def test_units_that_are_none(unit: str) -> None:
    span = Span(SourceFile("test", unit), 0, len(unit))
    with pytest.raises(Rejected):
        parse_unit(unit, span)
