"""The library: every block against its transfer function or a solution in closed form, and the page that lists them all."""

from __future__ import annotations

import importlib.util
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.linalg import expm
from scipy.signal import impulse

import hierc
from hierc.fmt import model_files
from hierc.grammar.formatting import format_source
from hierc.grammar.reading import read_source
from hierc.loader import read_file
from hierc.runtime.model import Model
from hierc.runtime.result import Result

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT / "models" / "std"
FILES = sorted(LIBRARY.glob("*.hier"))
#: Far tighter than what is asked of the answers.
TIGHT = "rtol = 1e-11; atol = 1e-12;"


def load(text: str) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # jumps are not located yet
        return hierc.load(text)


def run(module: str, block: str, args: str, coupling: str, stop: float) -> Result:
    """A block alone, its inputs given as functions of the time."""
    coupled = f"[{coupling}] " if coupling else ""
    return load(
        f"from std.{module} import {block};\nexperiment e of {block}({args}) {coupled}{{ stop = {stop}; {TIGHT} }}"
    ).simulate()


# ---- linear blocks -------------------------------------------------------------------------------

S = Polynomial([0.0, 1.0])

#: Block, arguments, numerator and denominator.
LINEAR = (
    ("Integrator", "K = 3", 3 + 0 * S, S),
    ("Lag", "T = 0.4 [s], K = 3", 3 + 0 * S, 0.4 * S + 1),
    ("HighPass", "T = 0.4 [s], K = 3", 3 * 0.4 * S, 0.4 * S + 1),
    ("Derivative", "T = 0.4 [s], K = 3", 3 * S, 0.4 * S + 1),
    ("LeadLag", "T1 = 1.5 [s], T2 = 0.2 [s], K = 3", 3 * (1.5 * S + 1), 0.2 * S + 1),
    ("SecondOrder", "wn = 5, zeta = 0.3, K = 2", 2 * 25 + 0 * S, S**2 + 2 * 0.3 * 5 * S + 25),
    ("LowPass2", "wc = 4", 16 + 0 * S, S**2 + np.sqrt(2) * 4 * S + 16),
    ("BandPass", "wn = 4, zeta = 0.2", 2 * 0.2 * 4 * S, S**2 + 2 * 0.2 * 4 * S + 16),
    ("Notch", "wn = 4, zeta = 0.5, depth = 0.1", S**2 + 0.1 * 4 * S + 16, S**2 + 4 * S + 16),
    ("PadeDelay", "T = 0.6 [s]", 0.03 * S**2 - 0.3 * S + 1, 0.03 * S**2 + 0.3 * S + 1),
    ("TransferFunction", "n = 3, b = [2, 0.5, 1], a = [6, 11, 6]", S**2 + 0.5 * S + 2, S**3 + 6 * S**2 + 11 * S + 6),
    (
        "StateSpace",
        "n = 2, A = [[0, 1], [-9, -2]], B = [0, 4], C = [1, 0.5], D = 0.25",
        4 * (0.5 * S + 1) + 0.25 * (S**2 + 2 * S + 9),
        S**2 + 2 * S + 9,
    ),
)  # fmt: skip
#: An input as the language writes it, and its Laplace transform.
INPUTS = (("1", Polynomial([1.0]), S), ("sin(3 [1/s]*time)", Polynomial([3.0]), S**2 + 9))


@pytest.mark.parametrize(("u", "top", "bottom"), INPUTS, ids=["step", "sine"])
@pytest.mark.parametrize(("block", "args", "num", "den"), LINEAR, ids=[case[0] for case in LINEAR])
def test_linear_blocks_answer_as_their_transfer_functions(
    block: str, args: str, num: Polynomial, den: Polynomial, u: str, top: Polynomial, bottom: Polynomial
) -> None:
    r = run("blocks", block, args, f"u := {u}", 4)
    _, exact = impulse(((num * top).coef[::-1], (den * bottom).coef[::-1]), T=r.t)
    assert np.abs(exact).max() > 0.05
    assert np.asarray(r["y"]) == pytest.approx(exact, abs=2e-9)


