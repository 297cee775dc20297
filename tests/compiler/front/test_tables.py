"""Tables of data: what their files may say, what is said of those that are wrong, and what becomes of the numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from hierc.compiler.callees.callee import Table
from hierc.compiler.front import analyse
from hierc.compiler.imports.modules import Missing
from hierc.compiler.model import Model
from hierc.compiler.symbolic.derive import derive
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

ONE = """
table thrust(real n [rpm]) [kN] = "thrust.csv", cubic;
agent Boat() {
  write real v [m/s] = 0, n [rpm] = 0;
  diff { v' = thrust(n)/(1 [kg]); n' = 1 [rpm/s]; }
}
"""
TWO = ONE.replace("real n [rpm]) [kN]", "real n [rpm], real v) [kN]").replace("thrust(n)", "thrust(n, 2)")


@dataclass(frozen=True)
class Files:
    """A reader of files that are just text."""

    texts: Mapping[str, str]
    elsewhere: Mapping[str, str] = field(default_factory=dict)

    def find(self, importer: str, module: str) -> Missing:
        return Missing(module)

    def data(self, importer: str, file: str) -> SourceFile | Missing:
        assert importer == "boat.hier"
        return SourceFile(file, self.texts[file]) if file in self.texts else Missing(file)


def model(text: str, data: str) -> Model:
    return analyse(parse(SourceFile("boat.hier", text)), reader=Files({"thrust.csv": data}))


def table(text: str, data: str) -> Table:
    (called,) = {c.callee.name: c.callee for c in derive(model(text, data)).called}.values()
    assert isinstance(called, Table)
    return called


def message(text: str, data: str) -> list[str]:
    """The title of the one problem, and its notes."""
    with pytest.raises(ModelError) as caught:
        model(text, data)
    (problem,) = caught.value.problems
    assert problem.code == "E906"
    assert problem.span is not None
    assert problem.span.text == '"thrust.csv"'
    return [problem.title().removeprefix("table `thrust.csv`"), *problem.notes()]


def test_numbers_are_converted_once() -> None:
    found = table(ONE, "0, 0.1\n30,0.7\n7, 0.3\n")
    assert found.axes[0].knots == (0.0, math.radians(42.0), math.radians(180.0))
    assert found.values == (100.0, 300.0, 700.0)


@pytest.mark.parametrize(
    "data",
    [
        "speed,thrust\n1,2\n3,4",
        '"speed, rpm","thrust, N"\n1,2\n3,4\n',
        "# a comment\n\n1,2 # another\n   \n3,4",
        "1,2\r\n3,4\r\n",
        " +1.0 , 2e0\n3.,.4E1\n",
        "3,4\n1,2",
    ],
)
def test_forms_of_files(data: str) -> None:
    found = table(ONE.replace("[rpm]", "[rad/s]").replace("[kN]", "[N]"), data)
    assert (found.axes[0].knots, found.values) == ((1.0, 3.0), (2.0, 4.0))


def test_rows_may_stand_in_any_order() -> None:
    rng = np.random.default_rng(1)
    points = [(a, b) for a in (0, 1, 5) for b in (-2, 0, 1, 9)]
    lines = [f"{a},{b},{10 * a + b}" for a, b in points]
    expected = table(TWO, "\n".join(lines))
    assert expected.values == tuple(1000.0 * (10 * a + b) for a, b in points)
    for _ in range(5):
        rng.shuffle(lines)
        assert table(TWO, "\n".join(lines)) == expected


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("", [": it has no numbers"]),
        ("n, thrust\n", [": it has no numbers"]),
        ("1,2\nabc,3\n", [" line 2: `abc` is not a number"]),
        ("n,thrust\n1,2\nn,thrust\n3,4", [" line 3: `n` is not a number"]),
        ("1,2\n3,nan\n4,-inf\n5,1e999", [
            " line 2: `nan` is not a finite number", "line 3: `-inf` is not a finite number", "line 4: `1e999` is not a finite number",
        ]),
        ("1,2\n1_0,3\n0x1,4", [" line 2: `1_0` is not a number", "line 3: `0x1` is not a number"]),
        ("1,2\n3,4,5\n6\n", [" line 2: 3 columns, but the table has 2", "line 3: 1 column, but the table has 2"]),
        ("1,2\n3,\n", [" line 2: a column is empty"]),
        ("1,2\n", [": there is one point along `n`; a table has 2 at least"]),
        ("1,2\n3,4\n1.0,2\n", [" line 3: the same point as on line 1"]),
        ("1,2\n3,1e308\n", [" line 2: `1e308` is too large"]),
        (f"1,2\n{'secret' * 9},3\n", [" line 2: `secretsecretsecr…` is not a number"]),
        ("1,2\n\x1b[31mred,3\n", [" line 2: `?[31mred` is not a number"]),
        ("1;2\n3;4\n", [" line 1: `1;2` is not a number", "line 2: `3;4` is not a number"]),
        ("n thrust\n3 4\n5 6", [" line 2: `3 4` is not a number", "line 3: `5 6` is not a number"]),
        ("nan,inf\n1,2\n3,4", [" line 1: `nan` is not a finite number"]),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_by_line(data: str, expected: list[str]) -> None:
    assert message(ONE, data) == expected


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("1,1,1\n1,2,2\n3,1,3\n", ": there is no value for n = 3, v = 2"),
        ("1,1,1\n1,2,2\n3,1,3\n3,3,9", ": there is no value for n = 1, v = 3"),
        ("1,1,1\n1,2,2\n", ": there is one point along `n`; a table has 2 at least"),
        ("1,1,1\n1,2,2\n3,1,3\n3,2.0,4\n3,2,5", " line 5: the same point as on line 4"),
    ],
)
def test_a_grid_is_complete(data: str, expected: str) -> None:
    assert message(TWO, data) == [expected]


def test_many_wrong_lines_are_counted() -> None:
    lines = message(ONE, "1,2\n" + "x,1\n" * 20)
    assert len(lines) == 10
    assert lines[-1] == "and 11 lines more"


def test_a_hundred_thousand_lines() -> None:
    found = table(TWO, "\n".join(f"{a},{b},{a - b}" for a in range(500) for b in range(200)))
    assert len(found.values) == 100_000
    assert found.values[200 * 7 + 5] == 2000.0


def test_the_data_belongs_to_the_sources() -> None:
    """Another file makes another module."""
    first, second = model(ONE, "1,2\n3,4"), model(ONE, "1,2\n3,5")
    assert [source.name for source in first.sources] == ["boat.hier", "thrust.csv"]
    assert first.sources != second.sources


def test_only_hold_jumps() -> None:
    def titles(method: str) -> list[str]:
        return [w.code for w in model(ONE.replace("cubic", method), "1,2\n3,4").warnings]

    assert (titles("hold"), titles("linear"), titles("cubic")) == (["W013"], [], [])
