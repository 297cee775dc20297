"""The interpreter itself, against mathematics written out by hand with numpy."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import pint
import pytest
from plain import si
from plain.interpreter import Circular, Interpreter

from hierc.grammar.parser import parse
from hierc.grammar.source import SourceFile

RANDOM = np.random.default_rng(20010402)


def interpreter(text: str, run: str = "Top", params: Mapping[str, object] | None = None) -> Interpreter:
    return Interpreter(parse(SourceFile("test.hier", text)), run, params)


def gallery(name: str, run: str) -> Interpreter:
    return interpreter(files("hierc.models").joinpath(f"{name}.hier").read_text(encoding="utf-8"), run)


def states(model: Interpreter) -> dict[str, Any]:
    """Random values for all states."""
    return {path: RANDOM.normal(size=np.shape(value)) for path, value in model.initial().items()}


# ---- the cart -------------------------------------------------------------------------------------------------------------------


def cart(
    goal: Mapping[str, float], own: Mapping[str, Any], k: tuple[float, ...], kv: float, kt: float
) -> dict[str, Any]:
    """A cart (m=10, J=1, r=0.1, b=0.25) that follows X, Y, TH, V, OM by Kanayama's law with torque loops."""
    x, y, th, v, om, (right, left) = (own[n] for n in ("x", "y", "th", "v", "om", "tau"))
    ex = np.cos(th) * (goal["X"] - x) + np.sin(th) * (goal["Y"] - y)
    ey = -np.sin(th) * (goal["X"] - x) + np.cos(th) * (goal["Y"] - y)
    et = goal["TH"] - th
    av = kv * (goal["V"] * np.cos(et) + k[0] * ex - v)
    ao = kv * (goal["OM"] + goal["V"] * (k[1] * ey + k[2] * np.sin(et)) - om)
    torques = 0.05 * np.array([10 * av + ao / 0.25, 10 * av - ao / 0.25])
    return {
        "x": v * np.cos(th), "y": v * np.sin(th), "th": om,
        "v": right + left - 0.1 * v, "om": 2.5 * (right - left) - 0.1 * om,
        "tau": kt * (torques - [right, left]),
    }  # fmt: skip


def test_cart() -> None:
    model = gallery("cart", "figure8")
    start = model.initial()
    assert [start[f"tail.{n}"] for n in ("x", "y", "th", "v", "om")] == [-1.8, -0.9, 0.2, 0, 0]
    assert start["kin.th"] == 0.4
    for _ in range(10):
        t, at = float(RANDOM.uniform(0, 50)), states(model)
        found = model.rates(t, at)
        plan = np.array([np.cos(0.25 * t), np.cos(0.5 * t)])
        assert found["plan.p"] == pytest.approx(plan, rel=1e-13)
        th = at["kin.th"]
        toward = plan + 2 * (at["plan.p"] - [at["kin.x"] + 0.3 * np.cos(th), at["kin.y"] + 0.3 * np.sin(th)])
        v = np.cos(th) * toward[0] + np.sin(th) * toward[1]
        om = (np.cos(th) * toward[1] - np.sin(th) * toward[0]) / 0.3
        kin = {"kin.x": v * np.cos(th), "kin.y": v * np.sin(th), "kin.th": om}
        assert {k: found[k] for k in kin} == pytest.approx(kin, rel=1e-12)
        own = {
            name: {p.partition(".")[2]: x for p, x in at.items() if p.startswith(name)}
            for name in ("cart", "tail")
        }
        goal = {"X": at["kin.x"], "Y": at["kin.y"], "TH": th, "V": v, "OM": om}
        ahead = own["cart"]
        behind = {
            "X": ahead["x"] - np.cos(ahead["th"]), "Y": ahead["y"] - np.sin(ahead["th"]),
            "TH": ahead["th"], "V": ahead["v"], "OM": ahead["om"],
        }  # fmt: skip
        for name, rates in (
            ("cart", cart(goal, ahead, (4, 10, 5), 30, 150)),
            ("tail", cart(behind, own["tail"], (8, 20, 10), 80, 400)),
        ):
            for variable, rate in rates.items():
                np.testing.assert_allclose(found[f"{name}.{variable}"], rate, rtol=1e-11, atol=1e-10)


# ---- the arm --------------------------------------------------------------------------------------------------------------------


