"""Imports from the user's side: what is said of mistakes, where files are looked for, what is refused, what the cache notices."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import hierc
from hierc import loader
from hierc.cli import main
from hierc.compiler.driver import check_source
from hierc.compiler.imports import errors
from hierc.finder import Finder
from hierc.grammar.problems import ModelError, Problem
from hierc.grammar.render import render_all
from hierc.grammar.source import SourceFile

COMPILER = Path(__file__).parents[1] / "compiler" / "front" / "test_imports.py"
CASES = sorted(folder for folder in (Path(__file__).parent / "imports").iterdir() if folder.is_dir())


def problems_of(file: str) -> tuple[Problem, ...]:
    """All problems of a model, or its warnings if it has no errors."""
    text = loader.read_file(file)
    try:
        return check_source(text.source, reader=text.finder)
    except ModelError as error:
        return error.problems


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_wording(case: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(case)
    shown = render_all(problems_of("main.hier")) + "\n"
    expected = case / "expected.txt"
    if request.config.getoption("--accept"):
        expected.write_text(shown, encoding="utf-8")
    assert shown == expected.read_text(encoding="utf-8")


def test_every_problem_with_imports_is_met_here() -> None:
    told = "".join((case / "expected.txt").read_text(encoding="utf-8") for case in CASES)
    codes = {kind.code for kind in vars(errors).values() if isinstance(kind, type) and hasattr(kind, "code")}
    here = "".join(file.read_text(encoding="utf-8") for file in (Path(__file__), COMPILER))
    assert [code for code in codes if f"[{code}]" not in told and f'"{code}"' not in here] == []


# ---- places --------------------------------------------------------------------------------------

TOP = "from parts.wheel import Wheel;\nagent Top() { agent w = Wheel(); }\nexperiment e of Top() { stop = 1; rtol = 1e-9; }\n"


def wheel(speed: float, imports: str = "") -> str:
    return f"{imports}\nagent Wheel() {{ write real x = 0; diff {{ x' = {speed}; }} }}\n"


def put(folder: Path, **files: str) -> None:
    """Write files: `parts__wheel` is `parts/wheel.hier`."""
    for name, text in files.items():
        path = folder.joinpath(*name.split("__")).with_suffix(".hier")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def speed(model: str | Path) -> float:
    """What a model with a wheel turns at."""
    rate: float = hierc.load(model).rhs(0.0, [0.0])[0]
    return rate


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("HIERC_PATH", raising=False)


@pytest.mark.usefixtures("cache")
def test_the_nearest_place_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project, path = tmp_path / "project", (tmp_path / "one", tmp_path / "two")
    put(project, robots__arm__main=TOP)
    put(path[1], parts__wheel=wheel(4))
    monkeypatch.setenv("HIERC_PATH", os.pathsep.join(map(str, path)))
    model = project / "robots" / "arm" / "main.hier"
    assert speed(model) == 4
    put(path[0], parts__wheel=wheel(3))
    assert speed(model) == 3
    put(project, parts__wheel=wheel(2))
    assert speed(model) == 3  # this is no project yet
    (project / "hier.toml").touch()
    assert speed(model) == 2
    put(project, robots__arm__parts__wheel=wheel(1))
    assert speed(model) == 1
    (project / "robots" / "arm" / "parts" / "wheel.hier").unlink()
    assert speed(model) == 2
    (project / "robots" / "hier.toml").touch()  # a project nearer by
    assert speed(model) == 3


@pytest.mark.usefixtures("cache")
def test_the_current_folder_does_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, here__main=TOP, here__parts__wheel=wheel(5), there__parts__wheel=wheel(6))
    monkeypatch.chdir(tmp_path)
    assert speed(Path("here/main.hier")) == 5
    monkeypatch.chdir(tmp_path / "there")
    assert speed(Path("../here/main.hier")) == 5
    assert main(["check", "../here/main.hier"]) == 0
    for command in ("compile", "graph", "params", "run"):
        assert main([command, str(tmp_path / "here" / "main.hier")]) == 0
    assert speed(TOP) == 6  # text stands in the current folder
    monkeypatch.chdir(tmp_path / "here")
    assert speed(TOP) == 5


@pytest.mark.usefixtures("cache")
def test_equal_models_beside_different_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Same name, same text, same current folder's name: the parts tell them apart."""
    for k, name in enumerate(("a", "b", "a")):
        put(tmp_path / name, main=TOP, parts__wheel=wheel(7 + k % 2))
        monkeypatch.chdir(tmp_path / name)
        assert speed(Path("main.hier")) == 7 + k % 2


