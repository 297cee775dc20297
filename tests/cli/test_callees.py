"""Models with tables and external functions, from their files to results: values, failures, caches, and who imports what."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

import hierc
from hierc import loader
from hierc.cli import main
from hierc.models import hull
from hierc.runtime.errors import RunWarning

SLED = """
extern real force(real v [m/s]) [N] = "{module}:force";
agent Sled(real m [kg] = 5) {{
  write real v [m/s] = 1, x [m] = 0;
  diff {{ v' = -force(v)/m; x' = v; }}
}}
experiment slide of Sled() {{ stop = 1 [s]; rtol = 1e-8; }}
"""
COUNT = iter(range(10_000))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder with a cache of its own."""
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work"


def sled(folder: Path, text: str) -> Path:
    """A sled whose force is a function in a new module beside it."""
    module = f"sled_force_{next(COUNT)}"
    (folder / f"{module}.py").write_text(textwrap.dedent(text))
    (folder / "sled.hier").write_text(SLED.format(module=module))
    return folder / "sled.hier"


def boat(folder: Path, data: str = "0,0\n100,400\n200,900\n", method: str = "cubic") -> Path:
    (folder / "data").mkdir(exist_ok=True)
    (folder / "data" / "thrust.csv").write_text(data)
    text = f"""
table thrust(real n [1/s]) [N] = "data/thrust.csv", {method};
agent Boat(real n [1/s] = 150) {{
  write real v [m/s] = 0;
  diff {{ v' = (thrust(n) - 50 [kg/s]*v)/(100 [kg]); }}
}}
experiment go of Boat() {{ stop = 1 [s]; }}
"""
    (folder / "boat.hier").write_text(text)
    return folder / "boat.hier"


# ---- the gallery's boat -------------------------------------------------------------------------


def thrust_by_scipy() -> tuple[np.ndarray, np.ndarray, object]:
    """The gallery's thrust table, read and interpolated with numpy and scipy alone."""
    file = Path(hull.__file__).parent / "data" / "thrust.csv"
    rows = np.genfromtxt(file, delimiter=",", comments="#", skip_header=2)
    n, v = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    f = rows[np.lexsort((rows[:, 1], rows[:, 0])), 2].reshape(len(n), len(v))
    by_n, by_v = (
        PchipInterpolator(n, f, axis=0).derivative()(n),
        PchipInterpolator(v, f, axis=1).derivative()(v),
    )
    mixed = PchipInterpolator(n, by_v, axis=0).derivative()(n) + PchipInterpolator(
        v, by_n, axis=1
    ).derivative()(v)

    def thrust(rpm: float, speed: float) -> float:
        values, slopes = CubicHermiteSpline(n, f, by_n)(rpm), CubicHermiteSpline(n, by_v, mixed / 2)(rpm)
        return float(CubicHermiteSpline(v, values, slopes)(speed))

    return n, v, thrust


