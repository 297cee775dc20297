"""Distinct numbers and medians, against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from hierc.runtime.columns import distinct, firsts, labelled, median

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("count", [0, 1, 2, 7, 300])
def test_distinct_numbers(count: int) -> None:
    column = RNG.integers(-5, 40, count)
    found, labels = labelled(column)
    assert found.tolist() == distinct(column).tolist() == np.unique(column).tolist()
    assert found[labels].tolist() == column.tolist()
    ordered = np.sort(column)
    assert firsts(ordered).tolist() == np.unique(ordered, return_index=True)[1].tolist()
    table = RNG.normal(0, 1, (count, 3)).round(1)
    assert distinct(table).tolist() == np.unique(table).tolist()


@pytest.mark.parametrize("count", [1, 2, 3, 10, 201])
def test_median(count: int) -> None:
    for column in (RNG.normal(0, 1, count), RNG.integers(0, 9, count)):
        assert median(column) == np.median(column)