def test_every_linear_block_starts_at_rest_for_its_input() -> None:
    for block, args in (
        ("HighPass", "T = 1 [s]"),
        ("Derivative", "T = 1 [s]"),
        ("LeadLag", "T1 = 2 [s], T2 = 1 [s]"),
        ("Notch", "wn = 2"),
        ("PadeDelay", "T = 1 [s]"),
    ):
        y = np.asarray(run("blocks", block, f"{args}, u0 = 5", "u := 5", 3)["y"])
        assert y == pytest.approx(np.full_like(y, 0 if block in ("HighPass", "Derivative") else 5), abs=1e-9)


def test_state_space_with_several_inputs_and_outputs() -> None:
    A, B = np.array([[0.0, 1.0], [-2.0, -0.5]]), np.array([[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]])
    C, D, u = np.array([[1.0, 2.0]]), np.array([[0.5, 0.0, 1.0]]), np.array([1.0, -2.0, 0.5])
    args = ", ".join(f"{n} = {np.array(v).tolist()}" for n, v in (("A", A), ("B", B), ("C", C), ("D", D)))
    r = run("blocks", "StateSpaceMIMO", f"n = 2, m = 3, p = 1, {args}, x0 = [1, 0]", f"u := {u.tolist()}", 3)
    whole = np.block([[A, (B @ u)[:, None]], [np.zeros((1, 3))]])
    exact = np.array([expm(whole * t)[:2] @ [1.0, 0.0, 1.0] for t in r.t])
    assert np.asarray(r["x"]) == pytest.approx(exact, abs=1e-9)
    assert np.asarray(r["y"])[:, 0] == pytest.approx((exact @ C.T + D @ u)[:, 0], abs=1e-9)


# ---- limiters and controllers --------------------------------------------------------------------


def test_saturation_and_dead_zone() -> None:
    for block, args, exact in (
        ("Saturation", "low = -0.5, high = 0.8", lambda u: np.clip(u, -0.5, 0.8)),
        ("DeadZone", "width = 0.3", lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0)),
    ):
        r = run("blocks", block, args, "u := sin(3 [1/s]*time)", 4)
        assert np.asarray(r["y"]) == pytest.approx(exact(np.sin(3 * r.t)), abs=1e-12)


def test_rate_limit() -> None:
    """At the limit until what is missing is rise*T, then a lag; the other way likewise."""
    for u, rate in ((1.0, 2.0), (-1.0, -0.5)):
        r = run("blocks", "RateLimit", "rise = 2, fall = 0.5, T = 0.1 [s]", f"u := {u}", 3)
        turn = (u - rate * 0.1) / rate
        exact = np.where(r.t < turn, rate * r.t, u - rate * 0.1 * np.exp(-(r.t - turn) / 0.1))
        assert np.asarray(r["y"]) == pytest.approx(exact, abs=1e-7)


def test_pid_within_its_limits() -> None:
    """u = -(Kp + Ki/s + Kd s/(Tf s + 1)) Y for r = 0; the setpoint comes in with weights b and c."""
    kp, ki, kd, tf, w = 2.0, 3.0, 0.5, 0.1, 4.0
    lag, sine = tf * S + 1, S**2 + w**2
    args = f"Kp = {kp}, Ki = {ki}, Kd = {kd}, Tf = {tf} [s], b = 0.6, c = 0.2"
    for coupling, top, sign, b, c in (
        (f"r := 0, y := sin({w} [1/s]*time)", w, -1, 1.0, 1.0),
        (f"r := sin({w} [1/s]*time), y := 0", w, 1, 0.6, 0.2),
    ):
        r = run("blocks", "PID", args, coupling, 3)
        num = (b * kp * S * lag + ki * lag + c * kd * S**2) * top
        _, exact = impulse((num.coef[::-1], (S * lag * sine).coef[::-1]), T=r.t)
        assert sign * np.asarray(r["u"]) == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("block", ["PI", "PID"])