def test_the_boat_against_an_independent_solution() -> None:
    _, _, thrust = thrust_by_scipy()

    def rhs(t: float, y: np.ndarray) -> list[float]:
        rpm, _, v = y
        lever = 0.9 * 0.5 * (1 + np.tanh((t - 3) / 0.8))
        return [(3000 * lever - rpm) / 0.4, v, (thrust(rpm, v) - hull.resistance(v)) / 180]  # type: ignore[operator]

    times = np.linspace(0, 20, 41)
    reference = solve_ivp(rhs, (0, 20), [0, 0, 0], "DOP853", times, rtol=1e-10, atol=1e-10, max_step=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # it stays within its grid, and its function is compiled
        r = hierc.load("boat").simulate(rtol=1e-8)
    found = np.array([r("motor.n", times), r("hull.x", times), r("hull.v", times)])
    assert np.allclose(found, reference.y, rtol=1e-6, atol=1e-6)
    push = [thrust(a, b) for a, _, b in reference.y.T]  # type: ignore[operator]
    assert np.allclose(r("hull.push", times), push, rtol=1e-6, atol=1e-4)


def test_plain_python_and_its_derivatives() -> None:
    model = hierc.load("boat")
    _, _, thrust = thrust_by_scipy()
    names = list(model.states)
    rng = np.random.default_rng(8)
    for _ in range(20):
        x = np.zeros(3)
        rpm, v = rng.uniform(100, 2900), rng.uniform(0.1, 5.5)
        x[names.index("motor.n")], x[names.index("hull.v")] = rpm * np.pi / 30, v
        rate = model.rhs(3.0, x)[names.index("hull.v")]
        assert rate == pytest.approx((thrust(rpm, v) - hull.resistance(v)) / 180, rel=1e-10)  # type: ignore[operator]
        jacobian = model.jacobian(3.0, x)
        for k in range(3):
            h = np.zeros(3)
            h[k] = 1e-5
            slope = (model.rhs(3.0, x + h) - model.rhs(3.0, x - h)) / 2e-5
            assert np.allclose(jacobian[:, k], slope, rtol=1e-4, atol=1e-5)


# ---- tables -------------------------------------------------------------------------------------


def test_a_changed_file_recompiles(folder: Path) -> None:
    path = boat(folder)
    first = hierc.load(path)
    assert not loader.prepare(loader.read(path), None, {}).compiled
    boat(folder, "0,0\n100,500\n200,900\n")
    again = loader.prepare(loader.read(path), None, {})
    assert again.compiled
    assert again.model.plan.digest != first.plan.digest
    assert again.model.rhs(0.0, [0.0])[0] > first.rhs(0.0, [0.0])[0]


def test_equal_models_in_two_folders_have_their_own_tables(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = []
    for name, data in (("a", "0,0\n100,400\n200,800\n"), ("b", "0,0\n100,100\n200,200\n")):
        (folder / name).mkdir()
        boat(folder / name, data, "linear")
        monkeypatch.chdir(folder / name)
        values.append(float(hierc.load("boat.hier").rhs(0.0, [0.0])[0]))
    assert values == [6.0, 1.5]


def test_the_generated_module_runs_alone(folder: Path, tmp_path: Path) -> None:
    path = boat(folder)
    assert main(["compile", str(path), "-o", str(tmp_path / "boat_alone.py")]) == 0
    expected = hierc.load(path).simulate()("v", 1.0)
    for file in folder.rglob("*.*"):
        file.unlink()
    code = "import sys, boat_alone as b; r = b.simulate(); print(float(r('v', 1.0)).hex(), 'lark' in sys.modules, 'sympy' in sys.modules)"
    shown = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert shown.stdout.split() == [float(expected).hex(), "False", "False"]


@pytest.mark.parametrize("command", ["check", "run", "graph"])
@pytest.mark.parametrize(
    "kind", ["outside", "absolute", "link", "fifo", "folder", "large", "kind", "missing"]
)
def test_where_files_may_be(
    folder: Path, tmp_path: Path, kind: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = boat(folder)
    table = folder / "data" / "thrust.csv"
    (tmp_path / "secret.csv").write_text("0,password\n")
    names = {"outside": "../secret.csv", "absolute": str(tmp_path / "secret.csv"), "kind": "boat.hier"}
    path.write_text(path.read_text().replace("data/thrust.csv", names.get(kind, "data/thrust.csv")))
    if kind not in names:
        table.unlink()
    match kind:
        case "link":
            table.symlink_to(tmp_path / "secret.csv")
        case "fifo":
            os.mkfifo(table)
        case "folder":
            table.mkdir()
        case "large":
            table.write_bytes(b"1,2\n" * 2_200_000)
    assert main([command, str(path)]) == 1
    shown = capsys.readouterr().err
    reasons = {
        "outside": "it lies outside the folder", "absolute": "it lies outside the folder", "link": "it lies outside the folder",
        "fifo": "it is not a regular file", "folder": "it is a folder", "large": "it is larger than", "kind": "does not end in `.csv`",
        "missing": "there is no such file",
    }  # fmt: skip
    assert "error[E906]" in shown
    assert reasons[kind] in shown
    assert "password" not in shown


def test_a_project_shares_its_data(folder: Path) -> None:
    (folder / "hier.toml").write_text("")
    (folder / "inner").mkdir()
    path = boat(folder / "inner")
    (folder / "inner" / "data").rename(folder / "data")
    path.write_text(path.read_text().replace("data/thrust.csv", "../data/thrust.csv"))
    assert hierc.load(path).rhs(0.0, [0.0])[0] > 0


def test_of_parameters_a_table_is_computed_once(folder: Path) -> None:
    module = loader.run_module(hierc.compile(boat(folder)), "boat.hier")
    (kind,) = module.MODEL.plan.classes
    text = Path(module.__file__ or "").name
    assert kind.values >= 1
    assert "callee" not in inspect_source(module, kind.rhs.__name__)
    assert "callee0(" in inspect_source(module, kind.fill.__name__)
    assert text


def inspect_source(module: ModuleType, function: str) -> str:
    import inspect

    return inspect.getsource(getattr(module, function))


def test_outside_its_grid_a_table_is_named_once(folder: Path) -> None:
    path = boat(folder)
    with pytest.warns(RunWarning) as caught:
        hierc.load(path, params={"n": 250}).simulate()
    (warning,) = caught
    assert str(warning.message) == (
        "table `thrust` was used outside its grid (n > 200 1/s): there it has the value of its edge"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hierc.load(path).simulate()


def test_a_state_that_leaves_the_grid_is_seen(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "t.csv").write_text("v,a\n0,1\n1,1\n")
    (folder / "a.hier").write_text(
        'table a(real v) = "t.csv", linear;\nagent A() { write real v = 0; diff { v\' = a(v); } }\n'
    )
    assert main(["run", "a.hier", "--stop", "1"]) == 0  # just to the edge
    assert "warning" not in capsys.readouterr().err
    assert main(["run", "a.hier", "--stop", "1.2"]) == 0
    assert "warning: table `a` was used outside its grid (v > 1)" in capsys.readouterr().err


@pytest.mark.parametrize("method", ["radau5", "radau13", "tsit5", "dop853"])
@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_all_methods_integrate_tables(folder: Path, method: str, kind: str) -> None:
    """v' = f(v) on one piece between two points, where both kinds are the line 2 - v."""
    (folder / "t.csv").write_text("0,2\n2,0\n")
    text = f"table f(real v) = \"t.csv\", {kind};\nagent A() {{ write real v = 0, w = f(0.5); diff {{ v' = f(v); w' = -w; }} }}"
    r = hierc.load(text).simulate(stop=3, rtol=1e-9, method=method)
    assert r("v", 3.0) == pytest.approx(2 - 2 * np.exp(-3), rel=1e-7)
    assert r("w", 3.0) == pytest.approx(1.5 * np.exp(-3), rel=1e-7)


# ---- external functions -------------------------------------------------------------------------


def test_a_compiled_function_and_one_called_back_agree(folder: Path) -> None:
    """v' = -(v + v^3)/5: v^2/(1 + v^2) falls by exp(-2t/5)."""
    ends = []
    for line in ("return v + v**3", "return sum([v, v**3])"):
        model = hierc.load(sled(folder, f"def force(v):\n    {line}\n"))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            ends.append(float(model.simulate(method="radau13")("v", 1.0)))
            model.simulate(method="radau13")
        told = [str(w.message) for w in caught]
        assert len(told) == ("sum" in line)  # once
        assert all("line 2: " in text and "which is slow" in text and "`force`" in text for text in told)
    assert ends[0] == ends[1]
    q = 0.5 * np.exp(-0.4)
    assert ends[0] == pytest.approx(np.sqrt(q / (1 - q)), rel=1e-7)


def test_only_runs_import_modules(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = sled(folder, "from pathlib import Path\nPath('imported').touch()\ndef force(v):\n    return v\n")
    for command in (["check"], ["fmt", "--check"], ["graph"], ["compile"], ["compile", "--emit", "plan"]):
        assert main([*command, str(path)]) in (0, 1)
        assert not (folder / "imported").exists()
    assert main(["run", str(path)]) == 0
    assert (folder / "imported").exists()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("def other(v):\n    return v\n", "has no function `force`"),
        ("def force(v, w):\n    return v\n", "`force(v, w)` cannot be called with 1 argument"),
        ("force = 3\n", "`force` is not a function"),
        ("import nowhere_to_be_found\n", "cannot be imported: ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("def force(:\n", "cannot be imported: SyntaxError"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_function_is_shown_in_the_model(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, reason: str
) -> None:
    path = sled(folder, text)
    assert main(["run", str(path)]) == 1
    shown = capsys.readouterr().err
    assert "error[E905]: extern `force`: " in shown
    assert reason in shown
    assert "sled.hier:2:39" in shown
    assert main(["check", str(path)]) == 0


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("return 1/0 if v < 0.9 else v", "ZeroDivisionError: division by zero"),
        ("raise RuntimeError('no\\nwater')", "RuntimeError: no water"),
        ("return None if v < 0.9 else [v][0]", "returned None, which is not a number"),
        ("return 'fast'", "returned 'fast', which is not a number"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
    ],
)
def test_a_function_that_fails_ends_the_run(
    folder: Path, capsys: pytest.CaptureFixture[str], line: str, reason: str
) -> None:
    path = sled(folder, f"def force(v):\n    {line}\n")
    assert main(["run", str(path), "-o", "out.csv"]) == 3
    shown = capsys.readouterr().err
    assert "extern `force`" in shown
    assert reason in shown
    if "0.9" in line:  # what was computed until then is kept, and is right
        t, v = np.genfromtxt("out.csv", delimiter=",", skip_header=1)[-1, :2]
        assert v == pytest.approx(np.exp(-t / 5), rel=1e-6)
        assert 0.9 <= v < 0.95


def test_a_failure_that_conditions_swallow_is_not_lost(folder: Path) -> None:
    """NaN compares false: without a mark the run would go on as if nothing had been."""
    path = sled(folder, "def force(v):\n    return 1.0 if [v][0] > 0.9 else {}['gone']\n")
    path.write_text(
        path.read_text().replace("-force(v)/m", "if force(v) > 0.5 then -v/(1 [s]) else -0.5*v/(1 [s])")
    )
    warnings.simplefilter("ignore")
    with pytest.raises(hierc.SimulationError, match="KeyError: 'gone'") as caught:
        hierc.load(path).simulate()
    partial = caught.value.result
    assert 0.0 < partial.t_reached <= -np.log(0.9) + 1e-6
    assert partial("v", partial.t_reached) == pytest.approx(np.exp(-partial.t_reached), rel=1e-6)


def test_ctrl_c_in_a_function_stops_the_run(folder: Path) -> None:
    text = """
        import signal
        calls = []
        def force(v):
            calls.append(v)
            if len(calls) == 20_000:
                signal.raise_signal(signal.SIGINT)
            return v
    """
    path = sled(folder, text)
    model = hierc.load(path)
    warnings.simplefilter("ignore")
    with pytest.raises(hierc.Interrupted) as caught:
        model.simulate(stop=1000.0, rtol=1e-10, max_step=0.01)
    partial = caught.value.result
    assert 0.0 < partial.t_reached < 1000.0
    assert partial("v", partial.t_reached) == pytest.approx(np.exp(-partial.t_reached / 5), rel=1e-6)


def test_a_branch_that_is_not_taken_calls_nothing(folder: Path) -> None:
    path = sled(folder, "def force(v):\n    return [v][0] if v > 0.95 else {}['no']\n")
    path.write_text(
        path.read_text().replace("-force(v)/m", "if v > 0.95 [m/s] then -force(v)/m else -v/(5 [s])")
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = hierc.load(path).simulate(max_step=0.02)
    assert r("v", 1.0) == pytest.approx(np.exp(-0.2), rel=1e-6)


def test_imported_tables_and_functions(folder: Path) -> None:
    """`parts/props.hier` names its data from where it is; functions are found from the model's folder."""
    module = f"prop_loss_{next(COUNT)}"
    (folder / f"{module}.py").write_text("def loss(v):\n    return 0.5*v\n")
    (folder / "parts").mkdir()
    (folder / "parts" / "t.csv").write_text("0,0\n10,10\n")
    (folder / "parts" / "props.hier").write_text(
        f'table thrust(real n) = "t.csv", linear;\nextern real loss(real v) = "{module}:loss";\n'
    )
    (folder / "m.hier").write_text(
        "import parts.props as p;\nfrom parts.props import thrust;\n"
        "agent A() { write real v = 0; diff { v' = p.thrust(4) + thrust(2) - p.loss(v); } }\n"
    )
    assert hierc.load(folder / "m.hier").rhs(0.0, [2.0])[0] == 5.0
