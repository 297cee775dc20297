"""Whole runs: accuracy against closed forms and an independent solver, counters, and what must not change a single bit."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from running import METHODS, run
from scipy.integrate import solve_ivp
from small_models import DECAY, FOLLOWER, MIXER, OSCILLATOR, PENDULUM, VAN_DER_POL, At, a_class, a_model

import hierc
from hierc.runtime import kernel, layout, simulation
from hierc.runtime.model import Model
from hierc.runtime.run import REMEMBERED, FinishedRun

Floats = NDArray[np.float64]
IMPLICIT = METHODS[:3]

#: Follows a rotation at a stiff rate, and knows its own solution: Prothero and Robinson's problem, spread over two groups.
STIFF_READER = a_class(
    "StiffReader",
    {"x": "-u[1] - p[0]*(x[0] - u[0])"},
    {(0, 0): "-p[0]", (0, 1): "p[0]", (0, 2): "-1.0"},
    start=["1.0"],
    inputs=2,
    values=["q[0]"],
)


def bateman(rates: list[float], t: Floats) -> Floats:
    """x_1' = -k_1 x_1, x_m' = k_m (x_(m-1) - x_m) with x(0) = (1, 0, …), for distinct rates."""
    columns = []
    for m in range(len(rates)):
        scale = math.prod(rates[1 : m + 1])
        terms = [
            np.exp(-rates[i] * t) / math.prod(rates[j] - rates[i] for j in range(m + 1) if j != i)
            for i in range(m + 1)
        ]
        columns.append(scale * np.sum(terms, axis=0))
    return np.stack(columns, axis=1)


STIFF_RATES = [0.3, 2.0, 17.0, 140.0]
MILD_RATES = [0.3, 2.0, 5.0, 11.0]


def cascade(rates: list[float] = STIFF_RATES) -> Model:
    nodes = {"n0": At(DECAY, (), 1)} | {f"n{k}": At(FOLLOWER, ((k - 1, "state", 0),), 1) for k in (1, 2, 3)}
    return a_model(nodes, None, {f"n{k}.rate": rate for k, rate in enumerate(rates)})


def oscillators() -> Model:
    nodes = {f"o{k}": At(OSCILLATOR, (), 1) for k in range(2)}
    return a_model(nodes, None, {"o0.w": 1.0, "o1.w": 9.0})


def stiff_reader() -> Model:
    nodes = {"o": At(OSCILLATOR, (), 1), "r": At(STIFF_READER, ((0, "state", 0), (0, "state", 1)), 1)}
    return a_model(nodes, None, {"o.w": 1.0, "r.rate": 1e5})


def rotations(*rates: float) -> Callable[[Floats], Floats]:
    return lambda t: np.stack([f(w * t) for w in rates for f in (np.cos, np.sin)], axis=1)


PROBLEMS: Mapping[str, tuple[Model, float, Callable[[Floats], Floats]]] = {
    "mild cascade": (cascade(MILD_RATES), 10.0, lambda t: bateman(MILD_RATES, t)),
    "stiff cascade": (cascade(), 10.0, lambda t: bateman(STIFF_RATES, t)),
    "oscillators": (oscillators(), 20.0, rotations(1.0, 9.0)),
    "stiff reader": (stiff_reader(), 10.0, lambda t: np.stack([np.cos(t), np.sin(t), np.cos(t)], axis=1)),
}
#: Error over tolerance. Explicit methods gather phase errors over 29 periods; the dense output of dop853 is poor where stability limits its steps.
ALLOWED = {
    ("oscillators", "abm5"): 700.0, ("oscillators", "tsit5"): 200.0, ("oscillators", "dop853"): 40.0, ("oscillators", "adams"): 20.0,
    ("mild cascade", "dop853"): 100.0, ("stiff cascade", "dop853"): 100.0,
}  # fmt: skip


def states(finished: FinishedRun, t: Floats) -> Floats:
    return np.hstack([g(t) for g in finished.groups])


@pytest.mark.parametrize(
    ("problem", "method"),
    [(p, m) for p in PROBLEMS for m in (*METHODS, "auto") if p != "stiff reader" or m not in METHODS[3:]],
)
def test_achieved_error(problem: str, method: str) -> None:
    """At most ten times the tolerance, at knots and between them, at every tolerance."""
    model, stop, exact = PROBLEMS[problem]
    t = np.linspace(0.0, stop, 1001)
    for tolerance in 10.0 ** -np.arange(3, 11):
        finished = run(model, stop, tolerance, method=method)
        assert finished.status.ok
        assert finished.t_reached == stop
        achieved = np.abs(states(finished, t) - exact(t)).max() / tolerance
        assert achieved <= ALLOWED.get((problem, method), 10.0)


@pytest.fixture(scope="module")
def relaxation() -> tuple[Model, Floats, Floats]:
    """Van der Pol's oscillator through two layers, solved by another code."""
    model = a_model({"v": At(VAN_DER_POL, (), 1)}, None, {"v.mu": 50.0})
    t = np.linspace(0.0, 100.0, 61)
    found = solve_ivp(
        model.rhs, (0.0, 100.0), model.initial(), "Radau", t, rtol=1e-10, atol=1e-11, jac=model.jacobian
    )
    assert found.success
    return model, t, found.y.T


