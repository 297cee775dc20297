"""The models of the gallery: their structure, and their equations against the mathematics written out with numpy."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import form, gallery, groups, node, reads
from interpreter import Interpreter

RANDOM = np.random.default_rng(20010401)


def test_cart_structure() -> None:
    model = gallery("cart")
    assert [n.path for n in model.nodes] == ["plan", "kin", "cart", "tail"]
    assert groups(model) == {"plan": ["plan"], "kin": ["kin"], "dyn": ["cart"], "chase": ["tail"]}
    assert [len(n.states) for n in model.nodes] == [2, 3, 7, 7]
    assert sorted(reads(model, "kin")) == ["plan.p[1]", "plan.p[1]'", "plan.p[2]", "plan.p[2]'"]
    assert sorted(reads(model, "cart")) == ["kin.om", "kin.th", "kin.v", "kin.x", "kin.y"]
    assert sorted(reads(model, "tail")) == ["cart.om", "cart.th", "cart.v", "cart.x", "cart.y"]
    assert model.experiment.settings.stop == 50.0
    assert model.experiment.settings.interval == 0.1
    assert model.experiment.save == ("figure8.csv",)
    assert [r for r in model.experiment.record if r.startswith("tail.")] == [
        f"tail.{name}" for name in ("x", "y", "th", "v", "om")
    ]
    assert not model.warnings


def test_two_carts_are_one_class() -> None:
    model = gallery("cart")
    assert form(node(model, "cart")) == form(node(model, "tail"))
    assert form(node(model, "cart")) != form(node(model, "kin"))


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def follow(
    state: np.ndarray, leader: np.ndarray, d: float, k: np.ndarray, kv: float, kt: float
) -> np.ndarray:
    """A cart of mass 10, inertia 1, wheel radius 0.1 and half track 0.25 with Kanayama's tracking law."""
    m, J, r, b = 10.0, 1.0, 0.1, 0.25
    position, th, v, om, torques = state[:2], state[2], state[3], state[4], state[5:]
    V, OM = leader[3:]
    target = leader[:2] - d * np.array([np.cos(leader[2]), np.sin(leader[2])])
    ex, ey = rotation(th) @ (target - position)
    et = leader[2] - th
    av = kv * (V * np.cos(et) + k[0] * ex - v)
    ao = kv * (OM + V * (k[1] * ey + k[2] * np.sin(et)) - om)
    wanted = r / 2 * np.array([m * av + J * ao / b, m * av - J * ao / b])
    return np.array([
        v * np.cos(th), v * np.sin(th), om,
        torques.sum() / (m * r) - 0.1 * v, b * (torques[0] - torques[1]) / (J * r) - 0.1 * om,
        *(kt * (wanted - torques)),
    ])  # fmt: skip


def cart_rates(t: float, y: np.ndarray) -> np.ndarray:
    """The four levels of the cart: figure eight, look-ahead kinematics, two carts."""
    w, look_ahead = 0.25, 0.3
    plan = np.array([np.cos(w * t), np.cos(2 * w * t)])
    x, th = y[2:4], y[4]
    nose = x + look_ahead * np.array([np.cos(th), np.sin(th)])
    v, sideways = rotation(th) @ (plan + 2.0 * (y[:2] - nose))
    om = sideways / look_ahead
    kin = np.array([v * np.cos(th), v * np.sin(th), om])
    cart = follow(y[5:12], np.array([*y[2:5], v, om]), 0.0, np.array([4.0, 10.0, 5.0]), 30.0, 150.0)
    tail = follow(y[12:], y[5:10], 1.0, np.array([8.0, 20.0, 10.0]), 80.0, 400.0)
    return np.concatenate([plan, kin, cart, tail])


def test_cart_equations() -> None:
    interpreter = Interpreter(gallery("cart"))
    start = interpreter.start()
    names = list(start)
    assert [start[n] for n in names] == [
        0, 0, -0.5, -0.3, 0.4, -0.6, -0.4, 0.3, 0, 0, 0, 0, -1.8, -0.9, 0.2, 0, 0, 0, 0,
    ]  # fmt: skip
    for _ in range(20):
        t, y = RANDOM.uniform(0, 50), RANDOM.normal(size=19)
        found = interpreter.rates(t, dict(zip(names, y, strict=True)))
        np.testing.assert_allclose([found[n] for n in names], cart_rates(t, y), rtol=1e-12, atol=1e-12)


