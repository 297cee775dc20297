"""Opening model files: what is text is read, everything else is refused in one line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hierc.grammar import reading
from hierc.grammar.problems import ModelError
from hierc.grammar.reading import read_source
from hierc.grammar.source import SourceFile, Span


def refusal(path: str | Path) -> str:
    with pytest.raises(ModelError) as caught:
        read_source(path)
    (problem,) = caught.value.problems
    assert problem.code == "E907"
    assert problem.span is None
    return problem.title()


def test_text_is_read_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "m.hier"
    path.write_bytes("a\r\nµ\n".encode())
    assert read_source(path) == SourceFile(str(path), "a\r\nµ\n")


def test_a_byte_order_mark_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "m.hier"
    path.write_bytes(b"\xef\xbb\xbfagent")
    assert read_source(path).text == "agent"


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "missing.hier")
    assert "it is a folder" in refusal(tmp_path)
    assert "not a possible file name" in refusal("a\0b")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
def test_a_fifo_is_refused_without_waiting_for_its_writer(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "not a regular file" in refusal(tmp_path / "pipe")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
def test_an_endless_device_is_refused() -> None:
    assert "not a regular file" in refusal("/dev/zero")


def test_other_encodings_are_refused_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / "m.hier"
    path.write_bytes("// gut\n// größer\n".encode("latin-1"))
    assert "line 2 is not UTF-8 text" in refusal(path)


def test_large_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "LARGEST_FILE", 2**20)
    path = tmp_path / "m.hier"
    path.write_bytes(b" " * 2**20)
    assert len(read_source(path).text) == 2**20
    path.write_bytes(b" " * (2**20 + 1))
    assert "larger than 1 MB" in refusal(path)


def test_lines_and_columns() -> None:
    file = SourceFile("m", "ab\r\n\ncd")
    assert [file.position(i) for i in range(8)] == [
        (1, 1),
        (1, 2),
        (1, 3),
        (1, 4),
        (2, 1),
        (3, 1),
        (3, 2),
        (3, 3),
    ]
    assert [file.line(n) for n in (1, 2, 3)] == ["ab", "", "cd"]
    assert Span(file, 5, 6).to(Span(file, 0, 2)) == Span(file, 0, 6)
    assert (Span(file, 5, 7).text, Span(file, 5, 7).line) == ("cd", 3)
