"""Whatever the text: a tree or a ModelError whose problems can be shown, never anything else, and always an end."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hierc.grammar import recovery
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.render import render_all, to_json
from hierc.grammar.source import SourceFile

EXAMPLES = [
    path.read_text(encoding="utf-8") for path in sorted((Path(__file__).parent / "examples").glob("*.hier"))
]
PIECES = sorted(
    {
        *"(){}[];:,.=<>+-*/^'\"@#\n\\",
        ":=",
        "==",
        "..",
        ".*",
        "./",
        "//",
        "/*",
        "*/",
        "x",
        "1",
        "1.5",
        "[m/s]",
        '"s"',
    }
    | {
        "agent",
        "level",
        "group",
        "each",
        "write",
        "real",
        "diff",
        "alge",
        "init",
        "mode",
        "trans",
        "from",
        "to",
        "when",
        "do",
    }
    | {
        "let",
        "if",
        "then",
        "else",
        "for",
        "in",
        "experiment",
        "of",
        "record",
        "save",
        "sample",
        "every",
        "const",
        "func",
        "inv",
    }
    | {
        "agent A() {",
        "diff {",
        "x' = 1;",
        "experiment e of A() {",
        "write real x = 0;",
        "if a then b else",
        "d(x) ==",
        "der(",
    }
)


def survives(text: str) -> bool:
    """Whether the text parses; if not, its problems lie in the text and can be shown."""
    source = SourceFile("fuzz.hier", text)
    try:
        parse(source)
    except ModelError as error:
        problems = error.problems
    else:
        return True
    assert problems
    for problem in problems:
        assert problem.span is not None
        assert 0 <= problem.span.start <= problem.span.stop <= len(text)
        to_json(problem)
    assert render_all(problems)
    return False


@given(st.text())
@example("\0" * 100)
@example("\ufeffagent A() {}")
@example("\r")
@example("/*/")
@example('"')
@example("agent A() { let x = 1")
def test_any_text(text: str) -> None:
    survives(text)


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    survives(data.decode("latin-1"))


@settings(max_examples=300)
@given(
    st.lists(st.sampled_from(PIECES), max_size=40),
    st.sampled_from(["", "agent A() { ", "agent A() { let x = ("]),
)
def test_any_words(pieces: list[str], start: str) -> None:
    survives(start + " ".join(pieces))


@settings(max_examples=200)
@given(st.sampled_from(EXAMPLES), st.randoms(use_true_random=False))
def test_mutated_models(text: str, choice: random.Random) -> None:
    for _ in range(choice.randint(1, 4)):
        start = choice.randrange(len(text) + 1)
        stop = min(len(text), start + choice.choice([0, 1, 1, 2, 5, 30]))
        text = text[:start] + choice.choice(["", "", *PIECES]) + text[stop:]
    survives(text)


@settings(max_examples=50)
@given(st.sampled_from(EXAMPLES), st.data())
def test_a_model_cut_off_anywhere(text: str, data: st.DataObject) -> None:
    survives(text[: data.draw(st.integers(0, len(text)))])


@pytest.mark.parametrize(
    "text", ["agent A() { " * 2000, "{" * 20_000, "}" * 20_000, "((" * 20_000, "x " * 20_000, '"\n' * 20_000]
)
def test_large_noise(text: str) -> None:
    assert not survives(text)


def test_recovery_reads_each_part_of_the_text_a_bounded_number_of_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recoveries = 0
    recover = recovery.RecoveringParser._recover

    def counted(self: recovery.RecoveringParser, *args: object) -> None:
        nonlocal recoveries
        recoveries += 1
        recover(self, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(recovery.RecoveringParser, "_recover", counted)
    words = random.Random(1)
    for _ in range(50):
        text = " ".join(words.choices(PIECES, k=200))
        recoveries = 0
        survives(text)
        assert recoveries <= len(text)


def test_problems_do_not_need_the_parser() -> None:
    modules = "hierc.grammar.render, hierc.grammar.tree, hierc.grammar.reading, hierc.grammar.errors"
    code = f"import sys, {modules}; sys.exit('lark' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_parsing_imports_nothing_that_runs_code() -> None:
    code = (
        "import sys; from hierc.grammar.parser import parse; from hierc.grammar.source import SourceFile\n"
        "parse(SourceFile('m', 'agent A() { }')); sys.exit(any(m in sys.modules for m in ('sympy', 'numpy', 'numba')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
