"""A planar arm of up to twelve links with its full mass matrix: equations, Jacobian, energy, and the size of its code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from texts import Floats, module, system

import hierc

ARM = """
/// n links in a row, absolute angles, no friction.
agent Arm(int n = 4, real m [kg] = 1, real l [m] = 0.5, real g [m/s^2] = 9.81) {
  write real[n] q [rad] = [0.3*i for i in 1..n];
  write real[n] w [rad/s] = zeros(n);
  let M = [[m*l^2*(n + 1 - max(i, j))*cos(q[i] - q[j]) for j in 1..n] for i in 1..n];
  let h = [sum([m*l^2*(n + 1 - max(i, j))*sin(q[i] - q[j])*w[j]^2 for j in 1..n]) for i in 1..n];
  let f = [-m*g*l*(n + 1 - i)*sin(q[i]) for i in 1..n];
  diff { q' = w; w' = solve(M, f - h); }
}
experiment swing of Arm() { stop = 2 [s]; rtol = 1e-9; atol = 1e-11; }
"""
M, L, G = 1.0, 0.5, 9.81


def text_of(n: int) -> str:
    return ARM.replace("int n = 4", f"int n = {n}")


def mass(q: Floats) -> Floats:
    """The mass matrix, from the positions of the point masses at the ends of the links."""
    n = len(q)
    total = np.zeros((n, n))
    for body in range(n):
        along = np.zeros((2, n))  # d position / d angles
        along[:, : body + 1] = L * np.array([np.cos(q[: body + 1]), np.sin(q[: body + 1])])
        total += M * along.T @ along
    return total


def energy(q: Floats, w: Floats) -> float:
    heights = -L * np.cumsum(np.cos(q))
    return float(0.5 * w @ mass(q) @ w + M * G * heights.sum())


def accelerations(q: Floats, w: Floats) -> Floats:
    """By Lagrange's equations, the derivatives of the mass matrix and of the potential by differences of the energy's own formula."""
    n, h = len(q), 1e-5
    units = np.eye(n)
    slope = [(mass(q + h * e) - mass(q - h * e)) / (2 * h) for e in units]
    rates = sum(s * v for s, v in zip(slope, w, strict=True))
    still = np.zeros(n)
    potential = [(energy(q + h * e, still) - energy(q - h * e, still)) / (2 * h) for e in units]
    force = np.array([0.5 * w @ s @ w for s in slope]) - rates @ w - potential
    return np.linalg.solve(mass(q), force)


@pytest.mark.parametrize("n", [2, 4, 8, 12])
def test_equations_and_jacobian(n: int) -> None:
    rng = np.random.default_rng(n)
    made = system(text_of(n))
    x = np.concatenate([rng.uniform(-1.5, 1.5, n), rng.uniform(-1, 1, n)])
    wanted = accelerations(x[:n], x[n:])
    np.testing.assert_allclose(made.rhs(0.0, x)[n:], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())
    h = 1e-6
    slope = np.array(
        [(made.rhs(0.0, x + h * e) - made.rhs(0.0, x - h * e)) / (2 * h) for e in np.eye(2 * n)]
    ).T
    np.testing.assert_allclose(made.jacobian(0.0, x), slope, rtol=0, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("n", [4, 12])
def test_a_swing_keeps_its_energy(tmp_path: Path, n: int) -> None:
    file = tmp_path / "arm.hier"
    file.write_text(text_of(n))
    result = hierc.load(file).simulate()
    levels = [energy(q, w) for q, w in zip(result["q"], result["w"], strict=True)]
    kinetic = max(0.5 * w @ mass(q) @ w for q, w in zip(result["q"], result["w"], strict=True))
    assert kinetic > 1.0
    assert max(abs(level - levels[0]) for level in levels) < 1e-6 * kinetic


def test_the_text_of_the_largest_arm_stays_readable() -> None:
    """The Jacobian of a 12x12 system by 24 states is one factorisation and a substitution for each column."""
    text = module(text_of(12))
    assert text.count("linalg.factor(") == 2
    assert text.count("linalg.substitute(") == 1 + 1 + 24
    assert len(text.splitlines()) < 2500
