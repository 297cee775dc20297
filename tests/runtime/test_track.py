"""Tracks keep what is in them however they grow."""

from __future__ import annotations

import numpy as np
import pytest

from hierc.runtime import track
from hierc.runtime.track import Track


@pytest.mark.parametrize("mapped", [1 << 20, 1 << 12, 0])
def test_growth_keeps_the_contents(mapped: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track, "_MAPPED", mapped)
    made, size, rng = Track(100), 100, np.random.default_rng(0)
    known = np.zeros(0)
    while size < 3_000_000:
        fresh = rng.standard_normal(size - len(known))
        made.array[len(known) : size] = fresh
        known = np.concatenate([known, fresh])
        size *= 3
        made.grow(size)
        assert len(made.array) == size
        assert made.address == made.array.ctypes.data
        assert made.array[: len(known)].tobytes() == known.tobytes()
        assert not made.array[len(known) :].any()


def test_a_view_in_use_stays_valid() -> None:
    """A mapping with views cannot move; the track goes elsewhere and the views keep their numbers."""
    made = Track(1 << 18)
    made.grow(1 << 19)
    made.array[:] = 1.0
    view = made.array[10:20]
    made.grow(1 << 20)
    made.array[:] = 2.0
    assert view.tolist() == [1.0] * 10
