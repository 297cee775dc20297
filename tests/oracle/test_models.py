"""Random models against the interpreter: equations, initial values, observed variables, Jacobians, machine code; order and layout of text.

Thousands more: `python tests/oracle/many.py 0 10000`.
"""

from __future__ import annotations

from random import Random

import pytest
from checks import ALWAYS, SOME, attempt
from judging import Case
from making.models import Wishes, random_model

EACH = 10


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("first", range(0, 100, EACH))
def test_random_models(first: int) -> None:
    for seed in range(first, first + EACH):
        block = random_model(
            Random(seed), Wishes(arrays=seed % 2 == 1, outside=seed % 3 == 1, groups=seed % 5 < 3)
        )
        problem = attempt(block, seed, (*ALWAYS, SOME[seed // 2 % len(SOME)]))
        if problem is not None:
            raise AssertionError(f"seed {seed}: {problem}\n{block.text()}") from problem


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(1000, 1020))
def test_machine_code(seed: int) -> None:
    block = random_model(Random(seed), Wishes(large=0.5))
    problem = attempt(block, seed, ("machine",))
    if problem is not None:
        raise AssertionError(f"{problem}\n{block.text()}") from problem


def test_states_have_their_own_names() -> None:
    """Not those of variables before them that are the same: what `goal` is bound to, what `y` is equal to."""
    text = """
      agent Follow() { read real goal; write real y, x = 0; alge { y = x; } diff { x' = goal - x; } }
      agent Top() { agent a = Follow() [goal := b.x]; agent b = Follow() [goal := a.x]; }"""
    case = Case(text, "Top")
    assert sorted(case.model.states) == ["a.x", "b.x"]
    case.check_rates(0.0, [1.0, 3.0])


@pytest.mark.parametrize("ahead", ["i - 1", "i + 1"])
def test_initial_values_along_an_array(ahead: str) -> None:
    """Each link starts where the one ahead of it does, and a step further: one pass over them in the right order, forwards or backwards."""
    first = "1" if ahead == "i - 1" else "9"
    text = f"""
      agent Head() {{ write real x = 2 + time; diff {{ x' = -x; }} }}
      agent Link(int k) {{
        read real a; write real x = 0.9*a + sin(k), y = 2*x; diff {{ x' = a - x; y' = x; }}
      }}
      agent Top() {{
        agent head = Head();
        agent link[i in 1..9] = Link(k = i) [a := if i == {first} then head.x else link[{ahead}].x];
        group each link;
      }}"""
    case = Case(text, "Top")
    plan = case.model.plan
    assert plan.start_passes == 1
    assert (plan.start_order is None) == (ahead == "i - 1")
    for t in (0.0, 1.5):
        case.check_start(t)
