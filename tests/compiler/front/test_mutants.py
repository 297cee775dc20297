"""Mutated models give a module or problems, and nothing else, all the way from the text to the generated Python."""

from __future__ import annotations

import ast
import json
from collections import Counter

import pytest
from mutation import mutants, sources

from hierc.compiler.driver import compile_source
from hierc.grammar.problems import ModelError, Problem, apply
from hierc.grammar.render import render, to_json
from hierc.grammar.source import SourceFile

#: Problems of a whole file, which has no place: nothing says which agent runs.
PLACELESS = {"E909"}
PARTS, COUNT = 6, 80


def compiled(text: str) -> tuple[str | None, tuple[Problem, ...]]:
    """The generated module, or None, and the problems."""
    try:
        result = compile_source(SourceFile("mutant.hier", text))
    except ModelError as error:
        return None, error.problems
    return result.text, result.warnings


def assert_is_sound(problem: Problem, text: str) -> None:
    """The problem lies in the text, can be shown in every form, and its edits can be made."""
    assert (problem.span is None) == (problem.code in PLACELESS), problem
    spans = [problem.span, *(label.span for label in problem.labels()), *(e.span for e in problem.edits())]
    for span in spans:
        if span is not None:
            assert span.file.text == text
            assert 0 <= span.start <= span.stop <= len(text)
    for color in (False, True):
        assert problem.code in render(problem, color=color)
    assert json.loads(json.dumps(to_json(problem)))["code"] == problem.code
    apply(problem.edits(), text)


@pytest.mark.parametrize("part", range(PARTS))
def test_mutants(part: int) -> None:
    seen: Counter[str] = Counter()
    for text in mutants(COUNT, seed=part):
        module, problems = compiled(text)
        if module is not None:
            ast.parse(module)
        else:
            assert any(problem.severity == "error" for problem in problems)
        seen["module" if module is not None else "refused"] += 1
        for problem in problems:
            assert_is_sound(problem, text)
            seen[problem.code] += 1
    assert seen["module"] >= 1
    assert seen["refused"] > COUNT / 2
    assert len(seen) > 20


def test_there_is_much_to_mutate() -> None:
    texts = sources()
    assert len(texts) > 150
    assert len(set(texts)) == len(texts)