@pytest.mark.parametrize("method", [*IMPLICIT, "auto"])
def test_van_der_pol_against_another_solver(method: str, relaxation: tuple[Model, Floats, Floats]) -> None:
    """Stiff, with layers in which an error of time becomes one of the states, many times as large."""
    model, t, reference = relaxation
    for tolerance in (1e-5, 1e-7):
        finished = run(model, 100.0, tolerance, method=method)
        assert np.abs(states(finished, t)[:, 0] - reference[:, 0]).max() <= 50 * tolerance


@pytest.mark.parametrize("method", METHODS)
def test_pendulum_against_another_solver(method: str) -> None:
    """Three swings of amplitude 2; scipy's own solvers stay within 20 to 200 times their tolerance."""
    model = a_model({"p": At(PENDULUM)})
    t = np.linspace(0.0, 20.0, 101)
    reference = solve_ivp(model.rhs, (0.0, 20.0), model.initial(), "DOP853", t, rtol=1e-13, atol=1e-13).y.T
    most = {"radau5": 20.0, "radau9": 10.0, "radau13": 10.0}.get(method, 300.0)
    for tolerance in (1e-4, 1e-5, 1e-7, 1e-10):
        assert (
            np.abs(states(run(model, 20.0, tolerance, method=method), t) - reference).max()
            <= most * tolerance
        )


# ---- what a run reports ------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_counters(method: str) -> None:
    model = cascade()
    for group in run(model, 10.0, 1e-6, method=method).groups:
        s = group.stats
        assert s["steps"] == len(group.coefficients) == len(group.knots) - 1
        assert (np.diff(group.knots) > 0).all()
        assert group.knots[[0, -1]].tolist() == [0.0, 10.0]
        assert group.method == method
        if method in IMPLICIT:
            assert s["iterations"] >= s["steps"] + s["rejected"]
            assert s["evaluations"] >= s["iterations"] + 1
            assert s["jacobians"] >= s["steps"] + s["rejected"]
            assert s["factorizations"] == s["jacobians"]
        else:
            stages = {"tsit5": 6, "dop853": 12, "adams": 1, "abm5": 1}[method]
            assert s["evaluations"] >= stages * (s["steps"] + s["rejected"]) + 1
            assert s["jacobians"] == s["factorizations"] == 0


@pytest.mark.parametrize("method", METHODS)
def test_trajectories_are_continuous(method: str) -> None:
    for group in run(oscillators(), 20.0, 1e-5, method=method).groups:
        ends = group.coefficients.sum(axis=2)[:-1]
        starts = group.coefficients[1:, :, 0]
        assert ends == pytest.approx(starts, abs=1e-11)


def test_each_group_has_its_own_steps() -> None:
    slow, fast = run(oscillators(), 20.0, 1e-6).groups
    assert 5 * slow.stats["steps"] < fast.stats["steps"]
    assert (
        len(np.intersect1d(slow.knots, fast.knots)) < 5
    )  # the ends, and perhaps one while steps still grow by eights


def test_groups_may_use_different_methods() -> None:
    model = cascade(MILD_RATES)
    t = np.linspace(0, 10, 101)
    for writer in METHODS:
        for reader in METHODS:
            groups = {"n0": {"method": writer}, "n1": {"method": reader}, "n2": {"method": writer}}
            finished = run(model, 10.0, 1e-7, groups)
            assert [g.method for g in finished.groups] == [writer, reader, writer, "radau9"]
            assert np.abs(states(finished, t) - bateman(MILD_RATES, t)).max() < 1e-5


# ---- what must not change a bit ----------------------------------------------------------------


def same(a: FinishedRun, b: FinishedRun) -> bool:
    return all(
        x.knots.tobytes() == y.knots.tobytes()
        and x.coefficients.tobytes() == y.coefficients.tobytes()
        and x.stats == y.stats
        for x, y in zip(a.groups, b.groups, strict=True)
    )


