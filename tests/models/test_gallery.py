"""The gallery: every model against the same physics written by hand, against another solver, and against what it is there to show."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import byhand
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

import hierc
from hierc.runtime.model import Model
from hierc.runtime.result import Result

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
FILES = {file.stem: file for file in sorted((ROOT / "models").glob("*.hier"))}


@cache
def load(name: str, **params: int) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # invariants are not watched yet
        return hierc.load(name, params=params)


@cache
def run(name: str, **params: int) -> Result:
    """The model's own experiment."""
    return load(name, **params).simulate()


# ---- right-hand sides ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Layout:
    """Where each variable's scalars are in the state vector, in the shape of the variable; arrays of agents come first in it."""

    places: Mapping[str, NDArray[np.int64]]

    @classmethod
    def of(cls, states: Iterable[str]) -> Layout:
        found: dict[str, dict[tuple[int, ...], int]] = {}
        for k, name in enumerate(states):
            subscript = tuple(int(i) - 1 for i in re.findall(r"\d+(?=[,\]])", name))
            found.setdefault(re.sub(r"\[[\d,]+\]", "", name), {})[subscript] = k
        places = {}
        for name, elements in found.items():
            places[name] = np.full(np.max(list(elements), axis=0).astype(int) + 1, -1)
            for subscript, k in elements.items():
                places[name][subscript] = k
        return cls(places)

    def split(self, x: Floats) -> dict[str, Floats]:
        return {name: x[places] for name, places in self.places.items()}

    def joined(self, values: Mapping[str, ArrayLike]) -> Floats:
        assert values.keys() == self.places.keys()
        x = np.full(sum(places.size for places in self.places.values()), np.nan)
        for name, places in self.places.items():
            x[places] = values[name]
        return x


#: How far from the start to look, by variable, where 0.3 of the start or of 1 is not right.
SPREADS = {"motor.n": 150.0, "hull.v": 2.0}
SIZES: tuple[tuple[str, dict[str, int]], ...] = (
    *((name, {}) for name in FILES),
    ("links", {"n": 1}), ("links", {"n": 2}), ("links", {"n": 3}),
    ("platoon", {"N": 1}), ("platoon", {"N": 3}), ("platoon", {"N": 150}),
    ("snake", {"n": 1}), ("snake", {"n": 3}), ("snake", {"n": 40}),
    ("swarm", {"N": 3}), ("swarm", {"N": 10}), ("swarm", {"N": 200}),
)  # fmt: skip


def test_every_model_is_written_by_hand() -> None:
    assert byhand.MODELS.keys() == FILES.keys()


@pytest.mark.parametrize(("name", "params"), SIZES, ids=str)
def test_right_hand_sides_are_those_written_by_hand(name: str, params: dict[str, int]) -> None:
    model = load(name, **params)
    layout = Layout.of(model.states)
    start = layout.split(model.initial())
    rng = np.random.default_rng(5)
    for t in (0.0, 0.7, 3.0, 64.0):
        x = {
            q: values + rng.normal(size=values.shape) * SPREADS.get(q, 0.3 * np.maximum(1, np.abs(values)))
            for q, values in start.items()
        }
        if name == "boat":  # inside the table
            x = {q: np.abs(values).clip(0, 300) for q, values in x.items()}
        found = layout.split(model.rhs(t, layout.joined(x)))
        expected = layout.split(layout.joined(byhand.MODELS[name](t, x)))
        for q, values in expected.items():
            assert found[q] == pytest.approx(values, rel=1e-10, abs=1e-12 * max(1, np.abs(values).max())), q