def test_a_packaged_model_and_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, std__references=wheel(1), blocks=wheel(2))
    monkeypatch.chdir(tmp_path)
    model = "from std.blocks import Lag;\nagent A() { agent l = Lag(T = 2 [s], y0 = 4) [u := 0]; }"
    assert hierc.load(model).rhs(0.0, [4.0])[0] == -2
    source = SourceFile("cart.hier", "")
    library = loader.packaged_models()["cart"].parent
    finder = Finder(source, library / "cart.hier", library)
    found = finder.find("cart.hier", "std.blocks")
    assert isinstance(found, SourceFile)
    assert found.name == "std/blocks.hier"
    assert not isinstance(finder.find(found.name, "blocks"), SourceFile)  # the library sees only itself
    assert finder.elsewhere["PID"] == "std.blocks"


def test_a_file_is_read_once_whatever_it_is_called(tmp_path: Path) -> None:
    put(tmp_path, main="", a__b="", a__c="")
    (tmp_path / "a" / "link.hier").symlink_to("b.hier")
    finder = Finder(SourceFile("main.hier", ""), tmp_path / "main.hier", tmp_path)
    b = finder.find("main.hier", "a.b")
    c = finder.find("main.hier", "a.c")
    assert isinstance(b, SourceFile)
    assert isinstance(c, SourceFile)
    assert finder.find(c.name, "b") is finder.find("main.hier", "a.link") is b
    assert finder.find(b.name, "c") is c


# ---- refusals ------------------------------------------------------------------------------------

SECRET = "root:x:0:0"


def refused(tmp_path: Path, name: str = "parts.wheel") -> str:
    """What is said of an import that must fail, without a word of what is in the file."""
    put(tmp_path, project__main=f"import {name} as p;\nagent Top() {{ agent w = p.Wheel(); }}")
    (problem,) = problems_of(str(tmp_path / "project" / "main.hier"))
    shown = render_all([problem])
    assert problem.code == "E914"
    assert SECRET not in shown
    assert "secret" not in shown
    return problem.title()


def test_links_that_lead_out(tmp_path: Path) -> None:
    put(tmp_path, secret=SECRET, outside__wheel=SECRET)
    parts = tmp_path / "project" / "parts"
    parts.mkdir(parents=True)
    (parts / "wheel.hier").symlink_to(tmp_path / "secret.hier")
    assert refused(tmp_path).endswith("it is a link that leads out of the folder")
    (parts / "wheel.hier").unlink()
    parts.rmdir()
    parts.symlink_to(tmp_path / "outside")
    assert refused(tmp_path).endswith("it is a link that leads out of the folder")


def test_links_to_nothing_and_to_other_kinds_of_files(tmp_path: Path) -> None:
    put(tmp_path, project__parts__x="")
    (tmp_path / "project" / "secret.txt").write_text(SECRET)
    link = tmp_path / "project" / "parts" / "wheel.hier"
    link.symlink_to(tmp_path / "project" / "secret.txt")
    assert refused(tmp_path).endswith("it is a link to a file of another kind")
    link.unlink()
    link.symlink_to(tmp_path / "project" / "gone.hier")
    assert refused(tmp_path).endswith("there is no such file")
    link.unlink()
    link.symlink_to(link)
    refused(tmp_path)


def test_advice_does_not_look_outside(tmp_path: Path) -> None:
    put(tmp_path, outside__secrets="")
    put(tmp_path / "project", main="import parts.secret;\nagent A() { write real x = 0; diff { x' = 1; } }")
    (tmp_path / "project" / "parts").symlink_to(tmp_path / "outside")
    (problem,) = problems_of(str(tmp_path / "project" / "main.hier"))
    assert problem.code == "E901"
    assert problem.help() == ()


def test_what_is_no_file(tmp_path: Path) -> None:
    parts = tmp_path / "project" / "parts"
    (parts / "wheel.hier").mkdir(parents=True)
    assert refused(tmp_path).endswith("it is a folder")
    os.mkfifo(parts / "pipe.hier")
    assert refused(tmp_path, "parts.pipe").endswith("it is not a regular file")


def test_what_is_no_text(tmp_path: Path) -> None:
    put(tmp_path, project__parts__x="")
    file = tmp_path / "project" / "parts" / "wheel.hier"
    file.write_bytes(SECRET.encode() + b"\n\xff\xfe")
    assert refused(tmp_path).endswith("line 2 is not UTF-8 text")
    with file.open("wb") as sparse:
        sparse.truncate(9 * 2**20)
    assert refused(tmp_path).endswith("it is larger than 8 MB")


# ---- the cache -----------------------------------------------------------------------------------


def compiled(model: Path, **params: object) -> bool:
    return loader.prepare(loader.read_file(model), None, params).compiled