def test_the_integral_is_drawn_back(block: str) -> None:
    """For a constant error the integral grows until u is at its limit, then goes to high - Kp e + Ki e Tt within Tt."""
    kp, ki, high, tt = 1.0, 2.0, 3.0, 0.25
    more = ", Kd = 0, Tf = 1 [s]" if block == "PID" else ""
    r = run("blocks", block, f"Kp = {kp}, Ki = {ki}, high = {high}, Tt = {tt} [s]{more}", "r := 1, y := 0", 3)
    turn, last = (high - kp) / ki, high - kp + ki * tt
    exact = np.where(r.t < turn, ki * r.t, last + (high - kp - last) * np.exp(-(r.t - turn) / tt))
    assert np.asarray(r["i"]) == pytest.approx(exact, abs=1e-7)
    assert np.asarray(r["u"]) == pytest.approx(np.minimum(kp + exact, high), abs=1e-7)


# ---- references ----------------------------------------------------------------------------------


def test_step_and_ramp() -> None:
    r = run("references", "Step", "y1 = 3, y0 = 1, t0 = 1.05 [s]", "", 2)
    assert np.array_equal(np.asarray(r["y"]), np.where(r.t < 1.05, 1, 3))
    r = run("references", "Ramp", "slope = 2, y0 = 1, t0 = 0.5 [s], t1 = 1.5 [s]", "", 2)
    assert np.asarray(r["y"]) == pytest.approx(1 + 2 * np.clip(r.t - 0.5, 0, 1), abs=1e-12)


def test_sine() -> None:
    r = run("references", "Sine", "w = 3, A = 2, offset = 1, phase = 0.5", "", 2)
    e = 2 * np.exp(1j * (3 * r.t + 0.5))
    assert np.asarray(r["y"]) == pytest.approx(1 + e.imag, abs=1e-12)
    assert np.asarray(r["rate"]) == pytest.approx((3j * e).imag, abs=1e-12)


def test_point_to_point() -> None:
    """The polynomial of degree 5 with six conditions: value, rate and acceleration at both ends."""
    r = run("references", "PointToPoint", "n = 2, y0 = [1, 0], y1 = [4, -1], T = 2 [s], t0 = 0.5 [s]", "", 3)
    conditions = [Polynomial.basis(k).deriv(d)(s) for s in (0, 1) for d in (0, 1, 2) for k in range(6)]
    p = Polynomial(np.linalg.solve(np.reshape(conditions, (6, 6)), [0, 0, 0, 1, 0, 0]))
    s, d = np.clip((r.t - 0.5) / 2, 0, 1)[:, None], np.array([3.0, -1.0])
    assert np.asarray(r["y"]) == pytest.approx([1, 0] + d * p(s), abs=1e-12)
    assert np.asarray(r["rate"]) == pytest.approx(d * p.deriv()(s) / 2, abs=1e-12)
    assert np.asarray(r["acceleration"]) == pytest.approx(d * p.deriv(2)(s) / 4, abs=1e-12)


def test_circle_and_figure_eight() -> None:
    """As complex numbers, whose derivatives are products."""
    r = run("references", "Circle", "r = 2 [m], w = 3, centre = [1, -1], phase = 0.4", "", 2)
    e = 2 * np.exp(1j * (3 * r.t + 0.4))
    for name, z in (("p", 1 - 1j + e), ("v", 3j * e), ("a", -9 * e)):
        assert np.asarray(r[name]) == pytest.approx(np.column_stack([z.real, z.imag]), abs=1e-12)
    r = run("references", "FigureEight", "A = 2 [m], B = 3 [m], w = 0.5, centre = [1, -1]", "", 2)
    for k, name in enumerate(("p", "v", "a")):
        x, y = ((a * (1j * w) ** k * np.exp(1j * w * r.t)).imag for a, w in ((2, 0.5), (3, 1.0)))
        middle = [1, -1] if name == "p" else [0, 0]
        assert np.asarray(r[name]) == pytest.approx(np.column_stack([x, y]) + middle, abs=1e-12)


# ---- drives --------------------------------------------------------------------------------------


