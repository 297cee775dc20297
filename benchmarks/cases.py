"""The benchmark problems, each twice: as a `.hier` model and as a right-hand side written by hand, which hierc never sees.

All quantities are SI. The hand-written form gives the reference solution and what a user of scipy would write.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, pi, sin
from pathlib import Path

import hierc
from hierc.runtime.model import Model

_MODELS = Path(__file__).parent / "models"

Vector = Sequence[float]


@dataclass(frozen=True, slots=True)
class Case:
    """One problem, from time 0 to `stop`. `states` names the model's states in the order of `start` and `rhs`."""

    name: str
    title: str
    model: Path
    stop: float
    states: tuple[str, ...]
    start: tuple[float, ...]
    rhs: Callable[[float, Vector], list[float]]
    reference_steps: int  # of the reference solution, between two output times
    peer_name: str | None  # what the peers' scripts call it, if they know it
    params: Mapping[str, int] = field(default_factory=dict)  # structural parameters of the model

    def load(self) -> Model:
        """The model, compiled."""
        return hierc.load(self.model, params=self.params)


# ---- cart: a planner, a kinematic unicycle, and two rigid-body carts that chase what is above them ----


def cart(t: float, y: Vector) -> list[float]:
    """Right-hand side (19,) of the cart."""
    rate_x, rate_y = cos(0.25 * t), cos(0.5 * t)
    c, s = cos(y[4]), sin(y[4])
    wx = rate_x + 2.0 * (y[0] - y[2] - 0.3 * c)
    wy = rate_y + 2.0 * (y[1] - y[3] - 0.3 * s)
    v, om = c * wx + s * wy, (c * wy - s * wx) / 0.3
    lead = _tracking(y[5:12], (y[2], y[3], y[4], v, om), (4.0, 10.0, 5.0, 30.0, 150.0))
    target = (y[5] - cos(y[7]), y[6] - sin(y[7]), y[7], y[8], y[9])
    return [
        rate_x,
        rate_y,
        v * c,
        v * s,
        om,
        *lead,
        *_tracking(y[12:19], target, (8.0, 20.0, 10.0, 80.0, 400.0)),
    ]


def _tracking(y: Vector, target: Vector, gains: Vector) -> list[float]:
    """A cart with wheel torques under Kanayama's tracking law. `target` is x, y, heading, speed, turn rate."""
    x, yy, th, v, om, right, left = y
    xr, yr, thr, vr, omr = target
    kx, ky, kth, kv, kt = gains
    m, inertia, r, b = 10.0, 1.0, 0.1, 0.25
    c, s = cos(th), sin(th)
    ahead, aside, turn = c * (xr - x) + s * (yr - yy), c * (yr - yy) - s * (xr - x), thr - th
    push = m * kv * (vr * cos(turn) + kx * ahead - v)
    twist = inertia * kv * (omr + vr * (ky * aside + kth * sin(turn)) - om) / b
    return [
        v * c,
        v * s,
        om,
        (right + left) / (m * r) - 0.1 * v,
        b * (right - left) / (inertia * r) - 0.1 * om,
        kt * (0.5 * r * (push + twist) - right),
        kt * (0.5 * r * (push - twist) - left),
    ]


# ---- contact: a slow body presses a tip on a surface with a natural frequency of 1e4 rad/s -------------


def contact(t: float, y: Vector) -> list[float]:
    """Right-hand side (6,) of the contact."""
    path = 0.2 * sin(pi * t), 0.01 + 0.005 * sin(2 * pi * t)
    rate = 0.2 * pi * cos(pi * t), 0.01 * pi * cos(2 * pi * t)
    ax, ay = (400.0 * (path[k] - y[k]) + 40.0 * (rate[k] - y[2 + k]) for k in (0, 1))
    w0, unit = 1e4, 1e-5
    press = 1e3 * y[1] * w0 / (1e6 * unit)
    return [y[2], y[3], ax, ay, w0 * y[5], press - w0 * y[4] * (1.0 + 1.5 * 0.7 * unit * w0 * y[5])]


# ---- chain: oscillators, each eight times as fast as the one before ------------------------------------


def chain(t: float, y: Vector) -> list[float]:
    """Right-hand side (8,) of the chain."""
    result = []
    for k in range(4):
        w, q, p = 8.0**k, y[2 * k], y[2 * k + 1]
        s = y[2 * k - 2] if k else sin(0.5 * t)
        result += [w * p, w * (s + 0.2 * sin(0.7 * w * t) - q - 0.6 * p)]
    return result


# ---- platoon: a leader and cars, each with an engine and a throttle of its own --------------------------


def platoon(t: float, y: Vector) -> list[float]:
    """Right-hand side (2 + 4N,) of a platoon."""
    r0, v0 = y[0], y[1]
    pull = 0.6 * cos(0.3 * t) + 0.4 * cos(0.11 * t)
    result = [v0, pull]
    ahead: Vector = (r0, v0, pull)
    for k in range(2, len(y), 4):
        r, v, a, u = y[k : k + 4]
        i = (k + 2) // 4
        wish = 0.5 * (ahead[2] + pull) + ahead[1] + v0 - 2 * v + 0.5 * (ahead[0] + r0) - r
        throttle = 20 * 10 ** (i % 5 / 4) * (wish - u)
        result += [v, a - 5e-4 * (40 * v + v * v), (u - a) * (1 + i % 7) / 0.3, throttle]
        ahead = (r, v, a)
    return result


