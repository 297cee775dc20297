"""The formatter: golden cases, the widths it keeps, and what it refuses.

A case is `format/NAME.hier` beside `format/NAME.expected`; `pytest tests/grammar --accept` rewrites the latter.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hierc.grammar import formatting, tree
from hierc.grammar.formatting import UnsafeFormat, format_source, same_tree
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.reading import read_source
from hierc.grammar.source import SourceFile

CASES = sorted((Path(__file__).parent / "format").glob("*.hier"))
EXAMPLES = sorted((Path(__file__).parent / "examples").glob("*.hier"))


def formatted(text: str, width: int = 100) -> str:
    return format_source(SourceFile("m.hier", text), width)


def items(text: str) -> tuple[tree.Item, ...]:
    return parse(SourceFile("m.hier", text)).items


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_case(case: Path, request: pytest.FixtureRequest) -> None:
    text = format_source(read_source(case))
    golden = case.with_suffix(".expected")
    if request.config.getoption("--accept"):
        golden.write_text(text)
    assert text == golden.read_text()
    assert formatted(text) == text


@pytest.mark.parametrize("case", [*CASES, *EXAMPLES], ids=lambda case: case.stem)
@pytest.mark.parametrize("width", [60, 80, 100])
def test_only_what_cannot_be_broken_is_wider(case: Path, width: int) -> None:
    for line in format_source(read_source(case), width).splitlines():
        code = re.sub(r"\s*(//.*|/\*.*\*/)$", "", line).strip()
        first = re.sub(r"^[^()]* :?= (?=\S+$)", "", code)  # a value begins on the line of its name
        assert len(code) + len(line) - len(line.lstrip()) <= width or '"' in code or " " not in first


def test_models_of_the_house_are_formatted() -> None:
    root = Path(__file__).parents[2]
    models = [*root.glob("models/*.hier"), *root.glob("benchmarks/models/*.hier")]
    assert models
    assert [m.name for m in models if format_source(read_source(m)) != m.read_text(encoding="utf-8")] == []


def test_nothing_and_comments_alone() -> None:
    assert formatted("") == ""
    assert formatted(" \n\n ") == ""
    assert formatted("\n\n// a\n\n\n// b") == "// a\n\n// b\n"


def test_line_breaks_stay_of_their_kind() -> None:
    assert (
        formatted("// a\r\nagent A() {\r\n/* b\r\n c */ }")
        == "// a\r\nagent A() {\r\n  /* b\r\n c */\r\n}\r\n"
    )
    assert formatted("// a\nagent A() {\r\n}") == "// a\nagent A() {}\n"


def test_docs_stay_docs_and_others_do_not_become_docs() -> None:
    text = "agent A() { read real x; /// of nothing\nread real y\n/// of nothing\n; read real z;\n/// of u\nread real u; }"
    (agent,) = items(formatted(text))
    assert isinstance(agent, tree.Agent)
    assert [item.doc for item in agent.items if isinstance(item, tree.Decl)] == ["", "", "", "of u"]


def test_a_long_sum_is_no_deep_sum() -> None:
    terms = " + ".join(["x"] * 5000)
    text = formatted(f"const real s = {terms};")
    assert text.split() == f"const real s = {terms};".split()
    assert max(map(len, text.splitlines())) <= 100
    assert text.count("\n") < 5000 * 4 / 90
    product = formatted(f"const real p = {terms.replace(' + ', '*')};")
    assert max(map(len, product.splitlines())) <= 100


@pytest.mark.parametrize(
    ("opening", "inner", "closing"),
    [
        ("(", "x", ")"), ("[", "x", "]"), ("f(", "x", ")"), ("a[", "1", "]"), ("-", "x", ""), ("not ", "x", ""), ("x^", "x", ""),
        ("if a then b else ", "c", ""), ("if a then ", "b", " else c"), ("(if ", "a", " then b else c)"), ("y*(x + ", "z", ")"),
        ("a or b and c == d + e*f(", "x", ")"), ("[y + x*", "z", "]"), ("a or b and c == d + e*f^g(", "x", ")"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("width", [10, 100, 10_000])
def test_the_deepest_nesting_that_parses(opening: str, inner: str, closing: str, width: int) -> None:
    deepest = 0
    for depth in (60, 64, 120, 126, 127, 128):
        text = f"const real s = {opening * depth}{inner}{closing * depth};"
        try:
            items(text)
        except ModelError:
            break
        assert formatted(text, width).split()[:2] == ["const", "real"]
        deepest = depth
    assert deepest >= 60


def test_the_deepest_blocks_that_parse() -> None:
    text = "agent A() { " + "level l { " * 126 + "}" * 127
    assert formatted(text).count("level l {") == 126
    modes = "agent A() { " + "mode m { " * 125 + "diff { x' = 1; }" + "}" * 126
    assert "\n" + "  " * 127 + "x' = 1;\n" in formatted(modes)


def test_a_width_of_one_is_met_as_far_as_words_allow() -> None:
    assert formatted("const real x = a + b;", 1) == "const real x = a\n  + b;\n"


def test_errors_are_problems() -> None:
    with pytest.raises(ModelError):
        formatted("agent A( {")


# ---- what guards the result ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoiled", "message"),
    [
        ("// a\nconst real x = 2;\n", "change its meaning"),
        ("const real x = 1;\n", "lose a comment"),
        ("// b\nconst real x = 1;\n", "lose a comment"),
        ("// a\n// a\nconst real x = 1;\n", "lose a comment"),
    ],
)
def test_damage_is_refused(monkeypatch: pytest.MonkeyPatch, spoiled: str, message: str) -> None:
    monkeypatch.setattr(formatting, "layout", lambda doc, width: spoiled)
    with pytest.raises(UnsafeFormat, match=rf"`m.hier` would {message}"):
        formatted("// a\nconst real x = 1;")


def test_unstable_text_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    versions = iter(["const real x = 1;\n", "const real  x = 1;\n"])
    monkeypatch.setattr(formatting, "layout", lambda doc, width: next(versions))
    with pytest.raises(UnsafeFormat, match="twice would change it twice"):
        formatted("const real x=1;")


def test_trees_are_told_apart() -> None:
    base = "/// d\nagent A(real k = 1) { write analog real x [m] = 0; diff { x' = (k + 2)*x; } }"
    same = base.replace(" analog", "").replace("(k + 2)", "((k+2))")
    assert same_tree(items(base), items(same))
    for old, new in [
        ("/// d", "/// e"), ("k = 1", "k = 1.0"), ("[m]", "[s]"), ("analog", "discrete"), ("(k + 2)", "k + 2"),
        ("x' =", "y' ="), ("write", "read"), (" = 0", ""), ("real k = 1", ""), ("diff { x'", "alge { x"),
    ]:  # fmt: skip
        assert base.replace(old, new) != base
        assert not same_tree(items(base), items(base.replace(old, new)))
