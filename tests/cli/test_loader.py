"""Loading models from Python: parameters, and a cache that is never wrong."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import hierc
from hierc import loader
from hierc.cli import main

MODEL = """
agent Decay(real tau [s] = 0.5, int n = 2) {
  write real[n] x [m] = [if i == 1 then 1 else 2 for i in 1..n];
  diff { x' = -x/tau; }
}
experiment fall of Decay() { stop = 1 [s]; rtol = 1e-9; atol = 1e-12; }
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "models"


def compiled(text: str = MODEL, **params: object) -> bool:
    return loader.prepare(loader.read(text), None, params).compiled


def test_the_same_model_is_compiled_once(cache: Path) -> None:
    assert compiled()
    assert not compiled()
    assert not compiled(tau=3.0)  # not built into the code
    assert compiled(MODEL.replace("0.5", "0.6"))
    assert not compiled()


def test_structural_parameters_have_modules_of_their_own(cache: Path) -> None:
    assert compiled(n=3)
    assert not compiled(n=3)
    assert compiled()
    assert not compiled(n=3, tau=1.0)
    r = hierc.load(MODEL, params={"n": 3, "tau": 0.25}).simulate()
    assert r["x"].shape[1:] == (3,)
    assert r("x", 1.0) == pytest.approx(np.exp(-4.0) * np.array([1, 2, 2]), rel=1e-7)


@pytest.mark.parametrize("damage", [b"", b"MODEL = 1/0", b"\x00\xff"])
def test_a_damaged_cache_is_made_again(cache: Path, damage: bytes) -> None:
    assert compiled()
    for file in cache.glob("*.py"):
        file.write_bytes(damage)
    assert compiled()
    assert not compiled()


def test_without_a_cache_everything_still_runs(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIERC_CACHE", "")
    assert compiled()
    assert compiled()
    assert not cache.exists()


def test_cache_false_compiles_afresh(cache: Path) -> None:
    assert compiled()
    assert loader.prepare(loader.read(MODEL), None, {}, cache=False).compiled


def test_parameters_given_to_load_are_defaults(cache: Path) -> None:
    model = hierc.load(MODEL, params={"tau": 1.0})
    assert model.simulate()("x[1]", 1.0) == pytest.approx(np.exp(-1.0), rel=1e-7)
    assert model.simulate(params={"tau": 2.0})("x[1]", 1.0) == pytest.approx(np.exp(-0.5), rel=1e-7)
    assert hierc.load(MODEL).simulate()("x[1]", 1.0) == pytest.approx(np.exp(-2.0), rel=1e-7)


def test_unknown_parameters_are_refused(cache: Path) -> None:
    with pytest.raises((ValueError, KeyError, hierc.ModelError), match="tua"):
        hierc.load(MODEL, params={"tua": 1.0})


def test_all_problems_arrive_in_one_error(cache: Path) -> None:
    with pytest.raises(hierc.ModelError) as error:
        hierc.load("agent A() { write real x = 0, y = 0; diff { x' = p; y' = q; } }")
    assert [p.code for p in error.value.problems] == ["E201", "E201"]


def test_a_file_and_a_packaged_model(cache: Path, tmp_path: Path) -> None:
    file = tmp_path / "m.hier"
    file.write_text(MODEL)
    assert hierc.load(file).plan.name == hierc.load(str(file)).plan.name == "Decay"
    assert "cart" in loader.packaged_models()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert hierc.load("cart").plan.name == "Cart4"


def test_the_text_does_not_depend_on_the_cache(cache: Path) -> None:
    text = hierc.compile(MODEL)
    assert hierc.compile(MODEL) == text
    assert loader.run_module(text, "m.hier").MODEL.plan.name == "Decay"


def test_long_arrays_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A structural array is part of the cache's key with all its numbers, and 3 is 3.0."""
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    text = "agent A(int[1200] k = [1 for i in 1..1200]) { write real[2] x = [1, 2]; diff { x' = [x[k[600]], 0]; } }"
    first, second = np.ones(1200, np.int64), np.ones(1200, np.int64)
    second[599] = 2
    derivatives = [hierc.load(text, params={"k": k}).rhs(0.0, [5.0, 7.0])[0] for k in (first, second, first)]
    assert derivatives == [5.0, 7.0, 5.0]


def test_a_path_is_never_taken_for_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "a{b}"
    folder.mkdir()
    (folder / "lag.hier").write_text("agent Lag() { write real x = 1; diff { x' = -x; } }")
    assert main(["check", str(folder / "lag.hier")]) == 0
    assert "no errors" in capsys.readouterr().err
