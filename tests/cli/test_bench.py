"""`hierc bench`: errors are what they are said to be, solvers that fail are told, and what cannot be compared is refused."""

from __future__ import annotations

import json
import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hierc
from hierc import bench, bench_solvers, cli
from hierc.bench import Bench, Run
from hierc.exits import UsageError

DECAY = """
agent Pace(real k = 2) { write real x = 1; write real y; alge { y = 3*x; } diff { x' = -k*x; } }
agent Follower() { read real y; write real[2] z = [0, 5]; diff { z[1]' = y; z[2]' = 0; } }
agent Two() {
  level a { agent a = Pace(); }
  level b { agent b = Follower() [y := a.y]; }
}
experiment e of Two() { stop = 2 [s]; }
"""
SETTINGS = {"start": 0.0, "stop": 2.0, "max_step": math.inf}


def exact(t: np.ndarray) -> np.ndarray:
    return np.stack([np.exp(-2 * t), 1.5 * (1 - np.exp(-2 * t)), np.full_like(t, 5.0)], axis=1)


@pytest.fixture(scope="module")
def found() -> Bench:
    return bench.bench(hierc.load(DECAY), SETTINGS, (1e-3, 1e-6))


def test_errors_are_those_against_the_exact_solution(found: Bench) -> None:
    """scipy's runs done again by hand, on equations written by hand."""
    t = np.linspace(0.0, 2.0, 101)
    assert found.agreement is not None
    assert found.agreement < 1e-11
    for method in ("RK45", "DOP853", "Radau"):
        for tolerance in (1e-3, 1e-6):
            run = next(r for r in found.runs if r.solver == f"scipy {method}" and r.tolerance == tolerance)
            own = solve_ivp(
                lambda _, x: [-2 * x[0], 3 * x[0], 0.0], (0.0, 2.0), [1.0, 0.0, 5.0], method,
                t_eval=t, rtol=tolerance, atol=tolerance,
            )  # fmt: skip
            error = (np.abs(own.y.T - exact(t)) / np.abs(exact(t)).max(axis=0)).max()
            assert run.error == pytest.approx(error, rel=1e-3, abs=1e-11)
            assert run.evaluations[0] >= own.nfev  # Radau does not count those for its Jacobians
            assert (method == "Radau") is (run.evaluations[0] > own.nfev)


def test_our_runs_have_the_error_that_they_were_asked_for(found: Bench) -> None:
    ours = [r for r in found.runs if r.solver.startswith("hierc")]
    assert [(r.solver, r.tolerance) for r in ours] == [
        (name, tolerance) for name in ("hierc", "hierc, one group") for tolerance in (1e-3, 1e-6)
    ]
    assert all(r.error is not None and r.error < r.tolerance for r in ours)
    assert all(r.seconds for r in ours)
    assert len(ours[2].evaluations) == 1


def test_states_are_brought_into_one_order() -> None:
    """Two arrays whose groups take turns in the cascade."""
    text = """
agent Head() { write real x = 1; diff { x' = -x; } }
agent Cell(real c = 1) { read real u; write real x = c; write real v = -c; diff { x' = u - x; v' = x; } }
agent Rows() {
  level h { agent h = Head(); }
  level a { agent a[i in 1..3] = Cell(c = i) [u := h.x]; }
  level b { agent b[i in 1..3] = Cell(c = 10*i) [u := a[i].x]; }
}
"""
    problem = bench._problem(hierc.load(text), SETTINGS)
    order = bench_solvers.order(problem.levels, problem.system)
    assert [problem.levels.state_names[k] for k in order] == list(problem.system.state_names)
    x = problem.initial
    assert dict(zip(problem.system.state_names, x, strict=True))["a[3].v"] == -3.0
    levels = np.empty(len(x))
    levels[order] = x
    assert problem.derivatives(0.7, x).tobytes() == problem.levels.rhs(0.7, levels)[order].tobytes()


def test_a_solver_that_takes_too_long_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "WITNESSES", ())
    found = bench.bench(hierc.load(DECAY), SETTINGS, (1e-3, 1e-6), limit=1e-9)
    late = [r for r in found.runs if r.solver == "scipy LSODA"]
    assert [r.failure for r in late] == ["took longer than 1e-09 s"]
    assert found.cheapest("scipy LSODA", 1.0) is None
    assert "no other solver came to an end that could confirm it" in bench.report(found)


