"""What the stages print, for the models of the gallery: golden text, accepted with `--accept`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from hierc.compiler.driver import STAGES, emit
from hierc.grammar.source import SourceFile

FOLDER = Path(__file__).parent / "dumps"


def source(name: str) -> SourceFile:
    return SourceFile(
        f"{name}.hier", files("hierc.models").joinpath(f"{name}.hier").read_text(encoding="utf-8")
    )


@pytest.mark.parametrize("stage", ["model", "cascade"])
@pytest.mark.parametrize("name", ["cart", "servo", "arm"])
def test_golden(name: str, stage: str, request: pytest.FixtureRequest) -> None:
    shown = emit(source(name), stage)
    expected = FOLDER / f"{name}.{stage}"
    if request.config.getoption("--accept"):
        expected.write_text(shown, encoding="utf-8")
    assert shown == expected.read_text(encoding="utf-8")


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_prints_the_same_twice(stage: str) -> None:
    text = emit(source("servo"), stage)
    assert text.endswith("\n")
    assert text == emit(source("servo"), stage)


def test_the_tree_is_shown_without_places() -> None:
    assert emit(SourceFile("a.hier", "const int n = 2;"), "ast") == (
        "- Const\n"
        "  type: Type\n"
        "    scalar: 'int'\n"
        "    sizes: ()\n"
        "  name: Name\n"
        "    text: 'n'\n"
        "  unit: None\n"
        "  value: Number\n"
        "    text: '2'\n"
        "    value: 2.0\n"
        "    is_int: True\n"
        "    unit: None\n"
    )


def test_an_unknown_stage() -> None:
    with pytest.raises(ValueError, match="choose from ast, model"):
        emit(source("servo"), "machine")
