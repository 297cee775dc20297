"""The house itself: nothing forgotten in the packages, links and limits that no other tool checks."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FOLDERS = {name: ROOT / path for name, path in PROJECT["tool"]["setuptools"]["package-dir"].items()}
SOURCES = sorted(file for folder in FOLDERS.values() for file in folder.rglob("*.py"))


def test_every_package_is_listed() -> None:
    """A package that is not listed works in an editable install and is missing from the wheel."""
    found = {
        ".".join([name, *file.parent.relative_to(folder).parts])
        for name, folder in FOLDERS.items()
        for file in folder.rglob("*.py")
    }
    assert found == set(PROJECT["tool"]["setuptools"]["packages"])


def test_every_data_file_is_shipped() -> None:
    """What no pattern of `package-data` names works in an editable install and is missing from the wheel."""
    patterns = PROJECT["tool"]["setuptools"]["package-data"]
    for name, folder in FOLDERS.items():
        shipped = {file for pattern in patterns.get(name, ()) for file in folder.glob(pattern)}
        found = {file for file in folder.rglob("*") if file.is_file() and "__pycache__" not in file.parts}
        code = {file for file in found if file.suffix in (".py", ".pyc")}
        assert found - code - shipped - {folder / "README.md"} == set()


def test_type_checking_sees_every_folder() -> None:
    links = {link.name: link.resolve() for link in (ROOT / "typing" / "hierc").iterdir()}
    assert links == {
        name.removeprefix("hierc."): folder for name, folder in FOLDERS.items() if name != "hierc"
    }


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(ROOT)))
def test_sizes(file: Path) -> None:
    text = file.read_text()
    assert file.stem.endswith("_tables") or text.count("\n") <= 500
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            lines = (node.end_lineno or 0) - node.lineno + 1
            assert lines <= 80, f"{node.name} has {lines} lines"


def test_problem_codes_are_unique() -> None:
    uses: dict[str, list[str]] = {}
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text())):
            match node:
                case ast.Assign(targets=[ast.Name(id="code")], value=ast.Constant(value=str(code))):
                    uses.setdefault(code, []).append(f"{file.name}:{node.lineno}")
    assert uses
    assert {code: places for code, places in uses.items() if len(places) > 1} == {}


def modules_after(statement: str) -> set[str]:
    """Top-level names of what a fresh interpreter has imported after a statement, the last line of its output."""
    code = f"{statement}\nimport sys; print(); print(*{{name.partition('.')[0] for name in sys.modules}})"
    return set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_import_hierc_is_light() -> None:
    assert modules_after("import hierc").isdisjoint(
        {"lark", "sympy", "numba", "numpy", "scipy", "llvmlite", "matplotlib", "rich"}
    )


def test_the_command_line_answers_without_numerics() -> None:
    version = (
        "import contextlib, hierc.cli\nwith contextlib.suppress(SystemExit): hierc.cli.main(['--version'])"
    )
    assert modules_after(version).isdisjoint(
        {"lark", "sympy", "numpy", "scipy", "llvmlite", "matplotlib", "rich"}
    )


def test_the_runtime_needs_neither_parser_nor_algebra() -> None:
    assert modules_after("import hierc.runtime.model").isdisjoint({"lark", "sympy", "matplotlib", "rich"})


def test_every_public_name_is_there() -> None:
    import hierc

    assert set(hierc.__all__) <= set(dir(hierc))
    for name in hierc.__all__:
        assert getattr(hierc, name) is not None
    with pytest.raises(AttributeError, match="no attribute `nonsense`"):
        _ = hierc.nonsense


def readme_block(language: str) -> str:
    found = re.search(
        rf"^```{language}\n(.*?)^```$", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    )
    assert found, f"the README has no block of {language}"
    return found[1]


def test_the_readme_commands_are_those_that_are_checked() -> None:
    commands = [line.partition("#")[0].strip() for line in readme_block("sh").splitlines()]
    assert len(commands) == 2
    assert commands[0].endswith("hierc run models/cart.hier")
    assert commands[1].endswith("pytest")


def test_the_readme_model_runs() -> None:
    import numpy as np

    import hierc

    r = hierc.load(readme_block("hier")).simulate(rtol=1e-8, atol=1e-8)
    assert list(r.stats) == ["plan", "body", "motor"]
    assert r["r"] == pytest.approx(np.sin(2 * r.t), abs=1e-6)
    assert np.abs(r["r"] - r["q"])[-100:].max() < 0.05
