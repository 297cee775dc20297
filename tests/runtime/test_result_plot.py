"""Plots: one panel a group, units in the labels, names shown as they are."""

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
    units: ClassVar = {"_a.p": "m", "b.$x": None, "b.nan": None, "many": None}

    def __init__(self, panels: dict[str, list[str]]) -> None:
        self._panels = panels

    def panels(self) -> dict[str, list[str]]:
        return self._panels

    def columns(self, names: list[str]) -> dict[str, np.ndarray]:
        sizes = {"_a.p": 2, "many": 40}
        return {
            (f"{name}[{i + 1}]" if name in sizes else name): T * np.nan if name == "b.nan" else T + i
            for name in names
            for i in range(sizes.get(name, 1))
        }


def labels(figure: SimpleNamespace) -> list[list[str]]:
    return [[t.get_text() for t in axis.get_legend().get_texts()] for axis in figure.axes]


def test_a_panel_a_group_with_units(tmp_path: Path) -> None:
    figure = draw(Values({"slow": ["_a.p"], "f$st": ["b.$x", "b.nan"]}), tmp_path / "r.png", None)
    assert [axis.get_title("left") for axis in figure.axes] == ["slow", r"f\$st"]
    assert labels(figure) == [[" _a.p[1] [m]", " _a.p[2] [m]"], [r" b.\$x", " b.nan"]]
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_chosen_names_share_one_panel() -> None:
    figure = draw(Values({}), None, ["b.$x", "_a.p"])
    assert labels(figure) == [[r" b.\$x", " _a.p[1] [m]", " _a.p[2] [m]"]]


def test_a_panel_says_what_it_leaves_out() -> None:
    figure = draw(Values({"g": ["many"]}), None, None)
    assert figure.axes[0].get_title("left") == "g (and 28 more)"


def test_nothing_finite_is_said(tmp_path: Path) -> None:
    figure = draw(Values({"g": ["b.nan"]}), tmp_path / "r.svg", None)
    assert [text.get_text() for text in figure.axes[0].texts] == ["no finite values"]


def test_unknown_kinds_of_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"plots are \.png, \.pdf, \.svg files"):
        draw(Values({"g": ["b.$x"]}), tmp_path / "r.txt", None)