def test_arm() -> None:
    model = gallery("arm", "reach")
    l1, l2, m1, m2, g = 0.7, 0.6, 4.0, 3.0, 9.81
    for _ in range(10):
        t, at = float(RANDOM.uniform(0, 10)), states(model)
        at["ik.q"][1] = RANDOM.uniform(0.5, 2.5)  # the pose is not singular
        found = model.rates(t, at)
        pdot = np.array([-0.15 * np.sin(0.5 * t), 0.1 * np.cos(0.5 * t)])
        (a, b), (q1, q2), (w1, w2) = at["ik.q"], at["arm.q"], at["arm.qd"]
        tip = np.array([l1 * np.cos(a) + l2 * np.cos(a + b), l1 * np.sin(a) + l2 * np.sin(a + b)])
        slopes = np.array([[-tip[1], -l2 * np.sin(a + b)], [tip[0], l2 * np.cos(a + b)]])
        ik = np.linalg.inv(slopes) @ (pdot + 5 * (at["plan.p"] - tip))
        c = m2 * l1 * l2
        off = m2 * l2**2 + c * np.cos(q2)
        mass = np.array([[(m1 + m2) * l1**2 + m2 * l2**2 + 2 * c * np.cos(q2), off], [off, m2 * l2**2]])
        wanted = 900 * (at["ik.q"] - at["arm.q"]) + 60 * (ik - at["arm.qd"])
        coriolis = c * np.sin(q2) * np.array([-w2 * (2 * w1 + w2), w1**2])
        far = m2 * l2 * np.cos(q1 + q2)
        torque = mass @ wanted + coriolis + g * np.array([(m1 + m2) * l1 * np.cos(q1) + far, far])
        expected = {
            "plan.p": pdot, "ik.q": ik, "arm.q": at["arm.qd"], "arm.qd": wanted,
            "mot.i": (torque / [1.2, 0.8] - at["mot.i"]) / 5e-4,
        }  # fmt: skip
        assert found.keys() == expected.keys()
        for path, rate in expected.items():
            np.testing.assert_allclose(found[path], rate, rtol=1e-8, atol=1e-8, err_msg=path)
        variables = model.variables(t, at)
        np.testing.assert_allclose(variables["arm.tau"], torque, rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(variables["mot.tau"], torque, rtol=1e-10, atol=1e-9)


# ---- arrays of agents -----------------------------------------------------------------------------------------------------------

PLATOON = """
agent Leader(real v_max [km/h] = 90 [km/h], real T [s] = 20) {
  write real x [m] = 0, v [m/s] = 0;
  diff { x' = v; v' = (v_max*(1 - exp(-time/T)) - v)/(5 [s]); }
}
agent Follower(real x0 [m], real tau [s] = 0.3, real ka [1/s] = 50, real gap [m] = 10) {
  read real xp [m], vp [m/s], vlead [m/s];
  write real x [m] = x0, v [m/s] = 0, a [m/s^2] = 0;
  private real u [m/s^2] = 0;
  let cmd = 1.0 [1/s^2]*(xp - x - gap) + 1.5 [1/s]*(vp - v) + 0.2 [1/s]*(vlead - v);
  diff { x' = v; v' = a; a' = (u - a)/tau; u' = ka*(cmd - u); }
}
agent Platoon(int N = 10) {
  level lead { agent lead = Leader(); }
  level follow {
    agent car[i in 1..N] = Follower(x0 = -20 [m]*i, tau = 0.3 [s]/(1 + mod(i, 7)), ka = 20 [1/s] + 180 [1/s]*i/N)
      [ xp    := if i == 1 then lead.x else car[i - 1].x,
        vp    := if i == 1 then lead.v else car[i - 1].v,
        vlead := lead.v ];
  }
  group each car;
  write real spread [m];
  alge { spread = lead.x - car[N].x; }
}
experiment short of Platoon(N = 5, car[2..3].gap = 7 [m]) { stop = 60 [s]; }
"""


def test_platoon() -> None:
    model = interpreter(PLATOON, "Platoon", {"N": 25})
    i = np.arange(1, 26)
    start = model.initial()
    assert [start[f"car[{k}].x"] for k in i] == [-20 * k for k in i]
    for _ in range(3):
        t, at = float(RANDOM.uniform(0, 60)), states(model)
        found = model.rates(t, at)
        x, v, a, u = (np.array([at[f"car[{k}].{n}"] for k in i]) for n in "xvau")
        ahead_x, ahead_v = np.concatenate([[at["lead.x"]], x[:-1]]), np.concatenate([[at["lead.v"]], v[:-1]])
        wanted = ahead_x - x - 10 + 1.5 * (ahead_v - v) + 0.2 * (at["lead.v"] - v)
        rates = {"x": v, "v": a, "a": (u - a) * (1 + i % 7) / 0.3, "u": (20 + 180 * i / 25) * (wanted - u)}
        for name, expected in rates.items():
            np.testing.assert_allclose(
                [found[f"car[{k}].{name}"] for k in i], expected, rtol=1e-10, atol=1e-10
            )
        assert found["lead.v"] == pytest.approx((25 * (1 - np.exp(-t / 20)) - at["lead.v"]) / 5, rel=1e-13)
        assert model.variables(t, at)["spread"] == at["lead.x"] - x[-1]


def test_parameters_of_some_elements() -> None:
    model = interpreter(PLATOON, "short")
    found = model.rates(0.0, dict.fromkeys(model.initial(), 0.0))
    gaps = [found[f"car[{k}].u"] / (20 + 180 * k / 5) for k in range(1, 6)]
    assert gaps == pytest.approx([-10, -7, -7, -10, -10], rel=1e-14)


def test_slices_reductions_and_gathered_indices() -> None:
    model = interpreter("""
      const int[4] parent = [0, 1, 1, 3];
      agent Leaf(real k) { read real[2] pull; write real[2] p = [k, 2*k]; write real y; diff { p' = pull - p; } alge { y = p[1]*p[2]; } }
      agent Top() {
        agent leaf[i in 1..4] = Leaf(k = i)
          [pull := if i == 1 then [time, 0] else leaf[parent[i]].p' + [sum(leaf[1..i - 1].y), norm(leaf[i - 1].p)]];
        write real[4] all, firsts;
        write real[2,2] middle;
        write real total, none;
        alge {
          all = leaf.y;
          firsts = leaf.p[1..4, 1];
          middle = leaf[2..3].p;
          total = sum(leaf.p);
          none = sum(leaf[1..0].y);
        }
      }""")
    p = RANDOM.normal(size=(4, 2))
    at = {f"leaf[{k + 1}].p": p[k] for k in range(4)}
    assert model.initial() == {f"leaf[{k}].p": pytest.approx([k, 2 * k]) for k in range(1, 5)}
    y = p.prod(axis=1)
    rates = [np.array([0.5, 0.0]) - p[0]]
    for k, parent in ((1, 0), (2, 0), (3, 2)):
        rates.append(rates[parent] + [y[:k].sum(), np.hypot(*p[k - 1])] - p[k])
    found = model.rates(0.5, at)
    for k in range(4):
        np.testing.assert_allclose(found[f"leaf[{k + 1}].p"], rates[k], rtol=1e-13, atol=1e-13)
    seen = model.variables(0.5, at)
    expected = {"all": y, "firsts": p[:, 0], "middle": p[1:3], "total": p.sum(), "none": 0.0}
    for name, value in expected.items():
        np.testing.assert_allclose(seen[name], value, rtol=1e-13, atol=1e-13)


# ---- the rest of the language ---------------------------------------------------------------------------------------------------


def test_elements_that_use_each_other() -> None:
    model = interpreter("""
      agent Pass() { read real[2] u; write real[2] y; alge { y = 2*u; } }
      agent Halves() { read real[2] u; write real a, b; alge { a = 2*u[1]; b = 3*u[2]; } }
      agent Top() {
        write real[3] a;
        alge { a = [a[2], 1 + a[3], time]; }
        agent halves = Halves() [u := [time, halves.a]];
        agent pass = Pass() [u := [pass.y[2], 1]];
      }""")
    found = model.variables(2.0, {})
    assert list(found["a"]) == [3, 3, 2]
    assert (found["halves.a"], found["halves.b"]) == (4, 12)
    assert list(found["pass.y"]) == [4, 2]


def test_values_that_need_each_other() -> None:
    model = interpreter("agent Top() { write real a, b; alge { a = b; b = a + 1; } }")
    with pytest.raises(Circular):
        model.variables(0.0, {})


def test_levels_initial_values_and_experiments() -> None:
    model = interpreter(
        """
      const real k = 3;
      func real[n] scaled(real[n] x, real by [1/ms]) = [by*x[n + 1 - i] for i in 1..n];
      agent Chain(int N, real slow [1/min] = 30 [1/min], real[N] start = [i/N for i in 1..N]) {
        read real u;
        level one { level inner { write real[N] q = start; diff { q[1]' = u; for i in 2..N { q[i]' = q[i - 1] - slow*q[i]; } } } }
        level two { private real[N] r = 2*q nominal 5; diff { r' = scaled(q', 2 [1/s]); } }
      }
      agent Top() {
        read real force;
        agent a = Chain(N = 2) [u := force + b.q[3]];
        agent b = Chain(N = 3) [u := if time < k then -force else 1];
      }
      experiment run of Top(a.slow = 60 [1/min]) [force := time^2] { init { b.q = [7, 8, 9]; } stop = 1; }""",
        "run",
        {"b.slow": 120},
    )
    start = model.initial()
    assert {k: list(v) for k, v in start.items()} == {
        "a.q": [0.5, 1],
        "a.r": [1, 2],
        "b.q": [7, 8, 9],
        "b.r": [14, 16, 18],
    }
    found = model.rates(2.0, start)
    a, b = [13.0, 0.5 - 1.0], [-4.0, 7 - 2 * 8.0, 8 - 2 * 9.0]
    expected = {"a.q": a, "a.r": [2 * r for r in a[::-1]], "b.q": b, "b.r": [2 * r for r in b[::-1]]}
    assert {k: list(v) for k, v in found.items()} == expected
    assert model.nominals() == {"a.r": 5, "b.r": 5}


UNITS = """
    m km mm um ms min h g kg mg N kN mN Pa kPa MPa J W kW V mV ohm kohm F H T Hz kHz rad mrad deg rpm C S Wb mol cd K dm
    m/s km/h N*m/A kg*m^2 N/m^1.5 1/(s*m) 1/min m/s^2 rad/s deg/min mm^2/ms kg/m/s^2 V*s/rad
"""


@cache
def registry() -> pint.UnitRegistry:
    return pint.UnitRegistry()


@pytest.mark.parametrize("text", UNITS.split())
def test_units_against_pint(text: str) -> None:
    factor = registry().Quantity(1.0, text.replace("^", "**")).to_base_units().magnitude
    assert float(si.size(text)) == pytest.approx(factor, rel=1e-15)