def test_motor() -> None:
    R, L, k, J, b, V, load_ = 2.0, 0.01, 0.06, 2e-4, 1e-4, 12.0, 0.05
    args = f"R = {R} [Ω], L = {L} [H], k = {k} [N*m/A], J = {J} [kg*m^2], b = {b} [N*m*s/rad], i0 = 0.5 [A]"
    r = run("drives", "DCMotor", args, f"voltage := {V} [V], load := {load_} [N*m]", 0.3)
    whole = np.array([[0, 1, 0, 0], [0, -b / J, k / J, -load_ / J], [0, -k / L, -R / L, V / L], [0] * 4])
    exact = np.array([expm(whole * t) @ [0, 0, 0.5, 1] for t in r.t])
    for j, name in enumerate(("th", "w", "i")):
        assert np.asarray(r[name]) == pytest.approx(exact[:, j], rel=1e-8, abs=1e-8)


def test_gear_keeps_power() -> None:
    inputs = "th_in := 3 [rad], w_in := 50 [rad/s], torque_in := 0.2 [N*m]"
    r = run("drives", "Gear", "ratio = 20, efficiency = 0.8", inputs, 1)
    assert r("th", 0.5) == pytest.approx(0.15)
    assert r("torque", 0.5) * r("w", 0.5) == pytest.approx(0.8 * 50 * 0.2)
    assert r("w", 0.5) == pytest.approx(2.5)


def test_torque_drive() -> None:
    r = run("drives", "TorqueDrive", "T = 0.2 [s], limit = 3 [N*m]", "command := 5 [N*m]", 1)
    assert np.asarray(r["torque"]) == pytest.approx(3 * (1 - np.exp(-r.t / 0.2)), abs=1e-9)


def test_two_inertias_on_a_shaft_swing_at_their_frequency() -> None:
    r = load(f"""
        from std.drives import ElasticShaft;
        agent Inertia(real J [kg*m^2], real w0 [rad/s] = 0) {{
          read real torque [N*m];
          write real th [rad] = 0, w [rad/s] = w0;
          diff {{ th' = w; w' = torque/J; }}
        }}
        agent Pair() {{
          agent a = Inertia(J = 2 [kg*m^2], w0 = 1) [torque := -shaft.torque];
          agent b = Inertia(J = 3 [kg*m^2]) [torque := shaft.torque];
          agent shaft = ElasticShaft(c = 40, d = 0.6) [th_in := a.th, w_in := a.w, th_out := b.th, w_out := b.w];
        }}
        experiment e of Pair() {{ stop = 3; {TIGHT} }}
    """).simulate()
    reduced = 2 * 3 / 5
    sigma = 0.6 / (2 * reduced)
    w = np.sqrt(40 / reduced - sigma**2)
    twist = np.exp(-sigma * r.t) * np.sin(w * r.t) / w
    assert np.asarray(r["a.th"]) - np.asarray(r["b.th"]) == pytest.approx(twist, abs=1e-9)
    assert 2 * np.asarray(r["a.w"]) + 3 * np.asarray(r["b.w"]) == pytest.approx(
        np.full(r.t.size, 2.0), abs=1e-9
    )


def test_friction() -> None:
    model = load("""
        from std.drives import friction;
        agent A() { write real x = 0; diff { x' = friction(x, 0.5, 2, 0.1); } }
    """)
    for w, wanted in ((3.0, 3.5), (-3.0, -3.5), (0.0, 0.0), (0.05, 0.025 + 2 * np.tanh(0.5))):
        assert model.rhs(0.0, [w])[0] == pytest.approx(wanted, rel=1e-12)


# ---- vehicles ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("block", "args", "coupling", "v", "om"),
    [
        ("Unicycle", "", "v := 2 [m/s], om := 0.5 [rad/s]", 2.0, 0.5),
        ("DifferentialDrive", "r = 0.1 [m], track = 0.4 [m], ", "left := 8 [rad/s], right := 12 [rad/s]", 1.0, 1.0),
        ("CarLike", "wheelbase = 2.5 [m], ", "v := 5 [m/s], steer := 0.3 [rad]", 5.0, 5 * np.tan(0.3) / 2.5),
    ],
)  # fmt: skip
def test_vehicles_drive_circles(block: str, args: str, coupling: str, v: float, om: float) -> None:
    r = run("vehicles", block, f"{args}x0 = 1 [m], y0 = -2 [m], th0 = 0.7", coupling, 4)
    exact = 1 - 2j + v / (1j * om) * np.exp(0.7j) * (np.exp(1j * om * r.t) - 1)
    assert np.asarray(r["x"]) == pytest.approx(exact.real, abs=1e-9)
    assert np.asarray(r["y"]) == pytest.approx(exact.imag, abs=1e-9)
    assert np.asarray(r["th"]) == pytest.approx(0.7 + om * r.t, abs=1e-9)


