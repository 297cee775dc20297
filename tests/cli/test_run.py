"""`hierc run` around the golden cases: interruption, pipes, files, imports."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hierc import cli, commands

DECAY = """
agent Decay(real tau [s] = 0.5) {
  write real x [m] = 1;
  private real y [m] = 2;
  diff { x' = -x/tau; y' = -y/tau; }
}
experiment fall of Decay() { stop = 2 [s]; interval = 0.1 [s]; rtol = 1e-10; atol = 1e-12; }
"""

#: An oscillator that takes some 10^8 steps: only an interrupt ends it in time.
LONG = """
agent Fast() {
  write real x = 1, v = 0;
  diff { x' = v; v' = -1e6*x; }
}
experiment e of Fast() { stop = 1e6 [s]; rtol = 1e-6; max_step = 1e-2 [s]; }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "decay.hier").write_text(DECAY)
    (tmp_path / "long.hier").write_text(LONG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_files_hold_the_solution(folder: Path) -> None:
    assert cli.main(["run", "decay.hier", "-o", "r.csv", "--plot", "r.png", "--quiet", "-p", "tau=0.25"]) == 0
    with Path("r.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time", "x"]
    t, x = np.array(rows[1:], dtype=float).T
    assert t == pytest.approx(np.arange(21) / 10)
    assert x == pytest.approx(np.exp(-t / 0.25), abs=1e-9)
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")
    assert cli.main(["run", "decay.hier", "-o", "r.npz", "--quiet", "-p", "tau=0.25"]) == 0
    with np.load("r.npz") as arrays:
        assert np.array_equal(arrays["x"], x)


def test_the_summary_is_plain_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        cli.main(["run", "decay.hier", "--json", "--quiet", "--stop", "1", "--rtol", "1e-5", "-p", "tau=1"])
        == 0
    )
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert captured.err == ""
    assert (summary["model"], summary["ok"], summary["reached"]) == ("Decay", True, 1.0)
    assert summary["settings"]["rtol"] == 1e-5
    assert summary["parameters"] == {"tau": 1}
    (group,) = summary["groups"].values()
    assert group["states"] == 2
    assert group["steps"] > 0
    assert group["evaluations"] > group["steps"]
    assert 0 < group["step_min"] <= group["step_median"] <= group["step_max"] <= 1


def test_ctrl_c_keeps_what_is_done(folder: Path) -> None:
    """Interrupt a run once its progress bar shows that it is under way."""
    ours, its = os.openpty()
    command = [sys.executable, "-m", "hierc", "run", "long.hier", "-o", "partial.csv"]
    with subprocess.Popen(command, stderr=its, env={**os.environ, "TERM": "xterm"}) as run:
        os.close(its)
        said = b""
        while b"of 1e+06 s" not in said:
            said += os.read(ours, 4096)
        run.send_signal(signal.SIGINT)
        while more := _read(ours):
            said += more
    assert run.returncode == 130, said
    assert b"Traceback" not in said
    assert b"hierc: interrupted at " in said
    with Path("partial.csv").open() as file:
        t, x = np.array(list(csv.reader(file))[1:], dtype=float).T[:2]
    assert 0 < t[-1] < 1e6
    assert x[0] == 1.0
    assert np.all(np.abs(x) < 1.1)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # the other end is closed
        return b""


def test_ctrl_c_before_the_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hierc.loader.prepare", interrupted)
    assert cli.main(["run", "decay.hier"]) == 130
    assert capsys.readouterr().err == "hierc: interrupted\n"


def test_a_reader_that_goes_away(folder: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "hierc", "run", "decay.hier", "-o", "-", "--quiet"]
    ran = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert ran.returncode == 2
    assert ran.stderr == "hierc: nobody reads the output any more\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk(folder: Path) -> None:
    command = [sys.executable, "-m", "hierc", "run", "decay.hier", "-o", "-", "--quiet"]
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ran.returncode == 2
    assert ran.stderr == "hierc: error: No space left on device\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
