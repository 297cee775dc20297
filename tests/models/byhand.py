"""The gallery's models once more, written by hand from their physics, with numpy and scipy and nothing of ours.

Each function gives the derivatives of all states by the names of the variables; an array of agents has a row for each. `start` gives their
initial values. None is a copy of the model's formulas: places and velocities in the plane are complex numbers, arms go by Newton's and
Euler's laws from link to link, bodies turn by rotation matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
States = Mapping[str, Floats]
Derivatives = dict[str, ArrayLike]
THRUST = Path(__file__).parents[2] / "models" / "data" / "thrust.csv"
G = 9.81


def point(p: Floats) -> complex:
    return complex(p[0], p[1])


def pair(z: complex) -> list[float]:
    return [z.real, z.imag]


# ---- carts ---------------------------------------------------------------------------------------------------------------------------


def cart(t: float, x: States) -> Derivatives:
    A, B, w, L, k = 4.0, 2.0, 0.25, 0.3, 2.0
    rate = complex(A * w * np.cos(w * t), 2 * B * w * np.cos(2 * w * t))
    here, heading = complex(x["kin.x"], x["kin.y"]), np.exp(1j * x["kin.th"])
    nose = here + L * heading
    motion = (rate + k * (point(x["plan.p"]) - nose)) / heading  # of the nose, in the cart's own axes
    v, om = motion.real, motion.imag / L
    found: Derivatives = {
        "plan.p": pair(rate),
        "kin.x": (v * heading).real,
        "kin.y": (v * heading).imag,
        "kin.th": om,
    }
    leader = (here, float(x["kin.th"]), v, om)
    for name, *gains in (
        ("cart", 0.0, 4.0, 10.0, 5.0, 30.0, 150.0),
        ("tail", 1.0, 8.0, 20.0, 10.0, 80.0, 400.0),
    ):
        derivatives, leader = _steered(x, name, leader, *gains)
        found |= derivatives
    return found


Leader = tuple[complex, float, float, float]  # place, heading, speed, rate of turn


def _steered(
    x: States, name: str, leader: Leader, d: float, k1: float, k2: float, k3: float, kv: float, kt: float
) -> tuple[Derivatives, Leader]:
    """A body on two wheels that steers to a point behind its leader."""
    m, J, r, b = 10.0, 1.0, 0.1, 0.25
    z, heading = complex(x[f"{name}.x"], x[f"{name}.y"]), np.exp(1j * x[f"{name}.th"])
    th, v, om = (float(x[f"{name}.{q}"]) for q in ("th", "v", "om"))
    place, th_r, v_r, om_r = leader
    error = (place - d * np.exp(1j * th_r) - z) / heading
    wish_v = v_r * np.cos(th_r - th) + k1 * error.real
    wish_om = om_r + v_r * (k2 * error.imag + k3 * np.sin(th_r - th))
    force, moment = m * kv * (wish_v - v), J * kv * (wish_om - om)
    wheels = np.array([force + moment / b, force - moment / b]) * r / 2
    pushes = x[f"{name}.tau"] / r
    return {
        f"{name}.x": (v * heading).real,
        f"{name}.y": (v * heading).imag,
        f"{name}.th": om,
        f"{name}.v": pushes.sum() / m - 0.1 * v,
        f"{name}.om": b * (pushes[0] - pushes[1]) / J - 0.1 * om,
        f"{name}.tau": kt * (wheels - x[f"{name}.tau"]),
    }, (z, th, v, om)


def servo(t: float, x: States) -> Derivatives:
    wr, wn, J, kt = 2.0, 20.0, 0.1, 0.5
    rate = wr * np.cos(wr * t)
    acceleration = wn**2 * (x["r"] - x["q"]) + 2 * wn * (rate - x["qd"])
    return {"r": rate, "q": x["qd"], "qd": acceleration, "i": (J * acceleration / kt - x["i"]) / 0.5e-3}


# ---- arms ----------------------------------------------------------------------------------------------------------------------------


def inverse_dynamics(
    q: Floats, qd: Floats, qdd: Floats, l: Floats, m: Floats, c: Floats, J: Floats, g: float = G
) -> Floats:
    """Torques of the joints of a planar arm for given accelerations: Newton and Euler, out along the arm and back."""
    heading, w, turn = np.exp(1j * np.cumsum(q)), np.cumsum(qd), np.cumsum(qdd)
    swing = heading * (1j * turn - w**2)  # acceleration of a point at unit distance, against the joint
    joints = 1j * g + np.concatenate([[0], np.cumsum(l * swing)[:-1]])
    forces = m * (joints + c * swing)
    torques, carried, moment = np.zeros(len(q)), 0j, 0.0
    for k in reversed(range(len(q))):
        moment += J[k] * turn[k]
        moment += (
            (c[k] * heading[k]).conjugate() * forces[k] + (l[k] * heading[k]).conjugate() * carried
        ).imag
        carried += forces[k]
        torques[k] = moment
    return torques


def mass_matrix(q: Floats, *rods: Floats) -> Floats:
    """A column for a unit acceleration of each joint, at rest and without gravity."""
    rest = np.zeros(len(q))
    return np.column_stack([inverse_dynamics(q, rest, unit, *rods, g=0.0) for unit in np.eye(len(q))])


def arm(t: float, x: States) -> Derivatives:
    """Masses at the ends of the links. With the right model, the arm does what is wished."""
    l, m, w, wn, k = np.array([0.7, 0.6]), np.array([4.0, 3.0]), 0.5, 30.0, 5.0
    rate = w * complex(-0.3 * np.sin(w * t), 0.2 * np.cos(w * t))
    ends = np.cumsum(l * np.exp(1j * np.cumsum(x["ik.q"])))
    levers = 1j * (ends[-1] - np.array([0, ends[0]]))  # velocity of the tip for a unit rate of each joint
    motion = pair(rate + k * (point(x["plan.p"]) - ends[-1]))
    angle_rates = np.linalg.solve([levers.real, levers.imag], motion)
    wish = wn**2 * (x["ik.q"] - x["arm.q"]) + 2 * wn * (angle_rates - x["arm.qd"])
    tau = inverse_dynamics(x["arm.q"], x["arm.qd"], wish, l, m, l, np.zeros(2))
    return {
        "plan.p": pair(rate),
        "ik.q": angle_rates,
        "arm.q": x["arm.qd"],
        "arm.qd": wish,
        "mot.i": (tau / [1.2, 0.8] - x["mot.i"]) / 0.5e-3,
    }


def links(t: float, x: States) -> Derivatives:
    """Rods; the controller computes with a tenth too much of every mass."""
    q, qd, n = x["arm.q"], x["arm.qd"], len(x["arm.q"])
    size, w, wn = 0.5, 1.5, 20.0
    planned = np.imag(-size * w**2 * np.exp(1j * (w * t - 0.6 * np.arange(1, n + 1))))
    l, m = np.full(n, 0.4), np.full(n, 1.5)
    rods, heavier = (l, m, l / 2, m * l**2 / 12), (l, 1.1 * m, l / 2, 1.1 * m * l**2 / 12)
    wish = planned + 2 * wn * (x["plan.qd"] - qd) + wn**2 * (x["plan.q"] - q)
    tau = inverse_dynamics(q, qd, wish, *heavier)
    rest = inverse_dynamics(q, qd, np.zeros(n), *rods)
    return {
        "plan.q": x["plan.qd"],
        "plan.qd": planned,
        "arm.q": qd,
        "arm.qd": np.linalg.solve(mass_matrix(q, *rods), tau - rest),
        "motors.i": (tau / 0.8 - x["motors.i"]) / 0.5e-3,
    }


# ---- boat ----------------------------------------------------------------------------------------------------------------------------


def _read_thrust() -> Callable[[float, float], float]:
    """The measured thrust: monotone cubics along both arguments, and the mean of both ways to take the mixed derivative."""
    rows = np.genfromtxt(THRUST, delimiter=",", comments="#", skip_header=2)
    n, v = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    f = np.zeros((len(n), len(v)))
    f[np.searchsorted(n, rows[:, 0]), np.searchsorted(v, rows[:, 1])] = rows[:, 2]

    def slopes(grid: Floats, values: Floats, axis: int) -> Floats:
        return np.asarray(PchipInterpolator(grid, values, axis=axis).derivative()(grid))

    by_n, by_v = slopes(n, f, 0), slopes(v, f.T, 0).T
    mixed = (slopes(n, by_v, 0) + slopes(v, by_n.T, 0).T) / 2
    value, slope = CubicHermiteSpline(n, f, by_n), CubicHermiteSpline(n, by_v, mixed)
    return lambda rpm, speed: float(CubicHermiteSpline(v, value(rpm), slope(rpm))(speed))


thrust = _read_thrust()


def boat(t: float, x: States) -> Derivatives:
    n, v = float(x["motor.n"]), float(x["hull.v"])
    lever = 0.45 * (1 + np.tanh((t - 3) / 0.8))
    froude = abs(v) / np.sqrt(9.81 * 3.2)
    resistance = 18 * np.tanh(v / 0.25) + 9 * v + np.sign(v) * 310 * max(froude - 0.2, 0) ** 2
    return {
        "motor.n": (3000 * 2 * np.pi / 60 * lever - n) / 0.4,
        "hull.x": v,
        "hull.v": (thrust(n * 60 / (2 * np.pi), v) - resistance) / 180,
    }


# ---- quadrotors ----------------------------------------------------------------------------------------------------------------------

M, INERTIA, ARM, KF, KM = 0.5, np.diag([2.5e-3, 2.5e-3, 4.5e-3]), 0.17, 3e-6, 5e-8
#: Where the rotors are, from the middle, and which way their drag turns the body.
ROTORS = ARM * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
SPINS = np.array([1, -1, 1, -1])
#: Thrust and torques for a unit of each rotor's squared speed.
EFFECT = np.vstack([np.full(4, KF), np.cross(ROTORS, [0, 0, KF]).T + np.outer([0, 0, KM], SPINS)])


def quadrotor(t: float, x: States) -> Derivatives:
    a, b, w, T = 3.0, 1.5, 0.6, 2.0
    phase, rate = float(x["path.phase"]), float(x["path.rate"])
    jerk = (w - rate) / T
    place = np.array([a * np.sin(phase), b * np.sin(2 * phase), 2.0])
    tangent = np.array([a * np.cos(phase), 2 * b * np.cos(2 * phase), 0.0])
    curve = np.array([-a * np.sin(phase), -4 * b * np.sin(2 * phase), 0.0])
    found: Derivatives = {"path.phase": rate, "path.rate": jerk}
    first = _vehicle(x, "first", place, rate * tangent, jerk * tangent + rate**2 * curve)
    second = _vehicle(
        x, "second", x["first.p"] + [-1.0, 0.0, 0.5], x["first.v"], np.asarray(first["first.v"])
    )
    return found | first | second


def _vehicle(x: States, name: str, place: Floats, velocity: Floats, acceleration: Floats) -> Derivatives:
    p, v, spin, rotor = (x[f"{name}.{q}"] for q in ("p", "v", "w", "rotor"))
    angles = np.array([x[f"{name}.{q}"] for q in ("roll", "pitch", "yaw")])
    about_z, about_y = Rotation.from_rotvec([0, 0, angles[2]]), Rotation.from_rotvec([0, angles[1], 0])
    attitude = about_z * about_y * Rotation.from_rotvec([angles[0], 0, 0])
    axes = np.column_stack([(about_z * about_y).apply([1, 0, 0]), about_z.apply([0, 1, 0]), [0, 0, 1]])
    rates = np.linalg.solve(axes, attitude.apply(spin))

    wish = acceleration + 3.5 * (velocity - v) + 4.0 * (place - p) + [0, 0, G]
    up = wish / np.linalg.norm(wish)
    forward = np.cross([0, 1, 0], up) / np.linalg.norm(
        np.cross([0, 1, 0], up)
    )  # the nose turns neither left nor right
    wished = Rotation.from_matrix(np.column_stack([forward, np.cross(up, forward), up])).as_euler("ZYX")[::-1]
    gyro = np.cross(spin, INERTIA @ spin)
    torque = 30.0 * INERTIA @ (10.0 * (wished - angles) - spin) + gyro
    squares = np.linalg.solve(EFFECT, [M * np.linalg.norm(wish), *torque])

    lift, *turning = EFFECT @ rotor**2
    force = attitude.apply([0, 0, lift]) - [0, 0, M * G] - 0.05 * v
    return {
        f"{name}.p": v,
        f"{name}.v": force / M,
        f"{name}.roll": rates[0],
        f"{name}.pitch": rates[1],
        f"{name}.yaw": rates[2],
        f"{name}.w": np.linalg.solve(INERTIA, turning - gyro),
        f"{name}.rotor": (np.sqrt(np.maximum(squares, 150.0**2)) - rotor) / 20e-3,
    }


# ---- arrays --------------------------------------------------------------------------------------------------------------------------


def platoon(t: float, x: States) -> Derivatives:
    n = len(x["car.x"])
    i = np.arange(1, n + 1)
    places, speeds = (np.concatenate([[x[f"lead.{q}"]], x[f"car.{q}"]]) for q in "xv")
    wish = 25 * -np.expm1(-t / 10) - 10 * np.exp(-(((t - 60) / 5) ** 2))
    command = 0.5 * (-np.diff(places) - 10) - np.diff(speeds) + 0.8 * (speeds[0] - speeds[1:])
    return {
        "lead.x": x["lead.v"],
        "lead.v": (wish - x["lead.v"]) / 2,
        "car.x": x["car.v"],
        "car.v": x["car.a"],
        "car.a": (x["car.throttle"] - x["car.a"]) * (1 + i % 7) / 0.3,
        "car.throttle": (20 + 180 * i / n) * (command - x["car.throttle"]),
    }


def snake(t: float, x: States) -> Derivatives:
    """Every joint has one velocity, whichever of its two links it is taken from; the middle of a link moves along the link alone."""
    speed, half, n = 0.3, 0.05, len(x["link.th"])
    turn = 0.8 * 1.8 * np.cos(1.8 * t)
    front = np.exp(1j * x["head.th"])
    joint = speed * front - 1j * turn * half * front
    turns = np.zeros(n)
    for k, heading in enumerate(np.exp(1j * x["link.th"])):
        motion = joint / heading  # in the link's axes: forward, and to the left by turning about the middle
        turns[k] = motion.imag / half
        joint = (motion.real - 1j * motion.imag) * heading
    angles = np.concatenate([[x["head.th"]], x["link.th"][:-1]]) - x["link.th"]
    strength = 20 * (1 - 0.7 * np.arange(1, n + 1) / n)
    return {
        "head.x": (speed * front).real,
        "head.y": (speed * front).imag,
        "head.th": turn,
        "link.th": turns,
        "muscle.excitation": (np.tanh(angles / 0.5) - x["muscle.excitation"]) / 30e-3,
        "muscle.pull": (strength * x["muscle.excitation"] - x["muscle.pull"]) / 5e-3,
    }


def formation(n: int) -> Floats:
    """Where robots belong, from the leader (n, 2): each row of the tree is spread evenly over twice 16 m, 3 m behind the one before."""
    i = np.arange(1, n + 1)
    row = np.floor(np.log2(i) + 1e-12)
    return np.column_stack([32 * ((i - 2**row + 0.5) / 2**row - 0.5), -3 * (row + 1)])


def swarm(t: float, x: States) -> Derivatives:
    w, k, b, p = 0.15, 0.5, 1.4, x["robot.p"]
    n = len(p)
    centripetal = -(w**2) * x["lead.p"]
    above = np.arange(1, n + 1) // 2  # in a list that begins with the leader
    places, belong = np.vstack([x["lead.p"], p]), np.vstack([[0.0, 0.0], formation(n)])
    error = places[above] - belong[above] - (p - belong[1:])
    wish = k * error + b * (x["lead.v"] - x["robot.v"]) + centripetal
    return {
        "lead.p": x["lead.v"],
        "lead.v": centripetal,
        "robot.p": x["robot.v"],
        "robot.v": x["robot.a"],
        "robot.a": (wish - x["robot.a"]) / (0.05 * (1 + np.arange(1, n + 1) % 4))[:, None],
        "ground.seen": (p.mean(axis=0) - x["ground.seen"]) / 0.5,
    }


MODELS: dict[str, Callable[[float, States], Derivatives]] = {
    "arm": arm,
    "boat": boat,
    "cart": cart,
    "links": links,
    "platoon": platoon,
    "quadrotor": quadrotor,
    "servo": servo,
    "snake": snake,
    "swarm": swarm,
}


def start(name: str, n: int) -> Derivatives:
    """Initial values that are not 0, for n agents or links."""
    k = np.arange(1, n + 1)
    scattered = 2 * np.sqrt(k) * np.exp(2.4j * k)
    scattered_xy = np.column_stack([scattered.real, scattered.imag])
    hanging = np.where(k == 1, -np.pi / 2, 0) - 0.5 * np.sin(0.6 * k)
    swinging = 0.5 * 1.5 * np.cos(0.6 * k)
    hover = np.full(4, np.sqrt(M * G / 4 / KF))
    found: dict[str, Derivatives] = {
        "arm": {"plan.p": [0.9, 0.3], "ik.q": [0.3, 1.2], "arm.q": [0.3, 1.2]},
        "cart": {
            "kin.x": -0.5, "kin.y": -0.3, "kin.th": 0.4, "cart.x": -0.6, "cart.y": -0.4, "cart.th": 0.3,
            "tail.x": -1.8, "tail.y": -0.9, "tail.th": 0.2,
        },
        "links": {"plan.q": hanging, "plan.qd": swinging, "arm.q": hanging, "arm.qd": swinging},
        "platoon": {"car.x": -10.0 * k},
        "quadrotor": {"first.p": [0, 0, 2], "second.p": [-2, -1, 2], "first.rotor": hover, "second.rotor": hover},
        "swarm": {
            "lead.p": [20, 0], "lead.v": [0, 3], "robot.p": scattered_xy, "ground.seen": scattered_xy.mean(axis=0),
        },
    }  # fmt: skip
    return found.get(name, {})
