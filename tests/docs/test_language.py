"""The language reference is true: its models compile and evaluate, its messages are those that hierc prints, its lists are complete."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from documents import DOCS, Block, accept, blocks, where

import hierc
from hierc.compiler.diagram import diagram
from hierc.compiler.driver import compile_source, model_of
from hierc.compiler.model import Settings
from hierc.compiler.shapes.functions import BUILT_IN_FUNCTIONS
from hierc.compiler.structure.elaboration import MAX_ELEMENTS, MAX_PATTERNS
from hierc.explain import message_of, problems_of
from hierc.graph import to_text
from hierc.loader import placed, run_module
from hierc.runtime.methods.catalogue import METHODS

DOCUMENT = DOCS / "language.md"
TEXT = DOCUMENT.read_text(encoding="utf-8")


BLOCKS = blocks(DOCUMENT)
MODELS = [block for block in BLOCKS if block.kind == "hier"]
FAILING = [i for i, block in enumerate(BLOCKS) if block.kind == "hier-error"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the data and the Python modules of the document, each under the name that its first line gives it."""
    made = tmp_path_factory.mktemp("language")
    for block in BLOCKS:
        if block.kind in ("csv", "python") and block.file_name:
            (made / block.file_name).write_text(block.text, encoding="utf-8")
    return made


@pytest.mark.parametrize("block", MODELS, ids=where)
def test_models_compile_without_warnings_and_evaluate(
    block: Block, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(folder))
    assert [problem.title() for problem in problems_of(block.source, folder)] == []
    reader = placed(block.source, folder / "model.hier").finder
    model = run_module(compile_source(block.source, reader=reader).text, "model.hier").MODEL
    rates = model.rhs(0.0, model.initial())
    assert rates.size
    assert np.isfinite(rates).all()


@pytest.mark.parametrize("place", FAILING, ids=lambda place: where(BLOCKS[place]))
def test_messages_are_what_hierc_prints(place: int, folder: Path, request: pytest.FixtureRequest) -> None:
    block, shown = BLOCKS[place], BLOCKS[place + 1]
    assert shown.kind == "text"
    message = message_of(block.source, folder) + "\n"
    if request.config.getoption("--accept"):
        accept(DOCUMENT, shown, message, after=block.text)
    else:
        assert shown.text == message


def test_the_graph_is_what_hierc_prints(request: pytest.FixtureRequest) -> None:
    (shown,) = (block for block in BLOCKS if block.text.startswith("$ hierc graph tree.hier\n"))
    model = next(block for block in MODELS if block.heading == shown.heading)
    drawn = to_text(diagram(model_of(replace(model.source, name="tree.hier"))))
    if request.config.getoption("--accept"):
        accept(DOCUMENT, shown, f"$ hierc graph tree.hier\n{drawn}")
    else:
        assert shown.text == f"$ hierc graph tree.hier\n{drawn}"


# ---- lists ---------------------------------------------------------------------------------------


def section(heading: str) -> str:
    return TEXT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def first_cells(text: str) -> str:
    """The first column of all tables."""
    return "\n".join(line.split("|")[1] for line in text.splitlines() if line.startswith("|"))


def test_every_function_is_listed() -> None:
    names = set(re.findall(r"`(\w+)\(", first_cells(section("Functions"))))
    assert names == set(BUILT_IN_FUNCTIONS)


def test_every_setting_and_method_is_listed() -> None:
    table = section("Experiments").partition("| statement |")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == {
        field.name for field in fields(Settings)
    }
    (methods,) = (line for line in table.splitlines() if line.startswith("| `method`"))
    assert set(re.findall(r"`(\w+)`", methods)) == {"method", "auto", *METHODS}


def test_the_reserved_words_are_those_of_the_grammar() -> None:
    grammar = (Path(__file__).parents[2] / "grammar" / "hier.lark").read_text(encoding="utf-8")
    listed = section("Text").partition("reserved everywhere:")[2].partition(".")[0]
    reserved = re.search(r"NAME    : /\(\?!\(\?:([a-z|]+)\)", grammar)
    assert reserved is not None
    assert re.findall(r"`(\w+)`", listed) == reserved[1].split("|")


def test_every_section_is_in_the_contents() -> None:
    headings = re.findall(r"^## (.*)$", TEXT, re.MULTILINE)
    assert re.findall(r"^- \[(.*)\]\(#", TEXT, re.MULTILINE) == headings
    anchors = {heading.lower().replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([\w-]+)\)", TEXT)) <= anchors


# ---- what is said in sentences -------------------------------------------------------------------


