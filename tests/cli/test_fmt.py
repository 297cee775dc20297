"""`hierc fmt`: what is written, what is told, and the exit codes."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import pytest

from hierc.cli import main

UNTIDY = "agent A( ){read real x ;}  // 1\n"
TIDY = "agent A() { read real x; }  // 1\n"
BROKEN = "agent A( {\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(folder: Path, **texts: str) -> None:
    for name, text in texts.items():
        path = folder / f"{name.replace('__', '/')}.hier"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())


def pipe(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))


def test_files_and_folders(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(folder, a=UNTIDY, m__b=UNTIDY, m__deep__c=TIDY, m__hidden=UNTIDY, other=UNTIDY)
    (folder / "m" / "hidden.hier").rename(folder / "m" / ".hidden.hier")
    (folder / "m" / "link.hier").symlink_to(folder / "other.hier")
    (folder / "m" / "notes.txt").write_text(UNTIDY)
    assert main(["fmt", "m", "a.hier", "./a.hier"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "formatted: m/b.hier\nformatted: a.hier\n3 files read, 2 changed\n"
    assert [p.read_text() for p in sorted(folder.rglob("[abc].hier"))] == [TIDY] * 3
    assert (folder / "m" / ".hidden.hier").read_text() == UNTIDY
    assert (folder / "m" / "notes.txt").read_text() == UNTIDY
    assert (folder / "other.hier").read_text() == UNTIDY
    assert main(["fmt", "m", "a.hier"]) == 0
    assert capsys.readouterr().err == "3 files read, none changed\n"


def test_check_lists_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(folder, a=UNTIDY, b=TIDY)
    assert main(["fmt", "--check", "a.hier", "b.hier"]) == 1
    assert capsys.readouterr() == ("", "would change: a.hier\n2 files read, 1 would change\n")
    assert (folder / "a.hier").read_text() == UNTIDY
    assert main(["fmt", "--check", "b.hier"]) == 0


def test_diff_is_a_patch(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(folder, a=UNTIDY.strip(), b=TIDY)
    assert main(["fmt", "--diff", "a.hier", "b.hier"]) == 0
    out, _ = capsys.readouterr()
    assert out == (
        "--- a.hier\n+++ a.hier\n@@ -1 +1 @@\n"
        f"-{UNTIDY}\\ No newline at end of file\n+{TIDY}"
    )  # fmt: skip
    assert (folder / "a.hier").read_text() == UNTIDY.strip()
    assert main(["fmt", "--diff", "--check", "a.hier"]) == 1
    assert capsys.readouterr().out == out


def test_errors_leave_a_file_alone_and_format_the_others(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(folder, a=BROKEN, b=UNTIDY)
    assert main(["fmt", ".", "missing.hier"]) == 1
    err = capsys.readouterr().err
    assert "error[E110]" in err
    assert "cannot read `missing.hier`" in err
    assert err.endswith("1 file read, 1 changed, 2 with errors left alone\n")
    assert (folder / "a.hier").read_text() == BROKEN
    assert (folder / "b.hier").read_text() == TIDY


def test_mode_line_breaks_and_links_stay(folder: Path) -> None:
    write(folder, a=UNTIDY.replace("\n", "\r\n"))
    (folder / "a.hier").chmod(0o640)
    (folder / "l.hier").symlink_to("a.hier")
    assert main(["fmt", "l.hier"]) == 0
    assert (folder / "a.hier").read_bytes() == TIDY.replace("\n", "\r\n").encode()
    assert (folder / "a.hier").stat().st_mode & 0o777 == 0o640
    assert (folder / "l.hier").is_symlink()


def test_what_is_tidy_is_not_touched(folder: Path) -> None:
    write(folder, a=TIDY)
    before = (folder / "a.hier").stat()
    assert main(["fmt", "a.hier"]) == 0
    after = (folder / "a.hier").stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)


def test_stdin(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pipe(monkeypatch, UNTIDY.replace("1", "µ").encode())
    assert main(["fmt", "-"]) == 0
    assert capsys.readouterr() == (TIDY.replace("1", "µ"), "")
    pipe(monkeypatch, UNTIDY.encode())
    assert main(["fmt", "-", "--check"]) == 1
    assert capsys.readouterr() == ("", "would change: <stdin>\n")
    pipe(monkeypatch, UNTIDY.encode())
    assert main(["fmt", "-", "--diff"]) == 0
    assert capsys.readouterr().out.startswith("--- <stdin>\n")
    pipe(monkeypatch, BROKEN.encode())
    assert main(["fmt", "-"]) == 1
    assert capsys.readouterr().out == ""
    pipe(monkeypatch, b"agent A() {}\n// \xff")
    assert main(["fmt", "-"]) == 1
    assert "line 2 is not UTF-8 text" in capsys.readouterr().err


def test_width(folder: Path) -> None:
    write(folder, a="const real x = a + b;\n")
    assert main(["fmt", "--width", "20", "a.hier"]) == 0
    assert (folder / "a.hier").read_text() == "const real x = a\n  + b;\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-", "a.hier"], "cannot stand beside files"),
        (["empty"], "there is no .hier file in `empty`"),
        (["--width", "0", "a.hier"], "at least one column"),
    ],
)
def test_wrong_usage(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    (folder / "empty").mkdir()
    write(folder, a=UNTIDY)
    assert main(["fmt", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert (folder / "a.hier").read_text() == UNTIDY


def test_no_path_is_wrong_usage() -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["fmt"])


def test_a_file_that_cannot_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", ".a.hier.temporary")

    write(folder, a=UNTIDY)
    monkeypatch.setattr("os.fsync", full)
    assert main(["fmt", "a.hier"]) == 2
    assert capsys.readouterr().err == "hierc: error: `a.hier`: No space left on device\n"
    assert [p.name for p in folder.iterdir()] == ["a.hier"]
    assert (folder / "a.hier").read_text() == UNTIDY


def test_a_fault_of_the_formatter_leaves_the_file_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(folder, a=UNTIDY)
    monkeypatch.setattr("hierc.grammar.formatting.layout", lambda doc, width: "agent B() {}\n")
    assert main(["fmt", "a.hier"]) == 70
    assert "formatting `a.hier` would change its meaning" in capsys.readouterr().err
    assert (folder / "a.hier").read_text() == UNTIDY


def test_formatting_needs_no_numerics(folder: Path) -> None:
    write(folder, a=UNTIDY)
    code = (
        "import sys; from hierc.cli import main; main(['fmt', 'a.hier'])\n"
        "sys.exit(any(m in sys.modules for m in ('sympy', 'numpy', 'scipy', 'llvmlite', 'rich')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode == 0