@pytest.mark.parametrize("command", ["check", "run"])
def test_problems_that_nobody_can_read(folder: Path, command: str) -> None:
    (folder / "bad.hier").write_text("agent A() { write real x = y; }")
    problems = [sys.executable, "-m", "hierc", command, "bad.hier", "--json"]
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(problems, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (2, "hierc: error: No space left on device\n")
    reading, writing = os.pipe()
    os.close(reading)
    ran = subprocess.run(problems, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (2, "hierc: nobody reads the output any more\n")


@pytest.mark.parametrize("closed", ["1", "2"])
def test_a_stream_that_is_closed(folder: Path, closed: str) -> None:
    """What would go to the closed stream must not turn up on the other one."""
    shell = f'"{sys.executable}" -m hierc check decay.hier --json {closed}>&-'
    ran = subprocess.run(shell, shell=True, capture_output=True, text=True, check=False)
    said = (ran.stdout.partition("\n")[0], ran.stderr)
    assert (ran.returncode, *said) == ((0, "", "decay.hier: no errors\n") if closed == "1" else (0, "{", ""))


def test_a_file_that_cannot_be_written_does_not_lose_the_others(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "decay.hier").write_text(DECAY.replace("stop =", 'save "a.npz", "b.csv"; stop ='))

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("hierc.runtime.writers.write_npz", refuse)
    assert cli.main(["run", "decay.hier"]) == 2
    said = capsys.readouterr().err
    assert "evaluations" in said  # the table of groups
    assert "written: b.csv\n" in said
    assert said.endswith("hierc: error: cannot write `a.npz`: Permission denied\n")
    assert Path("b.csv").exists()
    assert cli.main(["run", "decay.hier", "--json", "--quiet"]) == 2
    summary = json.loads(capsys.readouterr().out)
    assert summary["files"] == ["b.csv"]
    assert summary["not_written"] == ["cannot write `a.npz`: Permission denied"]


def test_a_plot_that_fails_is_named_as_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: Path, *_: object) -> None:
        raise OSError(28, "No space left on device", f"{path}.temporary")

    monkeypatch.setattr("hierc.runtime.plotting.write_whole", refuse)
    assert cli.main(["run", "decay.hier", "--plot", "p.png", "--quiet"]) == 2
    assert capsys.readouterr().err == "hierc: error: cannot write `p.png`: No space left on device\n"


def test_what_cannot_be_written_is_refused_before_the_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hierc.loader.prepare", lambda *_, **__: pytest.fail("the run began"))
    Path("away.csv").symlink_to("nowhere/x.csv")
    Path("round.csv").symlink_to("round.csv")
    for name, said in [
        ("away.csv", f"it is a link to `{folder}/nowhere/x.csv`, and there is no folder `{folder}/nowhere`"),
        ("round.csv", "there can be no such file"),
        ("nowhere/y.csv", "there is no folder `nowhere`"),
    ]:
        assert cli.main(["run", "decay.hier", "-o", "good.csv", "-o", name]) == 2
        assert capsys.readouterr().err == f"hierc: error: cannot write `{name}`: {said}\n"
    monkeypatch.setattr("hierc.runtime.plotting.find_spec", lambda _: None)
    assert cli.main(["run", "decay.hier", "--plot", "p.png"]) == 2
    assert capsys.readouterr().err == "hierc: error: plots need matplotlib: pip install matplotlib\n"
    monkeypatch.setattr("os.access", lambda *_: False)  # as in a folder of somebody else
    assert cli.main(["run", "decay.hier", "-o", "good.csv"]) == 2
    assert f"cannot write `good.csv`: you may not write into the folder `{folder}`" in capsys.readouterr().err


def test_several_files_are_all_written(folder: Path) -> None:
    files = ["a.csv", "b.npz", "a.png", "b.svg"]
    options = [word for name in files[:2] for word in ("-o", name)] + ["--plot", "a.png", "--plot", "b.svg"]
    assert cli.main(["run", "decay.hier", "--quiet", *options]) == 0
    assert all(Path(name).stat().st_size > 0 for name in files)


def test_warnings_stand_in_the_summary(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the compiler and from the cache alike; `check` gives the same."""
    jump = DECAY.replace("x' = -x/tau;", "x' = if time > 1 [s] then -x/tau else 0 [m/s];")
    Path("jump.hier").write_text(jump)
    assert cli.main(["check", "jump.hier", "--json"]) == 0
    problems = json.loads(capsys.readouterr().out)["problems"]
    assert [problem["severity"] for problem in problems] == ["warning"]
    for _ in range(2):
        assert cli.main(["run", "jump.hier", "--json", "--quiet"]) == 0
        summary = json.loads(capsys.readouterr().out)
        assert summary["warnings"] == problems
        assert summary["ok"] is True
    assert cli.main(["run", "jump.hier", "--json", "--quiet", "--max-step", "0.01"]) == 0
    (group,) = json.loads(capsys.readouterr().out)["groups"].values()
    assert group["step_max"] == pytest.approx(0.01, rel=1e-12)
    assert group["steps"] >= 200


def test_structural_parameters_stand_with_the_others(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("sized.hier").write_text(
        "agent A(int n = 2, real k = 1) { write real[n] x = zeros(n); diff { x' = -k*x; } }\n"
        "experiment e of A() { stop = 1 [s]; }"
    )
    assert cli.main(["run", "sized.hier", "-p", "n=3", "-p", "k=2"]) == 0
    assert "set: n = 3, recompiled for it\nset: k = 2\n" in capsys.readouterr().err
    assert cli.main(["run", "sized.hier", "-p", "n=3", "-p", "k=2", "--json"]) == 0
    captured = capsys.readouterr()
    assert "set: n = 3\nset: k = 2\n" in captured.err
    assert json.loads(captured.out)["parameters"] == {"n": 3, "k": 2}


def test_a_link_does_not_lead_a_save_outside(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inside = folder / "inside"
    inside.mkdir()
    os.chdir(inside)
    (inside / "out").symlink_to(folder)
    Path("m.hier").write_text(DECAY.replace("stop =", 'save "out/x.csv"; stop ='))
    assert cli.main(["run", "m.hier"]) == 2
    assert "outside the current folder" in capsys.readouterr().err
    assert not (folder / "x.csv").exists()


def test_what_a_model_names_does_not_act_on_the_terminal(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("m.hier").write_text(DECAY.replace("stop =", 'save "../\x1b[2J.csv"; stop ='))
    assert cli.main(["run", "m.hier"]) in (1, 2)
    said = capsys.readouterr().err
    assert "[2J" in said
    assert "\x1b" not in said


def test_runs_at_the_same_time_share_a_cache(folder: Path) -> None:
    environment = {**os.environ, "HIERC_CACHE": str(folder / "cache")}
    command = [sys.executable, "-m", "hierc", "run", "decay.hier", "--quiet", "-o", "-"]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) for _ in range(3)]
    tables = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0]
    assert tables[0].startswith(b"time,x\n0.0,1.0\n")
    assert tables == tables[:1] * 3
    left = [file.name for file in (folder / "cache").rglob(".*")]
    assert left == []


def test_the_module_depends_on_the_model_alone(folder: Path) -> None:
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "decay.hier").write_text(DECAY)
    settings = [
        (folder, {"PYTHONHASHSEED": "1", "LC_ALL": "C"}),
        (elsewhere, {"PYTHONHASHSEED": "2", "LC_ALL": "C.UTF-8"}),
    ]
    command = [sys.executable, "-m", "hierc", "compile", "decay.hier"]
    texts = [
        subprocess.run(
            command, cwd=cwd, env={**os.environ, **changed}, capture_output=True, check=True
        ).stdout
        for cwd, changed in settings
    ]
    assert texts[0] == texts[1]
    assert b"MODEL" in texts[0]


def test_a_bug_of_ours_says_so(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: object) -> int:
        raise KeyError("v17")

    monkeypatch.setattr(commands, "check", broken)
    monkeypatch.delenv("HIERC_DEBUG", raising=False)
    assert cli.main(["check", "decay.hier"]) == 70
    said = capsys.readouterr().err
    assert "bug in hierc" in said
    assert "not in your model" in said
    assert "Traceback" not in said
    monkeypatch.setenv("HIERC_DEBUG", "1")
    assert cli.main(["check", "decay.hier"]) == 70
    assert "Traceback" in capsys.readouterr().err


def test_a_warm_run_imports_only_what_it_needs(folder: Path) -> None:
    assert cli.main(["run", "decay.hier", "--quiet"]) == 0
    code = (
        "import sys; from hierc.cli import main; code = main(['run', 'decay.hier'])\n"
        "print(code, *sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, *modules = ran.stdout.split()
    assert code == "0"
    assert {"lark", "sympy", "scipy", "numba", "matplotlib", "rich"}.isdisjoint(modules)
    assert {"numpy.ma", "hierc.compiler", "hierc.grammar.errors", "hierc.runtime.batch"}.isdisjoint(modules)


def test_a_compiled_module_runs_alone(folder: Path) -> None:
    assert cli.main(["compile", "decay.hier", "-o", "decay_model.py"]) == 0
    code = (
        "import sys, decay_model\nr = decay_model.simulate(stop=1.0)\n"
        "print(r('x', 1.0), 'sympy' in sys.modules, 'lark' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    x, *imported = ran.stdout.split()
    assert float(x) == pytest.approx(np.exp(-2.0), abs=1e-8)
    assert imported == ["False", "False"]