def test_a_solver_that_fails_is_told() -> None:
    """The solution leaves the doubles at t = 1, where ours is told to stop before."""
    model = hierc.load("agent Burst() { write real x = 1; diff { x' = x^2; } }")
    problem = bench._problem(model, {**SETTINGS, "stop": 2.0})
    for name, solver in bench_solvers.solvers().items():
        failure = bench._solved(solver, problem, 1e-6, 5.0)
        assert isinstance(failure, bench_solvers.Failed), name
        assert str(failure)
    with pytest.raises(UsageError, match="nothing to compare with"):
        bench.bench(model, {**SETTINGS, "stop": 2.0}, (1e-3,), limit=5.0)


RUNS = (
    Run("hierc", 1e-3, 1e-4, 2e-3, (5,)),
    Run("hierc", 1e-6, 1e-8, 1e-3, (9,)),
    Run("scipy Radau", 1e-3, 2e-2, 5e-3, (50,)),
    Run("scipy Radau", 1e-6, None, None, (), "gave up\nat t = 1"),
)


def test_the_table_has_the_cheapest_run_within_each_error() -> None:
    """Errors that the reference does not resolve are left out."""
    text = bench.report(Bench("M", 3, 2.0, "scipy DOP853", 1e-8, RUNS))
    assert text.splitlines()[:4] == [
        "M: 3 states, to 2 s; CPU ms at an error of",
        "               0.001  1e-05  1e-07           failed",
        "  hierc            1      1      1",
        "  scipy Radau      -      -      -  1 of 2: gave up",
    ]
    assert "scipy DOP853 differs by 1.0e-08" in text


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "two.hier").write_text(DECAY)
    drawing = tmp_path / "b.svg"
    arguments = ["bench", str(tmp_path / "two.hier"), "--tolerances", "1e-3,1e-5", "-p", "a.k=3", "--json"]
    assert cli.main([*arguments, "-o", str(drawing)]) == 0
    output = capsys.readouterr()
    data = json.loads(output.out)
    assert data["states"] == 3
    assert {run["tolerance"] for run in data["runs"]} == {1e-3, 1e-5}
    assert "scipy LSODA" in output.err
    assert drawing.read_text().count("scipy LSODA") >= 1


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("agent A() { write real y; alge { y = 3*time; } }", ["--stop", "1"], "no states"),
        ("agent A() { write real x = 1; diff { x' = -x; } }", [], "how long should it run"),
        ("agent A() { write real x = 1; diff { x' = -x; } }", ["--stop", "1", "-o", "b.csv"], ".svg"),
        ("agent A(real k = 0) { write real x = 1/k; diff { x' = -x; } }", ["--stop", "1"], "not all finite"),
    ],
)
def test_what_cannot_be_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, options: list[str], said: str
) -> None:
    (tmp_path / "a.hier").write_text(text)
    assert cli.main(["bench", str(tmp_path / "a.hier"), *options]) == 2
    assert said in capsys.readouterr().err


def test_without_scipy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "scipy" else find_spec(name))
    (tmp_path / "two.hier").write_text(DECAY)
    assert cli.main(["bench", str(tmp_path / "two.hier")]) == 2
    assert "pip install scipy" in capsys.readouterr().err


def test_others_are_run_where_they_are_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    for there in (True, False):
        monkeypatch.setattr(bench_solvers, "find_spec", lambda _, there=there: there)
        assert ("SUNDIALS CVODE BDF" in bench_solvers.solvers()) is there


@pytest.mark.skipif(find_spec("sksundae") is None, reason="needs scikit-sundae")
@pytest.mark.parametrize("method", ["Adams", "BDF"])
def test_cvode(method: str) -> None:
    problem = bench._problem(hierc.load(DECAY), SETTINGS)
    solved = bench_solvers.solvers()[f"SUNDIALS CVODE {method}"](problem, 1e-8, 10.0)
    assert solved.states == pytest.approx(exact(problem.times), abs=1e-6)
    with pytest.raises(bench_solvers.TooLong):
        bench_solvers.solvers()[f"SUNDIALS CVODE {method}"](problem, 1e-8, 1e-9)