def test_a_car_whose_tyres_slip() -> None:
    """The turn that the textbook's understeer gradient gives, and the way there by the matrix exponential."""
    m, J, lf, lr, cf, cr, v, steer = 1400.0, 2200.0, 1.1, 1.6, 7e4, 9e4, 20.0, 0.02
    args = (
        f"m = {m} [kg], J = {J} [kg*m^2], lf = {lf} [m], lr = {lr} [m], cf = {cf} [N/rad], cr = {cr} [N/rad]"
    )
    r = run("vehicles", "SingleTrack", args, f"v := {v} [m/s], steer := {steer} [rad]", 5)
    gradient = m / (lf + lr) * (lr / cf - lf / cr)
    assert r("om", 5.0) == pytest.approx(v * steer / (lf + lr + gradient * v**2), rel=1e-6)
    A = np.array([
        [-(cf + cr) / (m * v), -v - (lf * cf - lr * cr) / (m * v)],
        [-(lf * cf - lr * cr) / (J * v), -(lf**2 * cf + lr**2 * cr) / (J * v)],
    ])  # fmt: skip
    whole = np.block([[A, np.array([[cf * steer / m], [lf * cf * steer / J]])], [np.zeros((1, 3))]])
    exact = np.array([expm(whole * t)[:2, 2] for t in r.t])
    assert np.asarray(r["vy"]) == pytest.approx(exact[:, 0], abs=1e-9)
    assert np.asarray(r["om"]) == pytest.approx(exact[:, 1], abs=1e-9)
    speed = np.asarray(r["vy"])[1:] * 1j + v
    heading = np.exp(1j * np.asarray(r["th"])[1:])
    step = np.diff(np.asarray(r["x"]) + 1j * np.asarray(r["y"]))
    assert (
        np.abs(step / np.diff(r.t) - speed * heading).max() < 0.02
    )  # to the first order of the time between rows


# ---- arms ----------------------------------------------------------------------------------------


def arm(n: int, functions: tuple[str, ...], calls: str) -> Model:
    """States q, v; derivatives of a, b, c, p, s are what functions give for them."""
    return load(f"""
        from std.arms import {", ".join(functions)};
        agent Arm(int n, real[n] l, real[n] m, real[n] c, real[n] J) {{
          write real[n] q = zeros(n), v = zeros(n), a = zeros(n), b = zeros(n), c0 = zeros(n);
          write real[2] p = [0, 0], s = [0, 0];
          diff {{ q' = zeros(n); v' = zeros(n); {calls} }}
        }}
        experiment e of Arm(n = {n}, l = {LENGTH[:n]}, m = {MASS[:n]}, c = {CENTRE[:n]}, J = {INERTIA[:n]}) {{ }}
    """)


LENGTH, MASS, CENTRE, INERTIA, G = (
    [0.8, 0.6, 0.5, 0.3],
    [4.0, 3.0, 2.0, 1.5],
    [0.3, 0.35, 0.2, 0.1],
    [0.2, 0.1, 0.05, 0.02],
    9.81,
)
ANY = """a' = mass(q, l, m, c, J)*v; b' = coriolis(q, v, l, m, c); c0' = gravity(q, l, m, c, 9.81);
         p' = fk(q, l); s' = jacobian(q, l)*v;"""
TWO = """a' = mass2(q, l, m, c, J)*v; b' = bias2(q, v, l, m, c, 0); c0' = bias2(q, zeros(2), l, m, c, 9.81);
         p' = fk2(q, l); s' = jacobian2(q, l)*v;"""


