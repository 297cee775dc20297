"""Syntax problems: the wording of each, their number, and that nothing follows from one that is not its own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest

import hierc.grammar
from hierc.grammar import errors
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError, Problem, closest, in_source_order
from hierc.grammar.render import render_all
from hierc.grammar.source import SourceFile, Span

HERE = Path(__file__).parent
CASES = sorted((HERE / "problems").glob("*.hier"))
EXAMPLES = sorted((HERE / "examples").glob("*.hier"))


def problems_of(text: str, name: str = "test.hier") -> tuple[Problem, ...]:
    try:
        parse(SourceFile(name, text))
    except ModelError as error:
        return error.problems
    return ()


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_wording(case: Path, request: pytest.FixtureRequest) -> None:
    text = case.read_bytes().decode("utf-8")
    shown = render_all(problems_of(text, case.name)) + "\n"
    expected = case.with_suffix(".expected")
    if request.config.getoption("--accept"):
        expected.write_text(shown, encoding="utf-8")
    assert shown == expected.read_text(encoding="utf-8")


def kinds_of_problems(base: type[Problem] = Problem) -> Iterator[type[Problem]]:
    for module in iter_modules(hierc.grammar.__path__):
        import_module(f"hierc.grammar.{module.name}")
    for kind in base.__subclasses__():
        if kind.__module__.startswith("hierc.grammar"):
            yield kind
            yield from kinds_of_problems(kind)


def test_codes_are_unique_and_explained() -> None:
    kinds = list(kinds_of_problems())
    codes = [kind.code for kind in kinds]
    assert len(set(codes)) == len(codes) > 20
    assert all(re.fullmatch(r"[EW][0-9]{3}", code) for code in codes)
    assert all(kind.explanation.endswith(".") for kind in kinds)


def test_every_syntax_problem_has_a_case() -> None:
    shown = "".join(case.with_suffix(".expected").read_text(encoding="utf-8") for case in CASES)
    codes = {kind.code for kind in kinds_of_problems()} - {errors.UnreadableFile.code}
    assert {code for code in codes if f"[{code}]" not in shown} == set()


# ---- one slip, one problem ----------------------------------------------------------------------


def signs(sign: str) -> Iterator[tuple[str, int]]:
    """Each place of a sign in the code of the examples, as text and offset."""
    for path in EXAMPLES:
        text = path.read_text(encoding="utf-8")
        blanked = re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"])*"', lambda m: " " * len(m.group()), text)
        yield from ((text, match.start()) for match in re.finditer(re.escape(sign), blanked))


def test_a_missing_semicolon_is_one_problem_at_its_place() -> None:
    for text, place in signs(";"):
        without = text[:place] + text[place + 1 :]
        found = problems_of(without)
        assert len(found) == 1, without[place - 40 : place + 40]
        assert found[0].span is not None
        if isinstance(found[0], errors.MissingSemicolon):
            assert found[0].span.start == len(text[:place].rstrip())
        else:  # on one line with the next statement
            assert found[0].span.start == len(without) - len(without[place:].lstrip())


@pytest.mark.parametrize("sign", ["{", "}", "(", ")", "[", "]"])
def test_a_missing_bracket_is_seldom_more_than_one_problem(sign: str) -> None:
    counts = [len(problems_of(text[:place] + text[place + 1 :])) for text, place in signs(sign)]
    assert min(counts) >= 1
    assert sum(count > 1 for count in counts) <= 0.1 * len(counts)
    assert max(counts) <= 4


def test_all_problems_of_a_file_are_found() -> None:
    good = "agent A{i}() {{\n  write real x = 0;\n  diff {{ x' = 1; }}\n}}\n"
    bad = "agent B{i}() {{\n  write real x = (0;\n  diff {{ x' = ; }}\n  let a = 1\n  let mode = 2;\n}}\n"
    text = "".join(good.format(i=i) + bad.format(i=i) for i in range(20))
    assert [p.code for p in problems_of(text)] == ["E110", "E110", "E111", "E102"] * 20


def test_a_file_that_is_no_model_ends_early() -> None:
    assert 1 <= len(problems_of("lorem ipsum; " * 10_000)) <= 100


def test_problems_come_in_source_order() -> None:
    found = problems_of("agent A() { let a = 1e999; read real mode; let b = .5; }")
    assert [p.code for p in found] == ["E117", "E102", "E104"]
    assert list(found) == in_source_order(reversed(found))


def test_an_empty_file_is_an_empty_model() -> None:
    for text in ("", "\n", "// only a comment", "/// doc\n/* and more */"):
        assert parse(SourceFile("empty", text)).items == ()


# ---- did you mean -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "candidates", "meant"),
    [
        ("thte", ["theta", "x", "time"], "theta"),
        ("Lag", ["lag", "Lab"], "lag"),
        ("mas", ["m", "l"], "m"),
        ("tale", ["plan", "tail"], "tail"),
        ("goal_rat", ["goal", "goal_rate"], "goal_rate"),
        ("x", ["velocity", "q"], None),
        ("same", ["same"], None),
    ],
)
def test_closest(name: str, candidates: list[str], meant: str | None) -> None:
    assert closest(name, candidates) == closest(name, reversed(candidates)) == meant


def test_a_problem_without_a_place_comes_first() -> None:
    file = SourceFile("f", "x")
    placed = errors.MissingSemicolon(Span(file, 0, 0))
    nowhere = errors.UnreadableFile(None, "f", "because")
    assert in_source_order([placed, nowhere]) == [nowhere, placed]


def test_a_comparison_elsewhere_is_not_chained() -> None:
    found = problems_of("agent A() { inv { 0 < x < 1; } let a < 3; let b = 1; }")
    assert [p.code for p in found] == ["E116", "E110"]
