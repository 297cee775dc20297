"""Problems on the screen and as data."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hierc.grammar.errors import MissingSemicolon, UnreadableFile
from hierc.grammar.problems import Label, Problem
from hierc.grammar.render import WINDOW, render, render_all, to_json, visible
from hierc.grammar.source import SourceFile, Span


@dataclass(frozen=True)
class Sample(Problem):
    code = "E000"

    others: tuple[Label, ...] = ()
    said: str = "here"
    noted: tuple[str, ...] = ()

    def title(self) -> str:
        return "a problem"

    def remark(self) -> str:
        return self.said

    def labels(self) -> tuple[Label, ...]:
        return self.others

    def notes(self) -> tuple[str, ...]:
        return self.noted

    def help(self) -> tuple[str, ...]:
        return tuple(f"help {n}" for n in self.noted)


def span(text: str, part: str, name: str = "m.hier") -> Span:
    start = text.index(part)
    return Span(SourceFile(name, text), start, start + len(part))


def body(problem: Problem) -> list[str]:
    """The lines below the heading, the place and the empty bar."""
    return render(problem).split("\n")[3:]


def test_one_span() -> None:
    assert render(Sample(span("abc\ndef ghi\n", "ghi"))).split("\n") == [
        "error[E000]: a problem",
        " --> m.hier:2:5",
        "  |",
        "2 | def ghi",
        "  |     ^^^ here",
    ]


def test_labels_on_one_line_hang_below_the_last() -> None:
    text = "one two three"
    file = SourceFile("m.hier", text)
    spans = [Span(file, 0, 3), Span(file, 4, 7), Span(file, 8, 13)]
    problem = Sample(spans[1], (Label(spans[0], "first"), Label(spans[2], "third")))
    assert body(problem) == [
        "1 | one two three",
        "  | --- ^^^ ----- third",
        "  | |   |",
        "  | |   here",
        "  | first",
    ]


def test_a_label_without_text_is_only_underlined() -> None:
    text = "one two"
    file = SourceFile("m.hier", text)
    assert body(Sample(Span(file, 4, 7), (Label(Span(file, 0, 3)),)))[-1] == "  | --- ^^^ here"


def test_labels_on_other_lines_and_in_other_files() -> None:
    lines = "".join(f"line {i}\n" for i in range(1, 13))
    file = SourceFile("m.hier", lines)
    at = [m.start() for m in re.finditer("line", lines)]
    elsewhere = SourceFile("other.hier", "over there")
    problem = Sample(
        Span(file, at[11], at[11] + 4),
        (
            Label(Span(file, at[0], at[0] + 4), "a"),
            Label(Span(file, at[9], at[9] + 4), "b"),
            Label(Span(elsewhere, 5, 10), "c"),
        ),
    )
    assert render(problem).split("\n")[1:] == [
        "  --> m.hier:12:1",
        "   |",
        " 1 | line 1",
        "   | ---- a",
        "...",
        "10 | line 10",
        "   | ---- b",
        "11 | line 11",
        "12 | line 12",
        "   | ^^^^ here",
        "  ::: other.hier:1:6",
        "   |",
        " 1 | over there",
        "   |      ----- c",
    ]


def test_a_span_of_several_lines_shows_its_ends() -> None:
    text = "a = f(\n  1,\n  2,\n  3\n);\n"
    assert body(Sample(span(text, "f(\n  1,\n  2,\n  3\n)"))) == [
        "1 | a = f(",
        "  |     ^^",
        "...",
        "5 | );",
        "  | ^ here",
    ]


def test_a_span_that_ends_with_a_line_break_stays_on_its_line() -> None:
    assert body(Sample(span("abc\ndef\n", "abc\n"))) == ["1 | abc", "  | ^^^ here"]


@pytest.mark.parametrize("text", ["", "abc", "abc\n"])
def test_a_span_at_the_end_of_the_file_has_a_caret(text: str) -> None:
    end = Span(SourceFile("m.hier", text), len(text), len(text))
    assert body(Sample(end))[-1].endswith("^ here")


@pytest.mark.parametrize(
    ("before", "columns"),
    [
        ("\t", 4),
        ("ab\t", 4),
        ("漢字", 4),
        ("e\u0301", 1),
        ("\u202e", len("<U+202E>")),
        ("\x1b", len("<U+001B>")),
    ],
    ids=["tab", "half a tab", "wide", "combining", "bidi", "escape"],
)
def test_carets_stand_under_the_text(before: str, columns: int) -> None:
    line, carets = body(Sample(span(f"{before}name rest", "name")))
    assert carets == "  | " + " " * columns + "^^^^ here"
    assert "\t" not in line


def test_long_lines_are_clipped_around_the_span() -> None:
    text = "x" * 5000 + " NAME " + "y" * 5000
    line, carets = body(Sample(span(text, "NAME")))
    assert len(line) <= WINDOW + 6
    assert line[carets.index("^") : carets.rindex("^") + 1] == "NAME"
    assert (line[4], line[-1]) == ("…", "…")


def test_notes_and_help_follow() -> None:
    assert body(Sample(span("abc", "b"), (), "", ("n", "two\nlines")))[1:] == [
        "  |  ^",
        "  = note: n",
        "  = note: two",
        "          lines",
        "  = help: help n",
        "  = help: help two",
        "          lines",
    ]


def test_a_problem_without_a_place_has_only_its_text() -> None:
    problem = UnreadableFile(None, "m.hier", "it is a folder", ("name a file",))
    assert render(problem) == "error[E907]: cannot read `m.hier`: it is a folder\n = help: name a file"


def test_colour_changes_no_character() -> None:
    text = "one two\nthree"
    file = SourceFile("m.hier", text)
    problem = Sample(
        Span(file, 4, 7), (Label(Span(file, 0, 3), "a"), Label(Span(file, 8, 13), "b")), "here", ("n",)
    )
    coloured = render(problem, color=True)
    assert "\x1b[1;31m^^^" in coloured
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured) == render(problem)


def test_render_all_puts_one_below_the_other() -> None:
    problem = Sample(span("abc", "b"))
    assert render_all([problem, problem]) == render(problem) + "\n" + render(problem)


def test_json_has_every_field() -> None:
    text = "one\ntwo three"
    other = Label(span(text, "one"), "first")
    data = to_json(Sample(span(text, "two"), (other,), "here", ("n",)))
    assert json.loads(json.dumps(data)) == {
        "code": "E000",
        "severity": "error",
        "title": "a problem",
        "file": "m.hier",
        "line": 2,
        "column": 1,
        "end_line": 2,
        "end_column": 4,
        "remark": "here",
        "labels": [
            {"file": "m.hier", "line": 1, "column": 1, "end_line": 1, "end_column": 4, "text": "first"}
        ],
        "notes": ["n"],
        "help": ["help n"],
        "edits": [],
    }
    missing = MissingSemicolon(span(text, "two"))
    assert to_json(missing)["edits"] == [
        {"file": "m.hier", "line": 2, "column": 1, "end_line": 2, "end_column": 4, "text": ";"}
    ]
    assert to_json(UnreadableFile(None, "m.hier", "why"))["line"] is None


@given(st.text(), st.text(max_size=30), st.data())
def test_nothing_of_the_user_reaches_the_terminal_raw(text: str, name: str, data: st.DataObject) -> None:
    file = SourceFile(name, text)
    ends = st.integers(0, len(text))
    spans = [Span(file, *sorted((data.draw(ends), data.draw(ends)))) for _ in range(3)]
    shown = render(Sample(spans[0], tuple(Label(s, name) for s in spans[1:]), name, (name,)))
    assert all(visible(line) == line for line in shown.split("\n"))
    json.dumps(to_json(Sample(spans[0], (Label(spans[1], name),))))
