"""Models as a newcomer writes them, in `examples/`: plain numbers, files beside them, experiments with settings. They compile and run as they stand."""

from __future__ import annotations

import re
import shutil
import warnings
from pathlib import Path

import byhand
import numpy as np
import pytest
from layout import Floats, Layout
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import hierc
from hierc.cli import main
from hierc.runtime.model import Model

FOLDER = Path(__file__).parent / "examples"
#: What the compiler says of each.
WARNINGS = {
    "cart": [],
    "arm": ["W010"],  # watching invariants
    "platoon": [],
    "servo": [],
    "boat": ["W512", "W512", "W013"],  # imports that nothing uses; the moment of a jump
}


def load(name: str) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return hierc.load(FOLDER / f"{name}.hier")


def platoon(t: float, x: byhand.States) -> byhand.Derivatives:
    i = np.arange(1, 101)
    places, speeds = (np.concatenate([[x[f"lead.{q}"]], x[f"car.{q}"]]) for q in "xv")
    command = -np.diff(places) - 10 - 1.5 * np.diff(speeds) + 0.2 * (speeds[0] - speeds[1:])
    return {
        "lead.x": x["lead.v"],
        "lead.v": (25 * -np.expm1(-t / 20) - x["lead.v"]) / 5,
        "car.x": x["car.v"],
        "car.v": x["car.a"],
        "car.a": (x["car.u"] - x["car.a"]) * (1 + i % 7) / 0.3,
        "car.u": (20 + 180 * i / 100) * (command - x["car.u"]),
    }


def boat(t: float, x: byhand.States) -> byhand.Derivatives:
    rpm, thrust = np.genfromtxt(FOLDER / "data" / "thrust.csv", delimiter=",", skip_header=1).T
    push = PchipInterpolator(rpm, thrust)(np.clip(x["engine.y"], 0, 3200))
    v = x["v"]
    return {
        "engine.y": (3000 * (0.2 if t < 2 else 1) - x["engine.y"]) / 0.4,
        "v": (push - 3.5 * v * abs(v) - 12 * np.tanh(v / 0.05)) / 80,
    }


BY_HAND = {"cart": byhand.cart, "arm": byhand.arm, "platoon": platoon, "servo": byhand.servo, "boat": boat}
#: A scale for states that are far from 1.
SPREADS: dict[str, ArrayLike] = {"engine.y": 1500.0}


@pytest.mark.parametrize("name", BY_HAND)
def test_they_mean_what_they_say(name: str) -> None:
    model = load(name)
    layout = Layout.of(model.states)
    start = layout.split(model.initial())
    rng = np.random.default_rng(7)
    for t in (0.0, 1.9, 2.1, 30.0):
        x = {q: v + rng.normal(size=v.shape) * SPREADS.get(q, 0.5) for q, v in start.items()}
        found = layout.split(model.rhs(t, layout.joined(x)))
        expected = layout.split(layout.joined(BY_HAND[name](t, x)))
        for q, values in expected.items():
            assert found[q] == pytest.approx(values, rel=1e-10, abs=1e-12 * max(1, np.abs(values).max())), q


@pytest.mark.parametrize("name", BY_HAND)
def test_they_run_as_they_stand(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(FOLDER, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    output = ["-o", "out.csv"] * (name != "cart")  # which says itself what it saves
    assert main(["run", f"{name}.hier", *output]) == 0
    assert re.findall(r"(?m)^(?:error|warning)\[(\w+)]", capfd.readouterr().err) == WARNINGS[name]
    written = np.genfromtxt(tmp_path / ("figure8.csv" if name == "cart" else "out.csv"), delimiter=",")[1:]
    assert np.isfinite(written).all()
    assert written[-1, 0] == {"cart": 50, "platoon": 60, "boat": 20}.get(name, 10)


def test_the_platoon_of_a_hundred_cars_against_another_solver() -> None:
    """Ten of its seconds. Each car takes its own steps; the other solver takes all of them together."""
    model = load("platoon")
    layout = Layout.of(model.states)
    r = model.simulate(stop=10, interval=1, rtol=1e-7)

    def rhs(t: float, x: Floats) -> Floats:
        return layout.joined(platoon(t, layout.split(x)))

    reference = solve_ivp(rhs, (0, 10), model.initial(), "DOP853", r.t, rtol=1e-10, atol=1e-10).y.T
    found = np.column_stack([r[state] for state in model.states])
    assert np.all(np.abs(found - reference) <= 1e-6 * (np.abs(reference) + 1))


def test_the_boat_starts_where_its_experiment_says_and_reaches_its_speed() -> None:
    r = load("boat").simulate()
    assert r["v"][0] == 1.5
    assert boat(20, {"engine.y": np.array(3000.0), "v": r["v"][-1]})["v"] == pytest.approx(0, abs=2e-2)
    assert r("v", 2.0) < 4 < 9 < r["v"][-1]