@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_calls_of_any_length(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """How much one call of the kernel does depends on the clock; the result must not."""
    model = oscillators()
    whole = run(model, 60.0, 1e-9, method=method)
    take = simulation.Simulation._slice
    calls: list[int] = []
    for budget in (1, 7, 1000):

        def slice_of_fixed_size(self: simulation.Simulation, budget: int = budget) -> float:
            calls.append(budget)
            self._pace.budget = budget
            return take(self)

        with monkeypatch.context() as patch:
            patch.setattr(simulation.Simulation, "_slice", slice_of_fixed_size)
            assert same(whole, run(model, 60.0, 1e-9, method=method))
    assert calls.count(1) > 100
    assert calls.count(7) > 20


def test_windows_of_any_length(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows only bound how far the early groups run ahead."""
    usual = run(cascade(), 10.0, 1e-8, method="radau5")
    monkeypatch.setenv("HIERC_CACHE", "")
    monkeypatch.setattr(kernel, "WINDOW_STEPS", 1.5)
    assert same(usual, run(cascade(), 10.0, 1e-8, method="radau5"))


@pytest.mark.parametrize("dense", [False, True])
def test_a_choice_that_is_remembered_changes_nothing(dense: bool) -> None:
    """The first run probes, the second knows its methods, and after many others the third probes again."""
    text = """agent Crowd() {
  write real[40] x = [0.1*i for i in 1..40];
  let s = sum(x);
  diff { for i in 1..40 { x[i]' = 0.02*sin(s*x[i]); } }
}"""
    model = hierc.load(text) if dense else cascade()
    first, second = (run(model, 2.0, 1e-5, method="auto") for _ in range(2))
    assert len(model.engine.decided) == 1
    assert (first.groups[0].method == "radau13") is not dense
    for k in range(REMEMBERED):
        run(model, 2.0, 1e-3 * 0.9**k, method="auto")
    assert len(model.engine.decided) == REMEMBERED
    third = run(model, 2.0, 1e-5, method="auto")
    assert same(first, second)
    assert same(first, third)


def test_growing_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that outgrows its room many times, against one that has enough from the start."""
    grown: list[int] = []
    grow = simulation.Simulation._grow

    def counted(self: simulation.Simulation, g: int) -> bool:
        grown.append(g)
        return grow(self, g)

    monkeypatch.setattr(simulation.Simulation, "_grow", counted)
    results = []
    for room in (4096, 1):
        grown.clear()
        monkeypatch.setattr(layout, "_ROOM", room)
        results.append(run(cascade(), 10.0, 1e-9))
    assert same(*results)
    assert set(grown) == {0, 1, 2, 3}
    assert len(grown) > 12


def test_out_of_memory_is_a_status(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "_MOST_BYTES", 300_000)
    finished = run(oscillators(), 1e6, 1e-8)
    assert finished.status.name == "OUT_OF_MEMORY"
    assert 0.0 < finished.t_reached < 1e6
    t = np.linspace(0.0, finished.t_reached, 100)
    assert np.abs(states(finished, t) - rotations(1.0, 9.0)(t)).max() < 1e-4


def fingerprint() -> str:
    """All coefficients of a run."""
    finished = run(oscillators(), 10.0, 1e-7, method="radau5")
    return hashlib.sha256(b"".join(g.coefficients.tobytes() for g in finished.groups)).hexdigest()


def test_the_hash_seed() -> None:
    """Another process, whose sets are ordered differently and which compiles everything itself, gives the same bits."""
    environment = {**os.environ, "PYTHONHASHSEED": "1234", "HIERC_CACHE": ""}
    command = [sys.executable, "-c", "import test_runs; print(test_runs.fingerprint())"]
    done = subprocess.run(
        command, cwd=Path(__file__).parent, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == fingerprint()


def test_a_group_that_nobody_reads_changes_nothing() -> None:
    alone = run(oscillators(), 20.0, 1e-7, {"o1": {"max_step": 3.0}})
    nodes = {"o0": At(OSCILLATOR, (), 1), "p": At(PENDULUM), "o1": At(OSCILLATOR, (), 1)}
    more = run(a_model(nodes, None, {"o0.w": 1.0, "o1.w": 9.0}), 20.0, 1e-7, {"o1": {"max_step": 3.0}})
    for a, b in zip(alone.groups, (more.groups[0], more.groups[2]), strict=True):
        assert a.coefficients.tobytes() == b.coefficients.tobytes()


# ---- forms of models and of settings -----------------------------------------------------------


def test_one_group_equals_several() -> None:
    nodes = {
        "n0": At(DECAY, (), 1),
        "n1": At(FOLLOWER, ((0, "state", 0),), 1),
        "m": At(MIXER, ((0, "state", 0), (1, "state", 0))),
    }
    nodes["n2"] = At(FOLLOWER, ((2, "out", 0),), 1)
    parameters = {"a": 0.3, "b": 2.0, "c": 9.0}
    t = np.linspace(0.0, 8.0, 200)
    found = [
        states(run(a_model(nodes, groups, parameters), 8.0, 1e-9), t)
        for groups in (
            {"all": ["n0", "n1", "n2"]}, {"a": ["n0"], "b": ["n1", "n2"]}, {"a": ["n0"], "b": ["n1"], "c": ["n2"]},
        )
    ]  # fmt: skip
    assert found[1] == pytest.approx(found[0], abs=3e-8)
    assert found[2] == pytest.approx(found[0], abs=3e-8)


def test_parameters_change_without_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    from hierc.runtime.machine import program

    model = cascade()
    run(model, 10.0)
    monkeypatch.setattr(program, "compile_object", lambda text: pytest.fail("compiled again"))
    rates = [0.5, 3.0, 20.0, 90.0]
    params = {f"n{k}.rate": rate for k, rate in enumerate(rates)}
    t = np.linspace(0.0, 10.0, 101)
    assert np.abs(states(run(model, 10.0, params=params), t) - bateman(rates, t)).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
def test_a_start_that_is_not_zero(method: str) -> None:
    kind = a_class("Clock", {"x": "math.cos(t)"}, start=["math.sin(t)"])
    finished = run(a_model({"c": At(kind)}), 110.0, 1e-9, start=100.0, method=method)
    t = np.linspace(100.0, 110.0, 500)
    assert np.abs(states(finished, t)[:, 0] - np.sin(t)).max() < 1e-8


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("start", "stop"), [(0.0, 1e-12), (0.0, 1e-300), (1.0, math.nextafter(1.0, 2.0)), (-1e-9, 1e-9)]
)
def test_a_stop_that_is_close(method: str, start: float, stop: float) -> None:
    finished = run(a_model({"d": At(DECAY, (), 1)}, None, {"k": 3.0}), stop, start=start, method=method)
    assert finished.status.ok
    assert finished.t_reached == stop
    assert states(finished, np.array([stop]))[0, 0] == pytest.approx(
        math.exp(-3.0 * (stop - start)), abs=1e-6
    )


def test_a_model_without_states() -> None:
    finished = run(a_model({"m": At(a_class("Constant", {}, observed=["t*2.0"]))}), 5.0)
    assert finished.status.ok
    assert finished.t_reached == 5.0
    assert finished.evaluate(["m.y0"], np.array([1.0, 5.0]))["m.y0"].tolist() == [2.0, 10.0]


def test_states_whose_derivative_is_zero() -> None:
    still = a_class("Still", {"x": "0.0"}, start=["3.0"])
    for method in METHODS:
        finished = run(a_model({"s": At(still)}), 1e6, 1e-9, method=method)
        assert states(finished, np.array([0.0, 5.0, 1e6]))[:, 0].tolist() == [3.0] * 3


def test_steps_keep_to_their_bounds() -> None:
    finished = run(oscillators(), 20.0, 1e-3, max_step=0.1)
    assert all(np.diff(g.knots).max() <= 0.1 * (1 + 1e-12) for g in finished.groups)


def test_a_chain_of_two_thousand_groups() -> None:
    """Each follows the one before: no recursion, one form, and the delay adds up."""
    count = 2000
    nodes = {"n0": At(OSCILLATOR, (), 1)}
    for k in range(1, count):
        nodes[f"n{k}"] = At(FOLLOWER, ((k - 1, "state", 0),), 1)
    model = a_model(nodes, None, {"w": 1.0} | {f"k{k}": 50.0 for k in range(1, count)})
    assert len({w.form for w in model.engine.wiring}) == 2
    finished = run(model, 3.0, 1e-4, method="radau5")
    assert finished.status.ok
    assert len(finished.groups) == count
    t = np.array([2.0, 3.0])
    for k in (1, 2, 10):  # each filters the one before; the transients are over
        exact = (np.exp(1j * t) / (1.0 + 1j / 50.0) ** k).real
        assert finished.groups[k](t)[:, 0] == pytest.approx(exact, abs=1e-3)
    assert np.abs(finished.groups[-1](t)).max() < 1e-6  # not there yet: it takes 40 s through all


def test_big_groups() -> None:
    """A chain of sixty states in one group, as in sixty groups."""
    count = 60
    nodes = {"n0": At(DECAY, (), 1)} | {
        f"n{k}": At(FOLLOWER, ((k - 1, "state", 0),), 1) for k in range(1, count)
    }
    parameters = {f"k{k}": 5.0 + k for k in range(count)}
    t = np.linspace(0.0, 5.0, 50)
    one = run(a_model(nodes, {"all": list(nodes)}, parameters), 5.0, 1e-8)
    many = run(a_model(nodes, None, parameters), 5.0, 1e-8)
    assert states(one, t) == pytest.approx(states(many, t), abs=1e-7)
