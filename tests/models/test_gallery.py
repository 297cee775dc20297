"""The gallery: every model against the same physics written by hand, against another solver, and against what it is there to show."""

from __future__ import annotations

import re
import warnings
from functools import cache
from pathlib import Path

import byhand
import numpy as np
import pytest
from layout import Layout
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_simpson, solve_ivp

import hierc
from hierc.cli import main
from hierc.runtime.model import Model
from hierc.runtime.result import Result

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
LIST = ROOT / "docs" / "models.md"
FILES = {file.stem: file for file in sorted((ROOT / "models").glob("*.hier"))}


@cache
def load(name: str, **params: int) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # invariants are not watched yet
        return hierc.load(name, params=params)


@cache
def run(name: str, **params: int) -> Result:
    """The model's own experiment."""
    return load(name, **params).simulate()


# ---- right-hand sides ----------------------------------------------------------------------------------------------------------------


#: How far from the start to look, by variable, where 0.3 of the start or of 1 is not right.
SPREADS = {"motor.n": 150.0, "hull.v": 2.0}
SIZES: tuple[tuple[str, dict[str, int]], ...] = (
    *((name, {}) for name in FILES),
    ("links", {"n": 1}), ("links", {"n": 2}), ("links", {"n": 3}),
    ("platoon", {"N": 1}), ("platoon", {"N": 3}), ("platoon", {"N": 150}),
    ("snake", {"n": 1}), ("snake", {"n": 3}), ("snake", {"n": 40}),
    ("swarm", {"N": 3}), ("swarm", {"N": 10}), ("swarm", {"N": 200}),
)  # fmt: skip


def test_every_model_is_written_by_hand() -> None:
    assert byhand.MODELS.keys() == FILES.keys()


def test_every_model_is_listed() -> None:
    rows = re.findall(r"(?m)^\| \[`(\w+)`\]\(\.\./models/\1\.hier\) \| .+ \| .+ \|$", LIST.read_text())
    assert rows == list(FILES)


#: Agents or links where nothing else is said.
COUNTS = {"links": 5, "platoon": 10, "swarm": 63}


@pytest.mark.parametrize(("name", "params"), SIZES, ids=str)
def test_runs_start_where_they_should(name: str, params: dict[str, int]) -> None:
    model = load(name, **params)
    found = Layout.of(model.states).split(model.initial())
    expected = byhand.start(name, next(iter(params.values()), COUNTS.get(name, 1)))
    assert expected.keys() <= found.keys()
    for q, values in found.items():
        assert values == pytest.approx(np.broadcast_to(expected.get(q, 0), values.shape), rel=1e-14), q


@pytest.mark.parametrize(("name", "params"), SIZES, ids=str)
def test_right_hand_sides_are_those_written_by_hand(name: str, params: dict[str, int]) -> None:
    model = load(name, **params)
    layout = Layout.of(model.states)
    start = layout.split(model.initial())
    rng = np.random.default_rng(5)
    for t in (0.0, 0.7, 3.0, 64.0):
        x = {
            q: values + rng.normal(size=values.shape) * SPREADS.get(q, 0.3 * np.maximum(1, np.abs(values)))
            for q, values in start.items()
        }
        if name == "boat":  # inside the table
            x = {q: np.abs(values).clip(0, 300) for q, values in x.items()}
        found = layout.split(model.rhs(t, layout.joined(x)))
        expected = layout.split(layout.joined(byhand.MODELS[name](t, x)))
        for q, values in expected.items():
            assert found[q] == pytest.approx(values, rel=1e-10, abs=1e-12 * max(1, np.abs(values).max())), q


# ---- runs ----------------------------------------------------------------------------------------------------------------------------

TOLERANCE = 1e-7
RUNS: tuple[tuple[str, dict[str, int], float], ...] = (
    ("arm", {}, 5), ("boat", {}, 20), ("cart", {}, 5), ("links", {"n": 2}, 5), ("platoon", {"N": 4}, 100),
    ("quadrotor", {}, 6), ("servo", {}, 5), ("snake", {"n": 4}, 6), ("swarm", {"N": 7}, 45),
)  # fmt: skip


def test_every_model_is_run() -> None:
    assert [name for name, _, _ in RUNS] == list(FILES)


