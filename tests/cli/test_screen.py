"""What stands on the screen: durations, tables, progress."""

from __future__ import annotations

import io
import math

import pytest

from hierc import screen


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (12.3456, "12.3 s"),
        (1234.5, "1.23e+03 s"),
        (0.99996, "1 s"),
        (0.25, "250 ms"),
        (1.25e-3, "1.25 ms"),
        (4e-6, "4 µs"),
        (1.61e-7, "161 ns"),
        (3e-13, "3e-13 s"),
        (0.0, "0 s"),
        (math.nan, "-"),
    ],
)
def test_durations(seconds: float, shown: str) -> None:
    assert screen.duration(seconds) == shown


def test_columns_are_aligned() -> None:
    rows = [("group", "steps"), ("a", "7"), ("longer", "12345")]
    assert list(screen.aligned(rows, left=1)) == ["group   steps", "a           7", "longer  12345"]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_appears_on_a_terminal_only_when_it_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    with screen.Progress("[red]model[/red]", 0.0, 10.0, shown=True) as progress:
        progress(1.0)
    assert terminal.getvalue() == ""
    monkeypatch.setattr(screen, "_PATIENCE", -1.0)
    with screen.Progress("[red]model[/red]", 0.0, 10.0, shown=True) as progress:
        progress(2.5)
        progress(5.0)
    assert "[red]model[/red]" in terminal.getvalue()  # a name is text, not markup
    assert "5 of 10 s" in terminal.getvalue()


@pytest.mark.parametrize(("stream", "shown"), [(io.StringIO(), True), (Terminal(), False)])
def test_no_progress_in_files_or_when_quiet(
    monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, shown: bool
) -> None:
    monkeypatch.setattr(screen, "_PATIENCE", -1.0)
    monkeypatch.setattr("sys.stderr", stream)
    with screen.Progress("model", 0.0, 1.0, shown=shown) as progress:
        progress(0.5)
    assert stream.getvalue() == ""
