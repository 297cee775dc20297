"""Files and plots of results: whole or not there, the same bits when read, harmless whatever the names."""

from __future__ import annotations

import csv
import io
import stat
from pathlib import Path

import numpy as np
import pytest

from hierc.runtime.files import cache_folder, write_whole
from hierc.runtime.writers import print_csv, write_csv, write_npz

T = np.array([0.0, 0.1, 0.2])
HOSTILE = ["=1+1", "+1", "-1", "@SUM(A1)", 'a"b,c', "esc\x1b[31m", "bidi\u202ex", "</script>", "M[1,2]"]


def test_csv_gives_the_same_bits_back(tmp_path: Path) -> None:
    values = np.array([1 / 3, -1e-300, np.nan])
    write_csv(tmp_path / "r.csv", T, {"a.x": values, "M[1,2]": -values})
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time", "a.x", "M[1,2]"]
    back = np.array(rows[1:], dtype=float)
    assert np.array_equal(back, np.column_stack([T, values, -values]), equal_nan=True)


def test_csv_names_are_neither_formulas_nor_control_sequences() -> None:
    text = io.StringIO()
    print_csv(text, T, dict.fromkeys(HOSTILE, T))
    header = next(csv.reader(io.StringIO(text.getvalue())))
    assert len(header) == 1 + len(HOSTILE)
    assert not [cell for cell in header if cell[0] in "=+-@" or not cell.isprintable()]
    assert header[5] == 'a"b,c'
    assert header[6] == r"esc\x1b[31m"


def test_npz_holds_every_name_and_no_pickle(tmp_path: Path) -> None:
    arrays = {"file": T, "plan.p": np.ones((3, 2)), "allow_pickle": 2 * T}
    write_npz(tmp_path / "r.npz", T, arrays)
    with np.load(tmp_path / "r.npz", allow_pickle=False) as back:
        assert set(back.files) == {"time", *arrays}
        assert np.array_equal(back["allow_pickle"], 2 * T)
        assert back["plan.p"].shape == (3, 2)
    with pytest.raises(ValueError, match="allow_pickle=False"):
        write_npz(tmp_path / "bad.npz", T, {"x": np.array([object()])})
    assert [p.name for p in tmp_path.iterdir()] == ["r.npz"]


def test_npz_bytes_depend_on_values_alone(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_npz(tmp_path / name, T, {"x": T})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "r.csv"
    target.write_text("old")
    target.chmod(0o640)

    def fail(file: io.BufferedIOBase) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_whole(target, fail)  # type: ignore[arg-type]
    assert target.read_text() == "old"
    write_whole(target, b"new")
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]


def test_a_link_keeps_pointing_where_it_points(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    link = tmp_path / "r.csv"
    link.symlink_to(tmp_path / "real" / "r.csv")
    write_whole(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "real" / "r.csv").read_bytes() == b"new"


def test_a_device_is_written_and_stays_a_device() -> None:
    write_whole(Path("/dev/null"), b"gone")
    assert Path("/dev/null").is_char_device()


def test_a_cache_others_may_write_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "own"))
    folder = cache_folder("models")
    assert folder == tmp_path / "own" / "models"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)
    assert cache_folder("models") is None
    monkeypatch.setenv("HIERC_CACHE", "")
    assert cache_folder("models") is None


def test_a_cache_without_a_home_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HIERC_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache_folder("models") is None
