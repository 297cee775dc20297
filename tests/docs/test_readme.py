"""The README is true: its model gives the table that it shows, it lists all documents, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from commands import is_shown, printed_by
from documents import DOCS, accept, blocks

DOCUMENT = DOCS.parent / "README.md"
TEXT = DOCUMENT.read_text(encoding="utf-8")


def test_the_command_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    (model,) = (block for block in blocks(DOCUMENT) if block.kind == "hier")
    (shown,) = (block for block in blocks(DOCUMENT) if block.kind == "console")
    assert model.file_name
    (tmp_path / model.file_name).write_text(model.text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    printed = printed_by(shown)
    if request.config.getoption("--accept") and not is_shown(shown.text, printed):
        accept(DOCUMENT, shown, printed)
    else:
        assert is_shown(shown.text, printed), printed


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", TEXT)
    assert links
    assert [link for link in links if not (DOCS.parent / link).exists()] == []


def test_every_document_is_listed() -> None:
    table = TEXT.partition("## Documents")[2].partition("\n## ")[0]
    assert set(re.findall(r"\(docs/(\w+\.md)\)", table)) == {file.name for file in DOCS.glob("*.md")}