def value(expression: str) -> float:
    """An expression's value, computed by the generated code."""
    model = hierc.load(f"agent A() {{ write real x = 0; diff {{ x' = {expression} + 0*x; }} }}")
    return float(model.rhs(0.0, model.initial())[0])


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("-2^2", -4), ("2^-1", 0.5), ("2^3^2", 512), ("1/2", 0.5), ("div(7, 2)", 3), ("div(-7, 2)", -4), ("mod(-7, 2)", 1),
        ("mod(7, -2)", -1), ("mod(-0.5, 2)", 1.5), ("round(2.6)", 3), ("clamp(5, 0, 1)", 1), ("max([1, 7, 3])", 7),
        ("1 [min]", 60), ("90 [deg]", np.pi / 2), ("50 [%]", 0.5), ("if not 1 < 2 or 2 < 1 then 1 else 2", 2),
        ("6/3*2", 4), ("5 - 2 - 1", 2), ("sum([1, 2] .* [3, 4])", 11), ("det([[1, 2], [3, 4]])", -2), ("sum([[i*j for j in 1..2] for i in 1..3])", 18),
    ],
)  # fmt: skip
def test_expressions_mean_what_the_tables_say(expression: str, expected: float) -> None:
    assert value(expression) == pytest.approx(expected, rel=1e-15)


def test_structural_parameters_are_those_that_reach_a_size() -> None:
    (block,) = (b for b in MODELS if b.heading == "Parameters and constants")
    model = model_of(block.source)
    assert [p.path for p in model.parameters if p.structural] == ["a.N", "b.N"]


def test_results_are_named_by_path() -> None:
    (block,) = (b for b in MODELS if b.heading == "Experiments")
    model = run_module(compile_source(block.source).text, "model.hier").MODEL
    assert {variable.path for variable in model.plan.variables} >= {"a.y", "a.slope", "b.y", "b.slope"}
    assert model.initial()[model.states.index("a.y")] == 0.5
    assert set(model.plan.experiment.record) == {"a.y", "b.y", "b.slope"}


def test_the_sled_is_compiled_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The document says of which functions it is true that they become machine code; its own is one."""
    monkeypatch.syspath_prepend(str(folder))
    (block,) = (b for b in MODELS if b.heading == "External functions")
    model = run_module(compile_source(block.source).text, "model.hier").MODEL
    (extern,) = model.plan.externs
    assert not isinstance(extern.translation, str)
    assert model.rhs(0.0, [1.0])[0] == pytest.approx(-(4 * np.tanh(36.0) + 0.3 * 3.6**2) / 5, rel=1e-14)


def test_arrays_give_the_shapes_that_are_said() -> None:
    road, swarm, cell = (b.text for b in MODELS if b.heading == "Arrays of agents")
    r = hierc.load(road).simulate(stop=1.0, params={"car[2..3].T": [0.1, 0.2], "car.T": 0.5})
    assert [r[name].shape[1:] for name in ("car.x", "car[2..5].x", "car[3].x", "first")] == [
        (6,),
        (4,),
        (),
        (3,),
    ]
    assert r["car.v"][0].tolist() == [0, 0, 0, 1, 1, 0]
    assert "car[3].v" in r.columns()
    assert r["mean"] == pytest.approx(r["car.v"].mean(axis=1), rel=1e-12)
    assert r["closest"] == pytest.approx(r["car[2..6].gap"].min(axis=1), rel=1e-12)
    r = hierc.load(swarm).simulate(stop=1.0)
    assert r["robot.p"].shape[1:] == (7, 2)
    assert r["robot.p"][0, :4].tolist() == [[6, 1], [5, 0], [7, 0], [4, -1]]
    r = hierc.load(cell).simulate(stop=1.0)
    assert r["arm[2].link.y"].shape[1:] == (3,)
    with pytest.raises(KeyError, match="has no shape"):
        _ = r["arm.link.y"]


def test_sums_over_as_many_as_the_index_says() -> None:
    text = """agent A(real x0) { read real u; write real x = x0; diff { x' = u; } }
        agent B() { agent a[i in 1..4] = A(x0 = i) [u := sum(a[1..i-1].x)]; }"""
    model = hierc.load(text)
    rates = dict(zip(model.states, model.rhs(0.0, model.initial()), strict=True))
    assert [rates[f"a[{i}].x"] for i in range(1, 5)] == [0, 1, 3, 6]
    with pytest.raises(hierc.ModelError, match=r"E8|E3"):
        hierc.load(text.replace("sum(a[1..i-1].x)", "norm(a[1..i-1].x)"))


def test_the_limits_of_arrays_are_those_of_the_compiler() -> None:
    said = f"There may be {MAX_PATTERNS:,} kinds in an array, and {MAX_ELEMENTS:,} agents."
    assert said in section("Arrays of agents")
