"""Names in Python: parameters and groups of arrays, of some of their agents and of one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hierc
from hierc.runtime.model import Model
from hierc.runtime.result import Result

TEXT = """
agent Link(real T [ms] = 100 [ms], real[2] w = [1, 2]) {
  read real u;
  write real y = 0;
  diff { y' = w[1]*(u - y)/T; }
}
agent Arm(int n, real wish, real[n] far = zeros(n)) {
  agent link[j in 1..n] = Link(T = 100 [ms]/j) [u := if j == 1 then wish + sum(far) else link[j - 1].y];
  write real tip;
  alge { tip = link[n].y; }
}
agent Cell() {
  agent arm[i in 1..3] = Arm(n = i + 1, wish = 0.5*i);
  agent own = Link() [u := arm[2].tip];
}
"""


@pytest.fixture(scope="module")
def model() -> Model:
    return hierc.load(TEXT)


@pytest.fixture(scope="module")
def result(model: Model) -> Result:
    return model.simulate(stop=0.1, group="level")


def test_arrays_that_differ_in_size_are_listed_one_by_one(model: Model) -> None:
    assert list(model.parameters) == [
        "own.T", "own.w", "arm.n", "arm.wish", "arm[1].far", "arm[2].far", "arm[3].far",
        "arm[1].link.T", "arm[2].link.T", "arm[3].link.T", "arm[1].link.w", "arm[2].link.w", "arm[3].link.w",
    ]  # fmt: skip
    assert repr(model) == "<Model Cell: 10 states in groups arm[1..3].link[1..4], own; 13 parameters>"


@pytest.mark.parametrize(
    ("path", "value", "shown"),
    [
        ("arm.wish", [0.5, 1, 1.5], "arm[1..3].wish"),
        ("arm[2..3].wish", [1, 1.5], "arm[2..3].wish"),
        ("arm[3].wish", 1.5, "arm[3].wish"),
        ("arm[2].link.T", [100, 50, 100 / 3], "arm[2].link[1..3].T"),
        ("arm.link[2].T", [50, 50, 50], "arm[1..3].link[2].T"),
        ("arm.link[1..2].T", [[100, 50]] * 3, "arm[1..3].link[1..2].T"),
        ("arm[1].link[1].w", [1, 2], "arm[1].link[1].w"),
        ("arm[3].far", [0, 0, 0, 0], "arm[3].far"),
    ],
)
def test_parameters_of_some(model: Model, path: str, value: object, shown: str) -> None:
    found = model.parameters[path]
    np.testing.assert_allclose(found.value, value, rtol=1e-15)
    assert found.shown == shown


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("arm.wihs", "no parameter `arm.wihs`; did you mean `arm[1..3].wish`?"),
        ("arm[4].wish", "no `arm[4].wish`: `arm` goes from 1 to 3"),
        ("arm.link.T", "`arm.link.T` has no shape: its arrays differ in size; give more indices"),
        ("arm.far", "`arm.far` has no shape: its elements differ in it; give more indices"),
        ("own.w[2]", "no parameter `own.w[2]`: `own.w` is found as a whole"),
    ],
)
def test_no_parameters(model: Model, path: str, said: str) -> None:
    with pytest.raises(KeyError) as caught:
        model.parameters[path]
    assert caught.value.args[0] == said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm.link", "`arm.link` is 9 groups: name one, such as `arm[1].link[1]`, or look at `families`"),
        (
            "arm[2].link",
            "`arm[2].link` is 3 groups: name one, such as `arm[2].link[1]`, or look at `families`",
        ),
        ("arm[2].link[9]", "no `arm[2].link[9]`: `arm.link` goes from 1 to 3"),
        ("arm.lynk", "unknown group `arm.lynk`; did you mean `arm[1..3].link[1..4]`?"),
        ("body", "unknown group `body`; the groups are `arm[1..3].link[1..4]`, `own`"),
    ],
)
def test_no_groups(result: Result, name: str, said: str) -> None:
    assert result.stats["arm[2].link[3]"].steps == len(result.steps("arm[2].link[3]")[0])
    for ask in (result.stats.__getitem__, result.steps):
        with pytest.raises(KeyError) as caught:
            ask(name)
        assert caught.value.args[0] == said


def test_parameters_are_listed_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from hierc.cli import main

    file = tmp_path / "cell.hier"
    file.write_text(TEXT, encoding="utf-8")
    assert main(["params", str(file), "--json"]) == 0
    found = {p["name"]: p for p in json.loads(capsys.readouterr().out)["parameters"]}
    assert found["arm[2].link.T"]["value"] == [100, 50, pytest.approx(100 / 3)]
    assert found["arm[2].link.T"]["agents"] == "arm[2].link[1..3].T"
    assert found["arm.n"] | {"doc": ""} == {
        "name": "arm.n", "value": [2, 3, 4], "unit": None, "type": "int", "structural": True, "doc": "", "agents": "arm[1..3].n",
    }  # fmt: skip
