"""What a model means does not depend on how it is written: names, an agent around it, where a level ends, units."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from checks import Tried, codes
from judging import Case
from making.models import Wishes, random_model
from making.rewriting import in_thousandths, joined, renamed, renamed_path, wrapped

from hierc.grammar.problems import ModelError

pytestmark = pytest.mark.filterwarnings("ignore")
EACH = 5


def tried(seed: int, wishes: Wishes) -> Tried | None:
    """A random model; None if a number in it that is known when compiling has no finite value."""
    try:
        return Tried(random_model(Random(seed), wishes), seed)
    except ModelError as error:
        if codes(error) != {"E581"}:
            raise
        return None


@pytest.mark.parametrize("first", range(2000, 2015, EACH))
def test_other_names(first: int) -> None:
    for seed in range(first, first + EACH):
        if (case := tried(seed, Wishes(arrays=seed % 2 == 1))) is not None:
            case.same(renamed(case.case.text), renamed_path)


@pytest.mark.parametrize("level", [False, True])
@pytest.mark.parametrize("first", range(2100, 2110, EACH))
def test_one_more_agent_around_it(first: int, level: bool) -> None:
    for seed in range(first, first + EACH):
        if (case := tried(seed, Wishes(arrays=seed % 2 == 1, seeing=False))) is not None:
            case.same(wrapped(case.case.text, level=level), "inner.{}".format)


@pytest.mark.parametrize("first", range(2200, 2215, EACH))
def test_levels_joined(first: int) -> None:
    """Unless that puts into one group what stands before and after the levels of a sub-agent."""
    for seed in range(first, first + EACH):
        if (case := tried(seed, Wishes(arrays=seed % 2 == 1))) is not None:
            try:
                other = Case(joined(case.block).text())
                # What is read from another group may be multiplied in another order than what is computed there.
                other.check_rates(case.t, np.array(other.vector(case.case.by_path(case.x)), np.float64))
                other.check_start(case.t)
            except ModelError as error:
                if not codes(error) <= {"E601", "E603"}:
                    raise


@pytest.mark.parametrize("first", range(2300, 2315, EACH))
def test_other_units(first: int) -> None:
    for seed in range(first, first + EACH):
        if (case := tried(seed, Wishes(style="mixed"))) is not None:
            other = in_thousandths(case.case.text)
            assert "[mm" in other or "[g" in other
            case.same(other)
