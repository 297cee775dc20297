"""`docs/messages.md` is true: its example, the fields of each kind of JSON, and the exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hierc import exits
from hierc.cli import main
from hierc.explain import message_of, problem_kinds, problems_of
from hierc.grammar.problems import apply
from hierc.grammar.render import to_json
from hierc.grammar.source import SourceFile

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
PAGES = sorted((ROOT / "src" / "hierc" / "pages").glob("*.hier"))
PLACE = {"file", "line", "column", "end_line", "end_column"}


def block(kind: str) -> str:
    found = re.search(rf"^```{kind}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    assert found
    return found[1]


def section(heading: str) -> str:
    found = re.search(rf"^#+ {heading}\n(.*?)(?=^#|\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert found
    return found[1]


def listed_fields(heading: str) -> set[str]:
    """The names in the first column of a section's table."""
    rows = re.findall(r"^\| (`[^|]*`) \|", section(heading), re.MULTILINE)
    return {name for row in rows for name in re.findall(r"`(\w+)`", row)}


def example() -> SourceFile:
    return SourceFile("model.hier", block("hier-message"))


def test_the_example_is_what_is_printed() -> None:
    assert message_of(example()) + "\n" == block("text")


def test_the_json_is_what_is_printed() -> None:
    assert json.loads(block("json")) == to_json(problems_of(example())[1])


def test_the_edits_of_the_example_mend_it() -> None:
    source = example()
    edits = [edit for problem in problems_of(source) for edit in problem.edits()]
    mended = SourceFile("model.hier", apply(edits, source.text))
    assert [problem.code for problem in problems_of(mended)] == [
        "E203"
    ]  # nothing gives the agent its input here


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_problem_has_the_listed_fields(page: Path) -> None:
    fields = listed_fields("Problems")
    for problem in problems_of(SourceFile("model.hier", page.read_text(encoding="utf-8"))):
        data = json.loads(json.dumps(to_json(problem)))
        assert set(data) == fields
        assert_types(data)


def assert_types(data: dict[str, object]) -> None:
    """As the table says, for the problem and all places in it."""
    assert re.fullmatch(r"[EW]\d{3}", str(data["code"]))
    assert data["severity"] == {"E": "error", "W": "warning"}[str(data["code"])[0]]
    assert re.fullmatch(r"[^\n]+", str(data["title"]))
    assert isinstance(data["remark"], str)
    for name in ("notes", "help"):
        texts = data[name]
        assert isinstance(texts, list)
        assert all(isinstance(text, str) and text for text in texts)
    places = [data]
    for name in ("labels", "edits"):
        entries = data[name]
        assert isinstance(entries, list)
        assert all(set(entry) == PLACE | {"text"} for entry in entries)
        places += entries
    for place in places:
        if place["file"] is None:
            assert all(place[name] is None for name in PLACE)
            continue
        begin, end = (place["line"], place["column"]), (place["end_line"], place["end_column"])
        assert all(isinstance(number, int) and number >= 1 for number in (*begin, *end))
        assert begin <= end  # type: ignore[operator]


def test_codes_are_as_the_table_says() -> None:
    assert all(re.fullmatch(r"[EW]\d{3}", code) for code in problem_kinds())


MODEL = "agent A(real k [m] = 2) { write real y; alge { y = time*k; } }\n"


def printed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, object]]:
    code = main(arguments)
    return code, json.loads(capsys.readouterr().out)


def test_each_command_prints_the_listed_fields(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.hier", tmp_path / "bad.hier"
    good.write_text(MODEL, encoding="utf-8")
    bad.write_text(block("hier-message"), encoding="utf-8")
    code, run = printed(["run", str(good), "--stop", "1", "--json"], capsys)
    assert code == exits.OK
    assert set(run) == listed_fields("A run")
    code, params = printed(["params", str(good), "--json"], capsys)
    assert (code, set(params)) == (exits.OK, listed_fields("Parameters"))
    entries = params["parameters"]
    assert isinstance(entries, list)
    assert set(entries[0]) <= set(re.findall(r"`(\w+)`", section("Parameters")))
    for command in ("check", "run", "params"):
        code, problems = printed([command, str(bad), "--json"], capsys)
        assert (code, set(problems)) == (exits.MODEL_ERROR, {"problems"})
    assert printed(["check", str(good), "--json"], capsys) == (exits.OK, {"problems": []})


def test_fields_of_a_group_are_listed() -> None:
    from dataclasses import fields

    from hierc.runtime.families import FamilyStats
    from hierc.runtime.result import GroupStats

    row = re.findall(r"^\| `groups` .*$", section("A run"), re.MULTILINE)[0]
    single, array = (set(re.findall(r"`(\w+)`", part)) for part in row.split("for the groups of an array"))
    assert single - {"groups"} == {field.name for field in fields(GroupStats)}
    assert single | array == {field.name for kind in (GroupStats, FamilyStats) for field in fields(kind)} - {
        "name"
    }


def test_exit_codes_are_listed() -> None:
    codes = {value for name, value in vars(exits).items() if name.isupper()}
    assert {int(code) for code in re.findall(r"^\| (\d+) \|", section("Exit codes"), re.MULTILINE)} == codes
