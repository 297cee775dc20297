"""Problems of the compiler's front half: the wording of each, in the window that the user sees."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from hierc.compiler import unsupported
from hierc.compiler.arrays import errors as array_errors
from hierc.compiler.front import analyse
from hierc.compiler.imports import errors as import_errors
from hierc.compiler.resolve import errors as name_errors
from hierc.compiler.structure import errors as experiment_errors
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError, Problem
from hierc.grammar.render import render_all
from hierc.grammar.source import SourceFile

CASES = sorted((Path(__file__).parent / "problems").glob("*.hier"))
PHASES = ("callees", "imports", "resolve", "shapes", "units", "equations", "cascade", "structure")


def problems_of(text: str, name: str = "test.hier", **choice: object) -> tuple[Problem, ...]:
    """All problems, or the warnings of a model that has no errors."""
    try:
        return analyse(parse(SourceFile(name, text)), **choice).warnings
    except ModelError as error:
        return error.problems


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_wording(case: Path, request: pytest.FixtureRequest) -> None:
    shown = render_all(problems_of(case.read_text(encoding="utf-8"), case.name)) + "\n"
    expected = case.with_suffix(".expected")
    if request.config.getoption("--accept"):
        expected.write_text(shown, encoding="utf-8")
    assert shown == expected.read_text(encoding="utf-8")
    assert f"[{case.stem[:4].upper()}]" in shown


def kinds_of_problems() -> Iterator[type[Problem]]:
    for name in (*(f"{phase}.errors" for phase in PHASES), "arrays.errors", "unsupported"):
        module = import_module(f"hierc.compiler.{name}")
        for kind in vars(module).values():
            if (
                isinstance(kind, type)
                and issubclass(kind, Problem)
                and kind not in (Problem, unsupported.NotSupported)
            ):
                yield kind


def test_codes_are_unique_and_explained() -> None:
    kinds = list(kinds_of_problems())
    codes = [kind.code for kind in kinds]
    assert len(set(codes)) == len(codes) > 60
    assert all(re.fullmatch(r"[EW][0-9]{3}", code) for code in codes)
    assert all(kind.code[0] == kind.severity[0].upper() for kind in kinds)
    assert all(kind.explanation.endswith(".") for kind in kinds)


def test_every_problem_has_a_case() -> None:
    elsewhere = {
        experiment_errors.UnknownExperiment.code,
        name_errors.NestedTooDeeply.code,
        array_errors.CountsDiffer.code,
    }
    elsewhere |= {
        kind.code for kind in kinds_of_problems() if kind.__module__ == import_errors.__name__
    }  # tests/cli
    covered = {case.stem[:4].upper() for case in CASES} | elsewhere
    assert {kind.code for kind in kinds_of_problems()} - covered == set()
