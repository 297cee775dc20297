"""State vectors by the names of variables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


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