def _platoon(count: int, reference_steps: int) -> Case:
    cars = range(1, count + 1)
    start = [0.0, 0.0]
    for i in cars:
        start += [0.5 * sin(1.7 * i), 0.3 * cos(2.3 * i), 0.0, 0.0]
    return Case(
        name=f"platoon{count}",
        title=f"a leader and {count} cars, {len(start)} states, 60 s",
        model=_MODELS / "platoon.hier",
        stop=60.0,
        states=("lead.r", "lead.v", *(f"car[{i}].{state}" for i in cars for state in "rvau")),
        start=tuple(start),
        rhs=platoon,
        reference_steps=reference_steps,
        peer_name=f"platoon{count}",
        params={"N": count},
    )


# ---- bidirectional: cars in a row, each of which moves both its neighbours ------------------------------


def bidirectional(t: float, y: Vector) -> list[float]:
    """Right-hand side (402,) of the leader and a hundred cars."""
    wish = 20.0 + 4.0 * sin(0.5 * t) + 2.0 * sin(1.3 * t)
    result = [y[1], wish - y[1]]
    cars = len(y) // 4
    for i in range(1, cars + 1):
        x, v, a, throttle = y[4 * i - 2 : 4 * i + 2]
        front = y[4 * i - 6 : 4 * i - 4] if i > 1 else y[0:2]
        rear = y[4 * i + 2 : 4 * i + 4] if i < cars else (x - 10.0, v)
        ahead, behind = front[0] - x - 10.0, x - rear[0] - 10.0
        pull = ahead + ahead**3 / 25.0 + 2.0 * (front[1] - v)
        push = behind + behind**3 / 25.0 + 2.0 * (v - rear[1])
        command = pull - push + 0.2 * (20.0 - v)
        result += [
            v,
            a - 0.0005 * v * abs(v),
            (throttle - a) * (1 + i % 7) / 0.3,
            (20.0 + 20.0 * (i % 5)) * (command - throttle),
        ]
    return result


_CART = ("x", "y", "th", "v", "om", "tau[1]", "tau[2]")
CASES = {
    case.name: case
    for case in (
        Case(
            name="cart",
            title="four-level cart, 19 states, 50 s",
            model=_MODELS.parents[1] / "models" / "cart.hier",
            stop=50.0,
            states=(
                "plan.p[1]",
                "plan.p[2]",
                "kin.x",
                "kin.y",
                "kin.th",
                *(f"{agent}.{state}" for agent in ("cart", "tail") for state in _CART),
            ),
            start=(0, 0, -0.5, -0.3, 0.4, -0.6, -0.4, 0.3, 0, 0, 0, 0, -1.8, -0.9, 0.2, 0, 0, 0, 0),
            rhs=cart,
            reference_steps=100,
            peer_name="cart",
        ),
        Case(
            name="contact",
            title="lightly damped contact, 6 states, 2 s",
            model=_MODELS / "contact.hier",
            stop=2.0,
            states=("body.r[1]", "body.r[2]", "body.v[1]", "body.v[2]", "tip.z", "tip.s"),
            start=(0, 0.012, 0, 0, 0.5, 0),
            rhs=contact,
            reference_steps=200,
            peer_name="contact",
        ),
        Case(
            name="chain",
            title="chain of four oscillators, each 8 times as fast, 8 states, 20 s",
            model=_MODELS / "chain.hier",
            stop=20.0,
            states=tuple(f"{agent}.{state}" for agent in "abcd" for state in "qp"),
            start=(1, 0, 1, 0, 1, 0, 1, 0),
            rhs=chain,
            reference_steps=100,
            peer_name="chain_4_8_0",
        ),
        _platoon(10, 100),
        _platoon(100, 100),
        Case(
            name="costly",
            title="the chain with right-hand sides of 400 operations more",
            model=_MODELS / "costly.hier",
            stop=20.0,
            states=tuple(f"{agent}.{state}" for agent in "abcd" for state in "qp"),
            start=(1, 0, 1, 0, 1, 0, 1, 0),
            rhs=chain,  # what it does more changes nothing
            reference_steps=100,
            peer_name="chain_4_8_400",
        ),
        Case(
            name="bidirectional",
            title="a leader and 100 cars, each of which moves both its neighbours, 402 states, 40 s",
            model=_MODELS / "bidirectional.hier",
            stop=40.0,
            states=(
                "lead.x",
                "lead.v",
                *(f"car[{i}].{state}" for i in range(1, 101) for state in ("x", "v", "a", "throttle")),
            ),
            start=(0, 20, *(value for i in range(1, 101) for value in (-10 * i, 20, 0, 0))),
            rhs=bidirectional,
            reference_steps=10,
            peer_name=None,
        ),
    )
}
