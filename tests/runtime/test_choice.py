"""The choice of a method follows predicted cost: it is explicit where linear algebra would cost most and nothing is stiff."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hierc
from hierc.runtime.choice import COSTS, EXPLICIT, FAVOURITE, Probe, choose, predicted_cost, spectral_radius

SMALL = Probe(
    step=1.0,
    spectral_radius=lambda: 1.0,
    states=4,
    flops=50,
    updates=20,
    entries=12,
    linear=False,
    tolerance=1e-6,
)


def test_small_groups_are_implicit() -> None:
    assert choose(SMALL) == FAVOURITE


def test_large_dense_groups_are_explicit_unless_stiff() -> None:
    large = replace(SMALL, states=60, flops=4000, updates=70_000, entries=3600)
    assert choose(large) == "adams"  # what is not checked between knots is taken by name only
    assert choose(replace(large, spectral_radius=lambda: 1e5)) == FAVOURITE


def test_very_costly_right_hand_sides_are_left_to_adams_unless_stiff() -> None:
    """Where linear algebra costs much too, and where each evaluation calls into Python: two evaluations a step are the least there are."""
    large = replace(SMALL, states=100, flops=150_000, updates=330_000, entries=10_000)
    called_back = replace(SMALL, calls=3)
    for costly in (large, called_back):
        assert choose(costly) == "adams"
        assert choose(replace(costly, spectral_radius=lambda: 1e5)) == FAVOURITE


def test_stability_bounds_explicit_steps_only() -> None:
    for name in COSTS:
        ratio = predicted_cost(name, SMALL, 1e6) / predicted_cost(name, SMALL, 1.0)
        assert ratio > 1000 if name in EXPLICIT else ratio == pytest.approx(1.0)


def test_spectral_radius() -> None:
    rotation = np.array([[0.0, 3.0], [-3.0, 0.0]])
    assert spectral_radius([np.diag([1.0, -7.0]), rotation]) == pytest.approx(7.0)
    assert spectral_radius([rotation]) == pytest.approx(3.0)
    wide = np.diag(np.arange(100.0))
    assert spectral_radius([wide]) >= 99.0


def test_a_run_reports_its_choice() -> None:
    """A dense, slow group of 40 states goes explicit on its own; a stiff one of the same form does not."""
    text = """agent Crowd(real c = 1) {{
  write real[40] x = [0.1*i for i in 1..40];
  let s = sum(x);
  diff {{ for i in 1..40 {{ x[i]' = 0.02*sin(s*x[i]) {extra}; }} }}
}}"""
    loose = hierc.load(text.format(extra="")).simulate(stop=2.0)
    stiff = hierc.load(text.format(extra="- 1e5*(x[i] - cos(1 [1/s]*time))")).simulate(stop=2.0)
    assert {s.method for s in loose.stats.values()} == {"adams"}
    assert {s.method for s in stiff.stats.values()} == {FAVOURITE}


SPRINGS = """
def compiled(x):
    return x + 0.3*x**3

def counted(x, made=[]):
    made.append(x)
    return x + 0.3*x**3
"""
MASS = """
extern real spring(real x) = "springs_of_a_test:{name}";
agent Mass() {{
  write real x = 1, v = 0;
  diff {{ x' = v*1 [1/s]; v' = -spring(x)*1 [1/s]; }}
}}
"""


@pytest.mark.filterwarnings("ignore::hierc.runtime.errors.RunWarning")
def test_a_function_in_python_is_called_as_seldom_as_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over eight lanes it would be called eight times. What is compiled in is no reason to leave the favourite."""
    (tmp_path / "springs_of_a_test.py").write_text(SPRINGS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    (stats,) = hierc.load(MASS.format(name="compiled")).simulate(stop=50.0, rtol=1e-6).stats.values()
    assert stats.method == FAVOURITE
    model = hierc.load(MASS.format(name="counted"))
    (made,) = importlib.import_module("springs_of_a_test").counted.__defaults__
    calls = {}
    for method in ("auto", FAVOURITE, "dop853", "tsit5"):
        made.clear()
        (stats,) = model.simulate(stop=100.0, rtol=1e-8, atol=1e-8, method=method).stats.values()
        assert stats.method == (method if method != "auto" else "adams")
        calls[method] = len(made)
    assert calls["auto"] == min(calls.values())
    assert calls["auto"] < 0.5 * calls[FAVOURITE]