def lagrange(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """mass*v, coriolis torques, gravity, tip and its velocity from the energies of the links, differentiated by sympy."""
    import sympy

    n = len(q)
    angles, rates = sympy.symbols(f"q:{n}"), sympy.symbols(f"v:{n}")
    at, kinetic, potential = sympy.zeros(2, 1), sympy.Integer(0), sympy.Integer(0)
    for k in range(n):
        turn = sum(angles[: k + 1])
        along = sympy.Matrix([sympy.cos(turn), sympy.sin(turn)])
        centre = at + CENTRE[k] * along
        velocity = centre.jacobian(angles) * sympy.Matrix(rates)
        kinetic += MASS[k] * velocity.dot(velocity) / 2 + INERTIA[k] * sum(rates[: k + 1]) ** 2 / 2
        potential += MASS[k] * G * centre[1]
        at = at + LENGTH[k] * along
    momenta = sympy.Matrix([kinetic]).jacobian(rates).T
    coriolis = momenta.jacobian(angles) * sympy.Matrix(rates) - sympy.Matrix([kinetic]).jacobian(angles).T
    gravity = sympy.Matrix([potential]).jacobian(angles).T
    found = (momenta, coriolis, gravity, at, at.jacobian(angles) * sympy.Matrix(rates))
    values = dict(zip((*angles, *rates), (*q, *v), strict=True))
    return tuple(np.array(matrix.evalf(20, subs=values), float).ravel() for matrix in found)


@pytest.mark.parametrize(
    ("n", "functions", "calls"),
    [
        *((n, ("mass", "coriolis", "gravity", "fk", "jacobian"), ANY) for n in (1, 2, 4)),
        (2, ("mass2", "bias2", "fk2", "jacobian2"), TWO),
    ],
)
def test_arms_are_what_lagrange_says(n: int, functions: tuple[str, ...], calls: str) -> None:
    model = arm(n, functions, calls)
    rng = np.random.default_rng(n)
    for _ in range(3):
        q, v = rng.uniform(-3, 3, n), rng.uniform(-2, 2, n)
        rates = model.rhs(0.0, np.concatenate([q, v, np.zeros(3 * n + 4)]))[2 * n :]
        assert rates == pytest.approx(np.concatenate(lagrange(q, v)), rel=1e-12, abs=1e-12)


# ---- the files and their page --------------------------------------------------------------------


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_files_are_right_and_laid_out(file: Path) -> None:
    from hierc.compiler.driver import check_source

    text = read_file(file)
    for strict in (False, True):
        found = check_source(text.source, reader=text.finder, strict_units=strict)
        assert {problem.code for problem in found} <= {"W013"}  # a step is a jump
    assert format_source(text.source, 100) == text.source.text


def test_every_agent_is_explained_and_tested_here() -> None:
    tested = Path(__file__).read_text(encoding="utf-8")
    for file in FILES:
        agents = re.findall(r"^agent (\w+)", read_source(file).text, re.MULTILINE)
        assert len(re.findall(r"^///.*\nagent ", read_source(file).text, re.MULTILINE)) == len(agents)
        assert [
            name for name in agents if f'"{name}"' not in tested and f"import {name};" not in tested
        ] == []


def test_the_library_is_installed_with_the_models() -> None:
    import tomllib

    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    folder = ROOT / "models"
    found = {file for pattern in data["hierc.models"] for file in folder.glob(pattern)}
    assert {file for file in found if file.suffix == ".hier"} == {
        Path(name) for name in model_files([str(folder)])
    }


def make_std() -> object:
    spec = importlib.util.spec_from_file_location("make_std", ROOT / "docs" / "make_std.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_up_to_date(request: pytest.FixtureRequest) -> None:
    page = make_std().page()  # type: ignore[attr-defined]
    if request.config.getoption("--accept"):
        (ROOT / "docs" / "std.md").write_text(page, encoding="utf-8")
    assert (ROOT / "docs" / "std.md").read_text(encoding="utf-8") == page


def test_the_example_of_the_page_settles_at_its_setpoint() -> None:
    page = (ROOT / "docs" / "std.md").read_text(encoding="utf-8")
    example = re.search(r"^```hier\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert example is not None
    r = load(example[1]).simulate(stop=10.0)
    assert r("plant.y", 10.0) == pytest.approx(1.0, abs=1e-5)
    assert np.asarray(r["controller.u"]).max() <= 4
