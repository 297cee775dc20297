"""The error index: every code has a page, every page shows its problem, and `docs/errors.md` is up to date."""

from __future__ import annotations

from pathlib import Path

import pytest

from hierc.exits import UsageError
from hierc.explain import FAMILIES, explain, index, page, problem_kinds, problems_of, reference
from hierc.grammar.source import SourceFile

KINDS = problem_kinds()
PAGES = Path(__file__).parents[2] / "src" / "hierc" / "pages"
DOCUMENT = Path(__file__).parents[2] / "docs" / "errors.md"

#: Codes that no short text shows: limits on depth and size, and what is wrong with a command rather than with a model.
WITHOUT_EXAMPLE = {"E118", "E216", "E582", "E583", "E907", "E908", "E914", "E915"}


def test_every_code_has_an_example() -> None:
    assert {file.stem for file in PAGES.iterdir()} == set(KINDS) - WITHOUT_EXAMPLE


@pytest.mark.parametrize("code", sorted(set(KINDS) - WITHOUT_EXAMPLE))
def test_an_example_has_its_problem_and_no_other(code: str) -> None:
    example = page(KINDS[code]).example
    assert example is not None
    assert {problem.code for problem in problems_of(SourceFile("model.hier", example))} == {code}
    assert max(map(len, example.splitlines())) <= 140


def test_numbers_and_families_are_known() -> None:
    assert len({code[1:] for code in KINDS}) == len(KINDS)
    assert {code[1] for code in KINDS} <= set(FAMILIES)


def test_the_document_is_up_to_date(request: pytest.FixtureRequest) -> None:
    if request.config.getoption("--accept"):
        DOCUMENT.write_text(reference(), encoding="utf-8")
    assert DOCUMENT.read_text(encoding="utf-8") == reference()


@pytest.mark.parametrize("written", ["E601", "e601", "601", " E601 "])
def test_a_code_may_be_written_in_many_ways(written: str) -> None:
    text = explain(written)
    assert text.startswith("E601: broken cascade\n\nLevels are written slowest first")
    assert "    error[E601]: `ctl` (level `control`) reads `plant.q`" in text


def test_a_page_without_an_example_is_only_text() -> None:
    assert "gives" not in explain("E907")


@pytest.mark.parametrize("written", ["E61", "610", "x", "", "E6011"])
def test_an_unknown_code_is_answered_with_the_list(written: str) -> None:
    with pytest.raises(UsageError, match="hierc explain` lists them all"):
        explain(written)


def test_the_nearest_code_is_suggested() -> None:
    with pytest.raises(UsageError, match="did you mean E601"):
        explain("E61")


def test_the_index_names_every_code() -> None:
    lines = index().splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == sorted(KINDS, key=lambda c: c[1:])
    assert "  E601  broken cascade" in lines
