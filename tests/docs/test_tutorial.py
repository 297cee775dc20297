"""The tutorial is true: its models compile without warnings, its commands print what is shown, its Python gives the shown values."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest
from commands import is_shown, printed_by
from documents import DOCS, Block, accept, blocks, where

from hierc.explain import message_of, problems_of

DOCUMENT = DOCS / "tutorial.md"
BLOCKS = blocks(DOCUMENT)
MODELS = [block for block in BLOCKS if block.kind == "hier"]
FAILING = [i for i, block in enumerate(BLOCKS) if block.kind == "hier-error"]
COMMANDS = [block for block in BLOCKS if block.kind == "console"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with the models of the tutorial."""
    for block in MODELS:
        assert block.file_name
        (tmp_path / block.file_name).write_text(block.text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")
    return tmp_path


def test_no_block_is_left_untested() -> None:
    kinds = [block.kind for block in BLOCKS]
    assert set(kinds) == {"sh", "hier", "hier-error", "text", "console", "pycon"}
    assert kinds.count("sh") == 1  # how to install it, which the tests cannot
    assert [i for i, kind in enumerate(kinds) if kind == "text"] == [i + 1 for i in FAILING]


def test_every_section_is_in_the_contents() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    contents = re.findall(r"^- \[(.*)\]\(#([\w-]+)\)$", text, re.MULTILINE)
    assert contents == [(h, re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-")) for h in headings]


@pytest.mark.parametrize("block", MODELS, ids=where)
def test_models_compile_without_warnings(block: Block, folder: Path) -> None:
    assert [problem.title() for problem in problems_of(block.source, folder)] == []


@pytest.mark.parametrize("place", FAILING, ids=lambda place: where(BLOCKS[place]))
def test_messages_are_what_hierc_prints(place: int, request: pytest.FixtureRequest) -> None:
    block, shown = BLOCKS[place], BLOCKS[place + 1]
    message = message_of(block.source) + "\n"
    if request.config.getoption("--accept"):
        accept(DOCUMENT, shown, message, after=block.text)
    else:
        assert shown.text == message


@pytest.mark.parametrize("block", COMMANDS, ids=where)
def test_commands_print_what_is_shown(block: Block, folder: Path, request: pytest.FixtureRequest) -> None:
    printed = printed_by(block)
    if is_shown(block.text, printed):
        return
    if request.config.getoption("--accept"):
        accept(DOCUMENT, block, printed)
    else:
        assert block.text == printed


@pytest.mark.parametrize(
    ("shown", "printed", "expected"),
    [
        ("a\nb\n", "a\nb\n", True), ("a\n", "a\nb\n", False), ("a\nb\n", "a\n", False), ("a\n…\n", "a\nb\nc\n", True),
        ("a\n…\nc\n", "a\nb\nc\n", True), ("a\n…\nc\n", "a\nb\nd\n", False), ("a\n…\n", "b\n", False),
        ("  plan  radau13  1  12  1 µs  742 ms\n", "  plan  radau13  1  13  1 µs  700 ms\n", True),
        ("  plan  radau13  1  12  1 µs\n", "  plan  radau13  1  24  1 µs\n", False),
        ("  plan  radau13  1  12  1 µs\n", "  plan  radau9   1  12  1 µs\n", False),
        ("  plan  radau13  1  12  1 µs\n", "  body  radau13  1  12  1 µs\n", False),
    ],
)  # fmt: skip
def test_what_is_shown_is_compared_line_by_line(shown: str, printed: str, expected: bool) -> None:
    assert is_shown(shown, printed) == expected


def test_python_gives_what_is_shown(folder: Path) -> None:
    (block,) = (block for block in BLOCKS if block.kind == "pycon")
    example = doctest.DocTestParser().get_doctest(block.text, {}, "tutorial", str(DOCUMENT), block.line)
    said: list[str] = []
    outcome = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert outcome.attempted > 5
    assert outcome.failed == 0, "".join(said)
