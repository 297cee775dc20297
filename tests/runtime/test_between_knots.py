"""What is promised between the knots: dense output and what other groups read are as accurate as the states, whatever moves fastest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hierc

PLAN = """
agent Plan() {
  write real s = 0;
  write real r;
  alge { r = sin(20 [1/s]*time)*(1 + s); }
  diff { s' = (1 - s)*1 [1/s]; }
}
agent Servo() {
  read real r;
  write real q = 0, v = 0;
  diff { q' = v*1 [1/s]; v' = (400*(r - q) - 40*v)*1 [1/s]; }
}
agent Top() {
  level plan { agent p = Plan(); }
  level body { agent c = Servo() [r := p.r]; }
}
"""
RATE = """
agent Wave() { write real a = 0; diff { a' = 1e-3*cos(1000 [1/s]*time)*1 [1/s]; } }
agent Reader() { read real u; write real y = 0; diff { y' = (1000*u - y)*1 [1/s]; } }
agent Top() {
  level one { agent w = Wave(); }
  level two { agent r = Reader() [u := w.a']; }
}
"""
TRACKING = """
agent Stiff() { write real x = 0; diff { x' = -1e6 [1/s]*(x - sin(1 [1/s]*time)) + 1 [1/s]*cos(1 [1/s]*time); } }
"""


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "auto"])
@pytest.mark.parametrize("text", [PLAN, RATE], ids=["a fast output", "a fast derivative"])
def test_what_other_groups_read(text: str, method: str) -> None:
    model = hierc.load(text)
    t = np.linspace(0.0, 3.0, 301)
    known = solve_ivp(
        model.rhs, (0.0, 3.0), model.initial(), "DOP853", t, rtol=1e-12, atol=1e-13, max_step=1e-3
    )
    for tolerance in (1e-4, 1e-6):
        result = model.simulate(stop=3.0, rtol=tolerance, atol=tolerance, method=method)
        for name, reference in zip(model.states, known.y, strict=True):
            assert np.abs(result(name, t) - reference).max() <= 10 * tolerance


@pytest.mark.parametrize("method", ["radau5", "radau13", "dop853", "tsit5"])
def test_a_right_hand_side_of_what_others_give_alone(method: str) -> None:
    """Nothing of it depends on its own states, and part of it comes by way of an agent without states."""
    model = hierc.load("""
        agent Clock() { write real y; alge { y = cos(3 [1/s]*time); } }
        agent Decay() { write real y = 1; diff { y' = -y*1 [1/s]; } }
        agent Sum() { read real a, b; write real i = 0; diff { i' = (a - b)*1 [1/s]; } }
        agent Top() { agent c = Clock(); agent d = Decay(); agent s = Sum() [a := c.y, b := d.y]; }
    """)
    t = np.linspace(0.0, 3.0, 301)
    result = model.simulate(stop=3.0, rtol=1e-8, atol=1e-8, method=method)
    assert np.abs(result("s.i", t) - (np.sin(3 * t) / 3 - 1 + np.exp(-t))).max() <= 1e-7


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "auto"])
def test_a_stiff_state_that_tracks(method: str) -> None:
    """At the knots the error vanishes with the stiffness; between them it is that of the polynomial."""
    model = hierc.load(TRACKING)
    t = np.linspace(0.0, 10.0, 1001)
    for tolerance in (1e-4, 1e-6, 1e-8):
        result = model.simulate(stop=10.0, rtol=tolerance, atol=tolerance, method=method)
        assert np.abs(result("x", t) - np.sin(t)).max() <= 10 * tolerance


@pytest.mark.parametrize("method", ["radau13", "dop853"])
def test_starts_far_from_zero_and_least_steps(method: str) -> None:
    model = hierc.load("agent Lag() { write real x = 0; diff { x' = (1 - x)*1 [1/s]; } }")
    late = model.simulate(start=1.7e9, stop=1.7e9 + 2, method=method)
    assert late["x"][-1] == pytest.approx(1 - np.exp(-2.0), abs=1e-5)
    least = model.simulate(stop=2.0, min_step=1e-3, method=method)
    assert least["x"][-1] == pytest.approx(1 - np.exp(-2.0), abs=1e-5)
    assert np.diff(least.steps("Lag")[0]).min() >= 1e-3


def test_every_state_has_the_name_that_results_know() -> None:
    for name in ("cart", "servo", "arm"):
        with pytest.warns() if name == "arm" else _nothing():
            model = hierc.load(name)
        result = model.simulate(stop=0.01)
        assert [float(result(state, 0.0)) for state in model.states] == model.initial().tolist()


def _nothing():
    from contextlib import nullcontext

    return nullcontext()


JUMPS = {
    "a step reference": (
        """
        agent Loop() {
          write real x = 0, z = 0;
          write real u;
          alge { u = 0.2*((if time < T0 then 0 else 100) - x) + z; }
          diff { x' = (50*u - x)*1 [1/s]; z' = 2*((if time < T0 then 0 else 100) - x)*1 [1/s]; }
        }
        agent Stage() { read real u; write real y = 0; diff { y' = (u - y)/(0.5 [ms]); } }
        agent Top() {
          level loop { agent loop = Loop(); }
          level stage { agent stage = Stage() [u := loop.u]; }
        }
        """
    ),
    "a jumping acceleration": (
        """
        agent Lead() { write real v = 0, a; alge { a = if time < T0 then 1 else -1; } diff { v' = a*1 [1/s]; } }
        agent Follow() { read real a; write real v = 0; diff { v' = a*1 [1/s]; } }
        agent Top() {
          level lead { agent lead = Lead(); }
          level follow { agent f = Follow() [a := lead.a]; agent g = Follow() [a := lead.v'*1 [s]]; }
        }
        """
    ),
}


@pytest.mark.filterwarnings("ignore:warning.W013")
@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "auto"])
@pytest.mark.parametrize("start", [0.1, 1.2345])
@pytest.mark.parametrize("text", JUMPS.values(), ids=JUMPS.keys())
def test_a_jump_of_what_other_groups_read(text: str, start: float, method: str) -> None:
    """However small the step, no polynomial is near a jump; the run goes through it, and readers feel no more of it than they may."""
    model = hierc.load(text.replace("T0", f"{start} [s]"))
    x = model.initial()
    for begin, end in ((0.0, start), (start, 3.0)):
        inside = (begin + 1e-12, end - 1e-12)
        x = solve_ivp(model.rhs, inside, x, "Radau", rtol=1e-11, atol=1e-13).y[:, -1]
    for tolerance in (1e-3, 1e-5, 1e-7):
        result = model.simulate(stop=3.0, rtol=tolerance, atol=tolerance, method=method)
        found = np.array([result[name][-1] for name in model.states])
        assert np.abs(found - x).max() <= 10 * tolerance * max(1.0, np.abs(x).max())