def test_servo() -> None:
    model = gallery("servo")
    assert groups(model) == {"plan": ["plan"], "body": ["body"], "motor": ["motor"]}
    assert [n.template for n in model.nodes] == ["Servo.plan", "Servo.body", "Servo.motor"]
    assert reads(model, "body") == ["plan.r", "plan.r'"]
    assert reads(model, "motor") == ["body.tau"]
    assert [v.path for v in model.variables] == ["r", "q", "qd", "tau", "i"]
    wr, wn, J, kt = 2.0, 20.0, 0.1, 0.5
    t, r, q, qd, i = RANDOM.normal(size=5)
    rates = Interpreter(model).rates(t, {"plan.r": r, "body.q": q, "body.qd": qd, "motor.i": i})
    tau = J * (wn**2 * (r - q) + 2 * wn * (wr * np.cos(wr * t) - qd))
    expected = {
        "plan.r": wr * np.cos(wr * t),
        "body.q": qd,
        "body.qd": tau / J,
        "motor.i": (tau / kt - i) / 5e-4,
    }
    assert rates == pytest.approx(expected, rel=1e-13)


def arm_rates(
    t: float, p: np.ndarray, qk: np.ndarray, q: np.ndarray, qd: np.ndarray, i: np.ndarray
) -> np.ndarray:
    """Inverse kinematics, computed torque and motors of the two-link arm, with numpy's own solver."""
    lengths, m, g = np.array([0.7, 0.6]), np.array([4.0, 3.0]), 9.81
    pdot = 0.5 * np.array([-0.3 * np.sin(0.5 * t), 0.2 * np.cos(0.5 * t)])
    angles = np.cumsum(qk)
    tip = np.array([lengths @ np.cos(angles), lengths @ np.sin(angles)])
    columns = [[-(lengths[j:] @ np.sin(angles[j:])), lengths[j:] @ np.cos(angles[j:])] for j in range(2)]
    qk_rate = np.linalg.solve(np.array(columns).T, pdot + 5 * (p - tip))
    c = m[1] * lengths[0] * lengths[1]
    side = m[1] * lengths[1] ** 2 + c * np.cos(q[1])
    M = np.array([
        [m.sum() * lengths[0] ** 2 + m[1] * lengths[1] ** 2 + 2 * c * np.cos(q[1]), side],
        [side, m[1] * lengths[1] ** 2],
    ])  # fmt: skip
    h = c * np.sin(q[1]) * np.array([-qd[1] * (2 * qd[0] + qd[1]), qd[0] ** 2])
    far = m[1] * lengths[1] * np.cos(q.sum())
    G = g * np.array([m.sum() * lengths[0] * np.cos(q[0]) + far, far])
    tau = M @ (900 * (qk - q) + 60 * (qk_rate - qd)) + h + G
    motor = (tau / np.array([1.2, 0.8]) - i) / 5e-4
    return np.concatenate([pdot, qk_rate, qd, np.linalg.solve(M, tau - h - G), motor])


def test_arm() -> None:
    model = gallery("arm")
    assert groups(model) == {"plan": ["plan"], "ik": ["ik"], "body": ["arm"], "motor": ["mot"]}
    assert dict(model.experiment.groups)["motor"].max_step == 2e-4
    assert [w.code for w in model.warnings] == ["W010"]
    interpreter = Interpreter(model)
    names = list(interpreter.start())
    for _ in range(20):
        t, y = RANDOM.uniform(0, 10), RANDOM.normal(size=10)
        y[3] = RANDOM.uniform(0.5, 2.5)  # the pose is not singular
        found = interpreter.rates(t, dict(zip(names, y, strict=True)))
        expected = arm_rates(t, y[:2], y[2:4], y[4:6], y[6:8], y[8:])
        np.testing.assert_allclose([found[n] for n in names], expected, rtol=1e-9, atol=1e-9)