@pytest.mark.usefixtures("cache")
def test_every_file_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIERC_PATH", str(tmp_path / "path"))
    put(tmp_path / "home", main=TOP)
    put(
        tmp_path / "path",
        parts__wheel="import hub;\n" + wheel(1).replace("= 1;", "= hub.k;"),
        hub="const real k = 1;",
    )
    model = tmp_path / "home" / "main.hier"
    assert compiled(model)
    assert not compiled(model)
    put(tmp_path / "path", parts__hub="const real k = 2;")  # nearer to the wheel
    assert compiled(model)
    assert speed(model) == 2
    assert not compiled(model)
    (tmp_path / "path" / "parts" / "hub.hier").write_text("const real k = 3;")
    assert speed(model) == 3
    (tmp_path / "path" / "parts" / "hub.hier").unlink()
    assert speed(model) == 1
    monkeypatch.setenv("HIERC_PATH", "")
    with pytest.raises(ModelError, match=r"cannot find `parts/wheel\.hier`"):
        compiled(model)
    monkeypatch.setenv("HIERC_PATH", str(tmp_path / "path"))
    assert speed(model) == 1


@pytest.mark.usefixtures("cache")
def test_every_name_of_a_file_counts(tmp_path: Path) -> None:
    """Two links to one file: it is read once, and noticed when the second leads elsewhere."""
    put(tmp_path, main="import p; import q; agent T() { agent a = p.Wheel(); agent b = q.Wheel(); }")
    put(tmp_path, one=wheel(1), two=wheel(2))
    for name in ("p", "q"):
        (tmp_path / f"{name}.hier").symlink_to("one.hier")
    model = hierc.load(tmp_path / "main.hier")
    assert model.rhs(0.0, [0.0, 0.0]).tolist() == [1, 1]
    assert [c.name for c in model.plan.classes] == ["p.Wheel"]
    (tmp_path / "q.hier").unlink()
    (tmp_path / "q.hier").symlink_to("two.hier")
    assert hierc.load(tmp_path / "main.hier").rhs(0.0, [0.0, 0.0]).tolist() == [1, 2]


@pytest.mark.usefixtures("cache")
def test_structural_parameters_of_an_imported_agent(tmp_path: Path) -> None:
    row = "agent Row(int n = 2) { write real[n] x = [i for i in 1..n]; diff { x' = -x; } }"
    put(tmp_path, main="from row import Row;\nagent Top(int n = 2) { agent r = Row(n = n); }", row=row)
    model = tmp_path / "main.hier"
    assert compiled(model)
    assert compiled(model, n=3)
    assert not compiled(model, n=3)
    assert not compiled(model)
    put(tmp_path, row=row.replace("-x", "-2*x"))
    assert compiled(model, n=3)
    assert hierc.load(model, params={"n": 3}).rhs(0.0, [1, 1, 1]).tolist() == [-2, -2, -2]
    assert compiled(model)


@pytest.mark.usefixtures("cache")
def test_a_warm_start_reads_files_and_parses_none(tmp_path: Path) -> None:
    put(tmp_path, main=TOP, parts__wheel=wheel(1))
    script = "import sys, hierc; hierc.load('main.hier'); print(sorted({'lark', 'sympy'} & set(sys.modules)))"

    def said() -> str:
        return subprocess.run(
            [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout

    assert said() == "['lark', 'sympy']\n"
    assert said() == "[]\n"


# ---- what is said of runs ------------------------------------------------------------------------


@pytest.mark.usefixtures("cache")
def test_a_failure_names_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grow = "agent Grow() {\n  write real x = 1;\n  diff { x' = x^2*1 [1/s]; }\n}\n"
    put(
        tmp_path,
        main=f"import parts.grow as g;\n{grow}agent Two() {{ agent a = g.Grow(); }}",
        parts__grow=grow,
    )
    for agent, place in (("Two", "`a.x` (parts/grow.hier, line 3)"), ("Grow", "`x` (line 4)")):
        assert main(["run", str(tmp_path / "main.hier"), agent, "--stop", "2"]) == 3
        said = capsys.readouterr().err.replace(f"{tmp_path}{os.sep}", "")
        assert f"state {place} had to become smaller" in said


# ---- what the generated module says --------------------------------------------------------------


def test_the_module_names_its_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hashlib import sha256

    put(tmp_path, main=TOP, parts__wheel=wheel(1))
    monkeypatch.chdir(tmp_path)
    text = hierc.compile("main.hier")
    for name in ("main.hier", "parts/wheel.hier"):
        assert f"    sha256 {sha256((tmp_path / name).read_bytes()).hexdigest()}  {name}\n" in text
    assert "# parts/wheel.hier:2  x' = 1" in text
    assert "Sources:" not in hierc.compile("agent A() { write real x = 0; diff { x' = 1; } }")
