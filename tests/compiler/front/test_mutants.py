"""Mutated models give diagnostics and nothing else."""

from __future__ import annotations

import random
import re
from importlib.resources import files

import pytest

from hierc.compiler.driver import emit
from hierc.grammar.problems import ModelError
from hierc.grammar.render import render_all
from hierc.grammar.source import SourceFile

TOKEN = re.compile(r"[A-Za-z_]\w*|\d+(?:\.\d+)?|\s+|.", re.DOTALL)
WORDS = re.compile(
    "agent|alge|const|diff|experiment|for|func|group|init|inv|let|level|of|private|read|record|save|write|real"
)
VALUES = ("0", "1", "3", "2.5", "[1, 2]", "time", "true", "pi", "zeros(2)", "x'", "p")


def mutant(text: str, chance: random.Random) -> str:
    """The text with one name, number or operator exchanged for another."""
    tokens = TOKEN.findall(text)
    names = [t for t in tokens if t[0].isalpha() and not WORDS.fullmatch(t)]
    places = [
        i
        for i, t in enumerate(tokens)
        if t in "+-*/^" or t[0].isdigit() or (t[0].isalpha() and not WORDS.fullmatch(t))
    ]
    place = chance.choice(places)
    others = ("+", "*", "/", "^", ".*", "<", "and") if tokens[place] in "+-*/^" else (*names, *VALUES)
    tokens[place] = chance.choice(others)
    return "".join(tokens)


@pytest.mark.parametrize("name", ["cart", "servo", "arm"])
def test_mutants(name: str) -> None:
    text = files("hierc.models").joinpath(f"{name}.hier").read_text(encoding="utf-8")
    chance = random.Random(name)
    accepted, refused = 0, []
    for _ in range(80):
        try:
            emit(SourceFile("mutant.hier", mutant(text, chance)), "model")
            accepted += 1
        except ModelError as error:
            refused.append(render_all(error.problems))
    assert all(refused)
    assert accepted > 5
    assert len(refused) > 20
