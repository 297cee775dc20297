"""Plots: panels by group and unit, names shown as they are."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from hierc.runtime.plotting import draw

pytest.importorskip("matplotlib")

T = np.linspace(0.0, 1.0, 5)


class Values:
    """The part of a result that plots look at."""

    model = "Two"
    t = T
    units: ClassVar = {"_a.p": "m", "a.w": "rad$", "b.$x": None, "b.nan": None, "many": None}

    def __init__(self, panels: dict[str, list[str]]) -> None:
        self._panels = panels

    def panels(self) -> dict[str, list[str]]:
        return self._panels

    def unit(self, name: str) -> str | None:
        return self.units[name.partition("[")[0]]

    def columns(self, names: list[str]) -> dict[str, np.ndarray]:
        sizes = {"_a.p": 2, "many": 40}
        return {
            (f"{name}[{i + 1}]" if name in sizes else name): T * np.nan if name == "b.nan" else T + i
            for name in names
            for i in range(sizes.get(name, 1))
        }


def labels(figure: SimpleNamespace) -> list[list[str]]:
    return [[t.get_text() for t in axis.get_legend().get_texts()] for axis in figure.axes]


def test_panels_by_group_and_unit(tmp_path: Path) -> None:
    groups = {"slow": ["_a.p", "a.w", "_a.p[2]"], "f$st": ["b.$x", "b.nan"]}
    figure = draw(Values(groups), tmp_path / "r.png", None)
    assert [axis.get_title("left") for axis in figure.axes] == ["slow", "", r"f\$st"]
    assert [axis.get_ylabel() for axis in figure.axes] == ["[m]", r"[rad\$]", ""]
    assert labels(figure) == [[" _a.p[1]", " _a.p[2]", " _a.p[2]"], [" a.w"], [r" b.\$x", " b.nan"]]
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_chosen_names_are_split_by_unit() -> None:
    figure = draw(Values({}), None, ["b.$x", "_a.p", "b.nan"])
    assert labels(figure) == [[r" b.\$x", " b.nan"], [" _a.p[1]", " _a.p[2]"]]
    assert figure.axes[0].get_shared_x_axes().joined(*figure.axes)


def test_a_panel_says_what_it_leaves_out() -> None:
    figure = draw(Values({"g": ["many"]}), None, None)
    assert labels(figure)[0][-2:] == [" many[12]", "and 28 more"]


def test_no_two_lines_look_alike() -> None:
    (axis,) = draw(Values({"g": ["many"]}), None, None).axes
    drawn = [line for line in axis.lines if len(line.get_xdata())]
    assert len({(line.get_color(), line.get_linestyle()) for line in drawn}) == len(drawn) == 12


def test_any_number_of_panels_makes_a_picture(tmp_path: Path) -> None:
    draw(Values({}), tmp_path / "r.png", [])
    assert (tmp_path / "r.png").stat().st_size > 0
    figure = draw(Values({f"g{i}": ["a.w"] for i in range(120)}), None, None)
    assert len(figure.axes) == 120
    assert figure.get_figheight() * 130 < 2**16  # pixels that a picture may have


def test_without_matplotlib_the_way_out_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hierc.runtime.plotting.find_spec", lambda _: None)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        draw(Values({"g": ["b.$x"]}), None, None)


def test_nothing_finite_is_said(tmp_path: Path) -> None:
    figure = draw(Values({"g": ["b.nan"]}), tmp_path / "r.svg", None)
    assert [text.get_text() for text in figure.axes[0].texts] == ["no finite values"]


def test_unknown_kinds_of_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"plots are \.png, \.pdf, \.svg files"):
        draw(Values({"g": ["b.$x"]}), tmp_path / "r.txt", None)
