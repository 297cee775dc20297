"""Values given and shown by name are in the declared unit; equations compute in SI."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import hierc
from hierc import cli
from hierc.runtime.errors import SettingError

COIL = """
agent Coil(real te [ms] = 0.5 [ms], real i0 [A] = 2, real[2] arm [mm] = [3 [cm], 4 [mm]]) {
  write real i [mA] = i0;
  write real[2] hand [mm];
  alge { hand = 2*arm; }
  diff { i' = -i/te; }
}
/// A wheel; its angle is in degrees.
agent Wheel(real speed [rpm] = 120 [rpm]) {
  read real i [mA];
  write real q [deg] = 90 [deg], same [mA];
  alge { same = i; }
  diff { q' = speed*(i/(1 [A]))^0; }
}
agent Drive() { agent coil = Coil(); agent wheel = Wheel() [i := coil.i]; }
experiment fall of Drive(coil.i0 = 500 [mA]) { stop = 1 [ms]; interval = 0.5 [ms]; rtol = 1e-11; }
"""


@pytest.fixture(scope="module")
def drive() -> hierc.Model:
    return hierc.load(COIL)


def test_results_are_in_declared_units(drive: hierc.Model) -> None:
    r = drive.simulate()
    assert r["coil.i"] == pytest.approx(500 * np.exp(-r.t / 0.5e-3), rel=1e-9)
    assert r["wheel.same"] == pytest.approx(r["coil.i"], rel=1e-12)
    assert r["wheel.q"] == pytest.approx(90 + 720 * r.t, rel=1e-12)
    assert r("wheel.q", 0.25e-3) == pytest.approx(90.18, rel=1e-12)
    assert r["coil.hand"][-1] == pytest.approx([60, 8], rel=1e-12)
    assert r.units["coil.i"] == "mA"


def test_parameters_are_in_declared_units(drive: hierc.Model) -> None:
    r = drive.simulate(params={"coil.te": 2, "coil.arm": [1, 5], "wheel.speed": 60})
    assert r["coil.i"] == pytest.approx(500 * np.exp(-r.t / 2e-3), rel=1e-9)
    assert r["coil.hand"][0] == pytest.approx([2, 10])
    assert r["wheel.q"] == pytest.approx(90 + 360 * r.t, rel=1e-12)
    again = hierc.load(COIL, params={"coil.te": 2}).simulate()
    assert np.array_equal(again["coil.i"], r["coil.i"])
    with pytest.raises(SettingError, match="finite"):
        drive.simulate(params={"wheel.speed": math.inf})


def test_the_right_hand_side_is_in_si(drive: hierc.Model) -> None:
    assert drive.initial() == pytest.approx([0.5, math.pi / 2], rel=1e-15)
    assert drive.rhs(0, [0.5, 0]) == pytest.approx([-1000, 4 * math.pi], rel=1e-15)
    assert drive.rhs(0, [0.5, 0], {"coil.te": 1}) == pytest.approx([-500, 4 * math.pi], rel=1e-15)


def test_a_value_reads_the_same_in_any_unit() -> None:
    """The declared unit changes what is shown, never what is computed."""
    other = COIL.replace("i [mA]", "i [A]").replace("q [deg]", "q [rad]").replace("te [ms]", "te [s]")
    a, b = hierc.load(COIL).simulate(), hierc.load(other).simulate(params={"coil.te": 0.5e-3})
    assert np.array_equal(a["coil.i"], b["coil.i"] / 1e-3)
    assert np.array_equal(a["wheel.q"], b["wheel.q"] / math.radians(1))


def test_structural_parameters_are_in_declared_units() -> None:
    """A length that chooses how the model is coupled."""
    text = """agent Two(real gap [mm] = 1 [mm]) {
      write real[if gap > 2.5 [mm] then 2 else 1] x [m] = zeros(if gap > 2.5 [mm] then 2 else 1);
      diff { x' = 0*x/(1 [s]); }
    }"""
    assert len(hierc.load(text).states) == 1
    assert len(hierc.load(text, params={"gap": 3}).states) == 2
    assert len(hierc.load(text, params={"gap": 2}).states) == 1


def test_files_and_options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive.hier").write_text(COIL)
    assert (
        cli.main(["run", "drive.hier", "-o", "r.csv", "--quiet", "-p", "coil.te=1", "--rtol", "1e-10"]) == 0
    )
    with Path("r.csv").open() as file:
        head, *rows = csv.reader(file)
    last = dict(zip(head, map(float, rows[-1]), strict=True))
    assert last["coil.i"] == pytest.approx(500 * math.exp(-1), rel=1e-8)
    assert last["wheel.q"] == pytest.approx(90.72, rel=1e-12)


def test_strict_units_are_not_taken_from_the_cache(capsys: pytest.CaptureFixture[str]) -> None:
    assert hierc.load(COIL).plan.name == "Drive"
    with pytest.raises(hierc.ModelError) as caught:
        hierc.load(COIL, strict_units=True)
    assert [p.code for p in caught.value.problems] == ["E401"]
    assert hierc.load(COIL.replace("i0 [A] = 2", "i0 [A] = 2 [A]"), strict_units=True).plan.name == "Drive"
