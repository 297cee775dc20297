"""The four-level cart against its mathematics written down independently, with numpy, and integrated by scipy."""

import math

import numpy as np
import pytest
from hand import CART, TAIL, cart4
from oracle import Interpreter, System, generate, ulps
from scipy.integrate import solve_ivp


def follower(target, z, kx, ky, kt, kv, ktau):
    """Level 3 and 4 of the cart."""
    X, Y, TH, V, OM = target
    x, y, th, v, om, tR, tL = z
    m, J, r, b = 10.0, 1.0, 0.1, 0.25
    ex = np.cos(th) * (X - x) + np.sin(th) * (Y - y)
    ey = -np.sin(th) * (X - x) + np.cos(th) * (Y - y)
    et = TH - th
    vc = V * np.cos(et) + kx * ex
    oc = OM + V * (ky * ey + kt * np.sin(et))
    av, ao = kv * (vc - v), kv * (oc - om)
    right, left = r / 2 * (m * av + J * ao / b), r / 2 * (m * av - J * ao / b)
    return [
        v * np.cos(th),
        v * np.sin(th),
        om,
        (tR + tL) / (m * r) - 0.1 * v,
        b * (tR - tL) / (J * r) - 0.1 * om,
        ktau * (right - tR),
        ktau * (left - tL),
    ]


def p1(t, z):
    """The whole cart, 19 states."""
    w, L, k1 = 0.25, 0.3, 2.0
    x1, y1, x2, y2, th2 = z[:5]
    dx1, dy1 = np.cos(w * t), np.cos(2 * w * t)
    wx = dx1 + k1 * (x1 - (x2 + L * np.cos(th2)))
    wy = dy1 + k1 * (y1 - (y2 + L * np.sin(th2)))
    v2 = np.cos(th2) * wx + np.sin(th2) * wy
    om2 = (np.cos(th2) * wy - np.sin(th2) * wx) / L
    three = z[5:12]
    ahead = (three[0] - np.cos(three[2]), three[1] - np.sin(three[2]), three[2], three[3], three[4])
    third = follower((x2, y2, th2, v2, om2), three, 4, 10, 5, 30, 150)
    fourth = follower(ahead, z[12:], 8, 20, 10, 80, 400)
    return np.array([dx1, dy1, v2 * np.cos(th2), v2 * np.sin(th2), om2, *third, *fourth])


START = np.array(
    [0, 0, -0.5, -0.3, 0.4, -0.6, -0.4, 0.3, 0, 0, 0, 0, -1.8, -0.9, 0.2, 0, 0, 0, 0], dtype=float
)


@pytest.fixture(scope="module")
def system():
    return System(generate(cart4()))


def test_right_hand_sides_are_the_mathematics(system):
    rng = np.random.default_rng(1)
    for _ in range(200):
        t, z = rng.uniform(0, 50), rng.normal(size=19)
        expected = p1(t, z)
        # Terms of size 1e4 cancel in the torque loops: the scale is the largest rate.
        np.testing.assert_allclose(
            system.flat(t, z), expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max()
        )


def test_initial_values(system):
    assert np.concatenate(system.initial()) == pytest.approx(START, abs=0)


def test_the_interpreter_agrees_to_a_few_ulps(system):
    rng = np.random.default_rng(2)
    model = cart4()
    for _ in range(50):
        t = rng.uniform(0, 50)
        states = [[float(v) for v in rng.normal(size=len(node.states))] for node in model.nodes]
        plain = Interpreter(model, t, states, system.q)
        for n in range(4):
            for ours, theirs in zip(system.rates(t, states, n), plain.rates(n), strict=True):
                assert ulps(ours, theirs) <= 2
        v, om = (plain.source(s.elements[0]) for s in model.variables if s.path in ("kin.v", "kin.om"))
        assert [ulps(*pair) <= 2 for pair in zip(system.observed(t, states, 1), (v, om), strict=True)] == [
            True
        ] * 2


def test_scipy_reproduces_the_independent_solution(system):
    options = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-10, "t_eval": [2.0, 6.0, 10.0]}
    ours = solve_ivp(system.flat, (0, 10), START, **options)
    theirs = solve_ivp(p1, (0, 10), START, **options)
    assert ours.success
    np.testing.assert_allclose(ours.y, theirs.y, rtol=1e-5, atol=1e-6)


def test_parameters_are_run_time(system):
    changed = dict(zip((f"cart.{k}" for k in CART), TAIL.values(), strict=True))
    entries = {p.path: p.first for p in system.plan.parameters}
    other = System(generate(cart4()), {entries[path]: value for path, value in changed.items()})
    z = np.random.default_rng(3).normal(size=19)
    ahead = (z[2] - np.cos(z[4]), z[3] - np.sin(z[4]), z[4], p1(1.0, z)[2:5])
    th2 = z[4]
    v2, om2 = math.hypot(*ahead[3][:2]) * np.sign(ahead[3][0] * np.cos(th2)), ahead[3][2]
    expected = follower((ahead[0], ahead[1], th2, v2, om2), z[5:12], 8, 20, 10, 80, 400)
    np.testing.assert_allclose(other.flat(1.0, z)[5:12], expected, rtol=1e-10, atol=1e-9)


def test_cart_and_tail_share_a_class(system):
    assert [node.kind for node in system.plan.nodes] == [0, 1, 2, 2]
    assert [c.name for c in system.plan.classes] == ["Planner", "Unicycle", "DynamicCart"]


def test_sizes(system):
    planner, unicycle, cart = system.plan.classes
    assert (planner.outs, unicycle.outs, cart.outs) == (2, 2, 0)  # of the cart only states are read
    assert unicycle.parts[0].inputs == (0, 1, 2, 3)
    assert planner.parts[0].inputs == ()
    # The same mathematics by hand: about 60 operations and 6 elementary functions for level 3 with its offset d.
    assert cart.flops <= 6 * 20 + 60
    assert cart.lines == (6, 7, 8, 9, 10, 11, 12)
    assert system.plan.start_passes == 1


def test_calls_of_a_cascade_are_right_hand_sides_only(system):
    assert [g.calls for g in system.plan.groups] == [((n, -1),) for n in range(4)]
