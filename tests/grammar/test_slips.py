"""Common slips, of beginners and of those who come from C, Python, MATLAB, Modelica and CHARON: what is said of each mends it.

`slips.txt` has a line for each: where it stands, the slip, and the text after an editor has made the edits of the problems, one after the
other. What the help says in backquotes after "write" stands in the mended text too.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hierc.grammar import forms
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError, Problem, apply
from hierc.grammar.source import SourceFile

SURROUNDINGS = {
    "file": "{}\nagent B() {{ }}\n",
    "agent": "agent A(real k = 1) {{\n  read real u;\n  write real x [m] = 0;\n  diff {{ x' = u; }}\n  {}\n}}\n",
    "value": "agent A(real k = 1) {{\n  write real x [m] = 0, v = 0;\n  diff {{\n    v' = 1;\n    x' = {};\n  }}\n}}\n",
    "experiment": "agent A() {{ }}\nexperiment e of A() {{\n  stop = 1 [s];\n  {}\n}}\n",
}
SLIPS = (Path(__file__).parent / "slips.txt").read_text(encoding="utf-8").splitlines()


def problems_of(text: str) -> tuple[Problem, ...]:
    try:
        parse(SourceFile("slip.hier", text))
    except ModelError as error:
        return error.problems
    return ()


@pytest.mark.parametrize("line", SLIPS)
def test_a_slip_is_mended(line: str) -> None:
    where, _, rest = line.partition(": ")
    slip, _, meant = rest.partition(" →")
    text = SURROUNDINGS[where].format(slip)
    assert problems_of(text)
    for _ in range(6):
        if not (problems := problems_of(text)):
            break
        assert_help_is_in(problems[0], mended := apply(problems[0].edits(), text))
        assert mended != text
        text = mended
    assert _words(text) == _words(SURROUNDINGS[where].format(meant.strip()))


def assert_help_is_in(problem: Problem, mended: str) -> None:
    """What the first help tells to write is what the edits write. `…` stands for the rest, which the user knows."""
    for text in problem.help()[:1]:
        found = re.match(r"(?:write|multiply:) `([^`]+)`(?!,? to multiply)", text)
        if found and "…" not in found[1]:
            assert _close(found[1]) in _close(mended), (text, mended)


def _words(text: str) -> list[str]:
    return text.split()


def _close(text: str) -> str:
    """Without blanks and the brackets that only open or close here."""
    return re.sub(r"\s+", "", text)


@pytest.mark.parametrize("slip", ["if a then b", "v[]", "[]", "", "v +", "(v + u)'", "a ? b : c"])
def test_where_the_user_has_to_choose_nothing_is_edited(slip: str) -> None:
    first = problems_of(SURROUNDINGS["value"].format(slip))[0]
    assert first.edits() == ()


@pytest.mark.parametrize("word", sorted(forms.FORMS))
def test_forms_are_right(word: str) -> None:
    """What is shown as the form of a statement can be read where such a statement stands."""
    example = forms.FORMS[word][1]
    assert any(not problems_of(frame.format(example)) for frame in _frames())


@pytest.mark.parametrize(
    "example",
    [
        forms.AGENT_FORM[1],
        forms.INSTANCE_FORM[1],
        forms.GROUP_SETTINGS_FORM[1],
        forms.INITIAL_FORM[1],
        f"let a = {forms.IF_FORM};",
    ],
)
def test_other_forms_are_right(example: str) -> None:
    assert any(not problems_of(frame.format(example)) for frame in _frames())


def _frames() -> tuple[str, ...]:
    return (*SURROUNDINGS.values(), "agent A() {{ diff {{ {} }} }}")