@pytest.mark.parametrize(("name", "params", "stop"), RUNS, ids=str)
def test_runs_agree_with_another_solver(name: str, params: dict[str, int], stop: float) -> None:
    model = load(name, **params)
    r = model.simulate(stop=stop, rtol=TOLERANCE)
    found = np.column_stack([r[state] for state in model.states])
    found[:, [r.unit(state) == "rpm" for state in model.states]] *= 2 * np.pi / 60
    method = "DOP853" if name == "boat" else "Radau"
    jacobian = {"jac": model.jacobian} if method == "Radau" else {}
    reference = solve_ivp(
        model.rhs, (0, stop), model.initial(), method, r.t, rtol=1e-10, atol=1e-12, **jacobian
    ).y.T
    assert np.all(np.abs(found - reference) <= 10 * TOLERANCE * (np.abs(reference) + 1))


@pytest.mark.parametrize("name", FILES)
def test_every_model_runs_by_name_anywhere(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", name, "--stop", "0.1", "-o", f"{name}.csv"]) == 0
    head, *rows = (tmp_path / f"{name}.csv").read_text().splitlines()
    assert head.startswith("time,")
    assert len(rows) > 1
    assert "error" not in capfd.readouterr().err


#: Models that show how units may be left out beside numbers.
LOOSE = {"arm", "cart", "servo"}


@pytest.mark.parametrize("name", FILES)
def test_every_model_is_checked_without_a_word(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert FILES[name].read_text().startswith("//")
    assert main(["check", *(() if name in LOOSE else ("--units=strict",)), str(FILES[name])]) == 0
    said = re.findall(r"(?m)^(?:error|warning).*?]", capfd.readouterr().err)
    assert said == (["warning[W010]"] if name == "arm" else [])


# ---- what each model shows -----------------------------------------------------------------------------------------------------------


def size(vectors: ArrayLike) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def test_the_cart_closes_in_and_is_followed() -> None:
    r = run("cart")
    nose = np.column_stack([r["kin.x"] + 0.3 * np.cos(r["kin.th"]), r["kin.y"] + 0.3 * np.sin(r["kin.th"])])
    error = nose - r["plan.p"]
    assert error == pytest.approx(
        error[0] * np.exp(-2 * r.t)[:, None], abs=1e-5
    )  # the loop is linear by design
    settled = r.t > 10
    behind = np.hypot(r["tail.x"] - r["cart.x"], r["tail.y"] - r["cart.y"])[settled]
    lag = np.hypot(r["cart.x"] - r["kin.x"], r["cart.y"] - r["kin.y"])[settled]
    assert behind == pytest.approx(1, abs=0.25)  # a chord of the curve
    assert lag.max() < 0.01


def test_the_servo_lags_as_a_linear_loop_does() -> None:
    r = run("servo")
    lag = np.abs(r["r"] - r["q"])[r.t > 2]
    assert lag.max() == pytest.approx(2**2 / (20**2 + 2**2), rel=1e-3)
    late = np.abs(0.5 * r["i"] - r["tau"])[r.t > 2]
    assert late.max() == pytest.approx(0.5e-3 * 2 * np.abs(r["tau"])[r.t > 2].max(), rel=1e-2)


def test_the_arm_stays_on_its_ellipse() -> None:
    r = run("arm")
    wish, real = (
        0.7 * np.exp(1j * r[f"{name}.q"][:, 0]) + 0.6 * np.exp(1j * r[f"{name}.q"].sum(axis=1))
        for name in ("ik", "arm")
    )
    error = wish - r["plan.p"] @ [1, 1j]
    assert error == pytest.approx(error[0] * np.exp(-5 * r.t), abs=1e-6)  # linear by design, as well
    assert abs(error[0]) > 0.5
    assert np.abs(real - wish)[r.t > 1].max() < 1e-3


def test_the_boat_planes_and_comes_to_a_steady_speed() -> None:
    r = run("boat")
    assert r["hull.v"][-1] > 0.8 * np.sqrt(9.81 * 3.2)
    assert r["hull.push"] == pytest.approx(
        [byhand.thrust(n, v) for n, v in zip(r["motor.n"], r["hull.v"], strict=True)], rel=1e-4, abs=1e-3
    )
    assert np.abs(np.diff(r["hull.v"])[-5:] / np.diff(r.t)[-5:]).max() < 1e-2


def energy(q: Floats, qd: Floats) -> float:
    n = len(q)
    l, m = np.full(n, 0.4), np.full(n, 1.5)
    swing = qd @ byhand.mass_matrix(q, l, m, l / 2, m * l**2 / 12) @ qd / 2
    ends = np.cumsum(0.4 * np.sin(np.cumsum(q)))
    return float(swing + 1.5 * 9.81 * np.sum(ends - 0.2 * np.sin(np.cumsum(q))))


def test_the_arm_of_links_stays_on_its_path_and_its_motors_pay_for_it() -> None:
    r = run("links")
    off = np.abs(r["arm.q"] - r["plan.q"]).max()
    assert 1e-3 < off < 0.02  # what the wrong masses cost
    right = load("links").simulate(params={"arm.error": 0})
    assert np.abs(right["arm.q"] - right["plan.q"]).max() < 1e-6
    t = np.linspace(0, 5, 1001)
    q, qd, tau = (np.asarray(r(f"arm.{name}", t)) for name in ("q", "qd", "tau"))
    work = cumulative_simpson(np.sum(tau * qd, axis=1), x=t, initial=0)
    gained = np.array([energy(*state) for state in zip(q, qd, strict=True)]) - energy(q[0], qd[0])
    assert np.abs(work).max() > 10
    assert gained == pytest.approx(work, abs=1e-4)


def test_a_platoon_damps_what_its_leader_does() -> None:
    r = run("platoon")
    errors = r["car.distance"] - 10
    for measure in (np.abs(errors).max(axis=0), size(errors.T)):
        assert np.all(np.diff(measure) < 0)
    assert r["closest"] == pytest.approx(r["car.distance"].min(axis=1), abs=1e-9)
    assert r["closest"].min() > 7
    assert r["car.v"].min() > -1e-9
    assert r["car.v"][-1] == pytest.approx(25, abs=0.1)


def test_quadrotors_fly_the_eight_and_keep_their_distance() -> None:
    r = run("quadrotor")
    assert r["error"].max() < 0.04
    apart = r["second.p"] - r["first.p"]
    assert size(apart - [-1, 0, 0.5])[r.t > 5].max() < 0.04
    assert np.ptp(r["first.p"], axis=0) == pytest.approx([6, 3, 0], abs=0.05)
    assert r["gap"].min() > 1
    assert np.abs([r["first.yaw"], r["second.yaw"]]).max() < 0.2
    assert r["second.rotor"].min() > 500
    assert r["second.rotor"].max() < 900


def test_a_snake_glides_along_the_track_of_its_head() -> None:
    r = run("snake")
    under_way = r.t > 6
    joint = (r["head.x"] + 1j * r["head.y"] - 0.05 * np.exp(1j * r["head.th"]))[under_way, None]
    links = np.exp(1j * r["link.th"][under_way])
    middles = joint - 0.1 * np.cumsum(links, axis=1) + 0.05 * links
    times = np.linspace(0, 15, 3001)
    track = r("head.x", times) + 1j * r("head.y", times)
    assert np.abs(middles[:, :, None] - track).min(axis=2).max() < 0.03
    bends = np.ptp(r["link.angle"][under_way], axis=0)  # a wave that does not fade
    assert bends == pytest.approx(bends[0], rel=0.05)
    assert np.ptp(track.imag) > 0.2
    assert r["head.x"][-1] > 3.5
    assert r["winding"] == pytest.approx(np.abs(r["link.angle"]).sum(axis=1), abs=1e-9)


def test_a_swarm_gathers_in_its_formation() -> None:
    r = run("swarm")
    belong = byhand.formation(63)
    error = size(r["robot.p"] - r["lead.p"][:, None] - belong).max(axis=1)
    assert error[0] > 30
    assert error[-1] < 0.15
    assert (size(belong[:, None] - belong) + 10 * np.eye(63)).min() == pytest.approx(1)
    late = r["robot.p"][-1].mean(axis=0) - r["ground.seen"][-1]
    assert size(late) == pytest.approx(0.5 * 0.15 * 20, rel=1e-2)
