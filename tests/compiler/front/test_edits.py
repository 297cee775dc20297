"""Edits mend what they are offered for, and a mistake is reported once, at its place, whatever stands around it."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_problems import CASES, problems_of

from hierc.compiler.driver import check_source, compile_source
from hierc.grammar.problems import ModelError, Problem, apply
from hierc.grammar.source import SourceFile

PAGES = sorted((Path(__file__).parents[3] / "src" / "hierc" / "pages").glob("*.hier"))
PLANT = """\
agent Lag(real T [s] = 1) {
  read real u [m];
  write real y [m] = 0;
  diff { y' = (u - y)/T; }
}
"""


def checked(text: str) -> tuple[Problem, ...]:
    """All problems of a text, of the phases of `hierc check`; warnings only if there are no errors."""
    try:
        return check_source(SourceFile("test.hier", text))
    except ModelError as error:
        return error.problems


def place(problem: Problem) -> tuple[str, str, int]:
    return problem.code, problem.title(), -1 if problem.span is None else problem.span.start


@pytest.mark.parametrize("case", [*CASES, *PAGES], ids=lambda path: path.stem)
def test_the_edits_of_golden_cases_mend_them(case: Path) -> None:
    text = case.read_text(encoding="utf-8")
    for problem in problems_of(text, case.name):
        if problem.edits():
            mended = apply(problem.edits(), text)
            assert place(problem) not in map(place, problems_of(mended, case.name))


MENDED = {
    "E201": (
        "let a = 2*gain_; let b = a*gian; alge { z = b; }",
        "let a = 2*gain; let b = a*gain; alge { z = b; }",
    ),
    "E204": ("agent a = Lag() [U := z]; alge { z = 1; }", "[u := z]"),
    "E206": ("agent a = Lag(t = 2 [s]) [u := z]; alge { z = 1; }", "Lag(T = 2 [s])"),
    "E207": ("agent a = Lga() [u := z]; alge { z = 1; }", "agent a = Lag() [u := z];"),
    "E213": ("alge { z = sqtr(gain)*1 [m]; }", "sqrt(gain)"),
    "E404": ("alge { z = gain*2 [meters]; }", "2 [m]"),
    "E503": ("write real v [m/s]; alge { z = 1; } diff { v' = 0; }", "write real v [m/s] = 0 [m/s];"),
}


@pytest.mark.parametrize("code", sorted(MENDED))
def test_a_name_is_mended_by_one_of_its_kind(code: str) -> None:
    """The edits of all problems, made, give a model without errors that has the expected text."""
    body, expected = MENDED[code]
    text = f"{PLANT}agent Top(real gain = 2) {{\n  write real z [m];\n  {body}\n}}\n"
    found = [p for p in checked(text) if p.severity == "error"]
    assert {p.code for p in found} == {code}
    mended = apply([edit for p in found for edit in p.edits()], text)
    assert [p for p in checked(mended) if p.severity == "error"] == []
    assert expected in mended


def test_a_vector_without_initial_value_is_mended() -> None:
    text = "agent A() {\n  write real[2] p [m];\n  diff { p' = -p/(1 [s]); }\n}\n"
    (problem,) = checked(text)
    assert problem.code == "E503"
    mended = apply(problem.edits(), text)
    assert "p [m] = zeros(2);" in mended
    compile_source(SourceFile("test.hier", mended))


SETTINGS = """\
agent Top() {{
  agent one = Lag() [u := 1 [m]];
}}
experiment e of Top({arguments}) {{
  {items}
}}
"""


@pytest.mark.parametrize(
    ("arguments", "items", "code", "expected"),
    [
        ("", "stopp = 1 [s];", "E903", "stop = 1 [s];"),
        ("", "metod = radau5;", "E903", "method = radau5;"),
        ("", "record one.yy;", "E904", "record one.y;"),
        ("", "init { one.yy = 2 [m]; }", "E910", "init { one.y = 2 [m]; }"),
        ("oen.T = 2 [s]", "", "E910", "one.T = 2 [s]"),
        ("one.TT = 2 [s]", "", "E206", "one.T = 2 [s]"),
    ],
)
def test_experiments_are_mended(arguments: str, items: str, code: str, expected: str) -> None:
    text = PLANT + SETTINGS.format(arguments=arguments, items=items)
    (problem,) = checked(text)
    assert problem.code == code
    mended = apply(problem.edits(), text)
    assert expected in mended
    assert checked(mended) == ()


# ---- kinds of names -----------------------------------------------------------------------------


def helps(use: str) -> list[tuple[str, tuple[str, ...]]]:
    return [(p.code, p.help()) for p in checked(f"{PLANT}agent Top() {{ {use} }}\n")]


def test_a_read_variable_given_as_an_argument() -> None:
    assert helps("agent a = Lag(u = 1 [m]);") == [
        ("E206", ("`u` is a `read` variable: couple it, `[u := …]`",))
    ]


def test_a_parameter_given_as_a_coupling() -> None:
    assert helps("agent a = Lag() [u := 1 [m], T := 2 [s]];") == [
        ("E204", ("`T` is a parameter: `Lag(T = …)`",))
    ]


def test_an_output_given_as_a_coupling() -> None:
    assert helps("agent a = Lag() [u := 1 [m], y := 2 [m]];") == [
        ("E204", ("`y` is what `Lag` computes; a coupling gives it what it reads",))
    ]


def test_what_a_misspelt_name_stands_for_is_not_missing() -> None:
    assert [code for code, _ in helps("agent a = Lag() [uu := 1 [m]];")] == ["E204"]
    text = "agent B(real size) { }\nagent A() { agent b = B(sise = 1); }\n"
    assert [p.code for p in checked(text)] == ["E206"]
    text = "agent A() {\n  write real x = 0;\n  let speed = 2;\n  diff { x' = sped; }\n}\n"
    assert [p.code for p in checked(text)] == ["E201"]


# ---- many at once -------------------------------------------------------------------------------

NAMES = """\
const real g [m/s^2] = 9.81;
agent Ball(real e = 0.8) {
  read real wind [m/s];
  write real h [m] = 1, v [m/s] = 0;
  private real heat = 0;
  let drag = 0.1 [1/s]*(v - wnd);
  diff { h' = v; v' = -gg - drag; heat' = absolute(v); }
}
agent Pair() {
  agent one = Ball(ee = 0.5) [wind := 0];
  agent two = Ball() [wimd := 1];
  agent three = Bal() [wind := 0];
  agent four = Ball() [wind := one.heat];
  agent four = Ball() [wind := 0];
  agent five = Ball() [wind := one.hh];
}
"""


def test_every_independent_mistake_is_reported_once() -> None:
    found = [(p.code, p.span.line if p.span else 0) for p in checked(NAMES)]
    assert found == [
        ("W511", 5), ("E201", 6), ("E201", 7), ("E213", 7), ("E206", 10), ("E204", 11), ("E207", 12), ("E205", 13), ("E202", 14), ("E201", 15),
    ]  # fmt: skip


SYNTAX = """\
agent Ball(real e = .8, k) {
  write h [m] = 1;
  write real v [m/s] = 0
  let a = if v > 0 then 1;
  let b = (v + 1;
  let mode = 3;
  diff { h' = v, v' == -9.81 [m/s^2]; }
  x = 3;
}
experiment e of Ball { stop = 10 s; save out.csv; }
"""


def test_every_slip_is_reported_once() -> None:
    found = [(p.code, p.span.line if p.span else 0) for p in checked(SYNTAX)]
    assert found == [
        ("E104", 1), ("E110", 1), ("E110", 2), ("E111", 3), ("E110", 4), ("E110", 5), ("E102", 6), ("E110", 7), ("E113", 7), ("E122", 8),
        ("E110", 10), ("E119", 10), ("E110", 10),
    ]  # fmt: skip


# ---- places -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "column", "marked"),
    [
        ("agent A() {\r\n  write real x = 0;\r\n  diff { x' = y; }\r\n}\r\n", 3, 15, "y"),
        ("agent A() {\n\twrite real x = 0;\n\tdiff {\tx' = y; }\n}\n", 3, 14, "y"),
        ("/* µΩ 車 😀 */ agent A() { write real x [µm] = 0; diff { x' = y; } }\n", 1, 61, "y"),
        (
            "agent A() {\n  write real x = 0;\n  diff {\n    x' = 1\n      + (2\n      - y);\n  }\n}\n",
            6,
            9,
            "y",
        ),
        ("// Ω\nagent A() { write real r [Ω] = 0; diff { r' = r.s; } }\n", 2, 47, "r.s"),
    ],
)
def test_places_are_exact(text: str, line: int, column: int, marked: str) -> None:
    (problem,) = checked(text)
    assert problem.code == "E201"
    assert problem.span is not None
    assert problem.span.file.position(problem.span.start) == (line, column)
    assert problem.span.text == marked
