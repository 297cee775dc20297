"""Slices: sums and extremes over slices of a row of scalars, as nodes that many slices share.

A row is cut into pieces of `WIDTH`. A slice is what it has of its last piece, what it has of its first one, and a slice of the whole pieces between; these
are joined first, and make a row in turn. So each slice takes a few nodes for each power of `WIDTH` in the length of the row, those of the whole
pieces are shared, and a node joins nothing that is not in the slice of everyone who reads it: an element that sums over those before it depends on no
later one. Nodes that join unequal numbers are still of one form, in one block. Part of the phase `flatten.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Integers
from hierc.compiler.structure.storage import Kind

#: Scalars in a piece of a row: what one node joins at most.
WIDTH = 8


@dataclass(frozen=True, slots=True)
class Slices:
    """Slices of rows: of which row, and the places of the first and the last scalar in it, from 0; there are none where the last comes first."""

    row: Integers
    first: Integers
    last: Integers

    def taken(self, which: NDArray[np.bool_]) -> Slices:
        """Some of them."""
        return Slices(self.row[which], self.first[which], self.last[which])


class Maker(Protocol):
    """Makes a block of nodes."""

    def __call__(self, kind: Kind, scalars: Integers, sizes: Integers, places: Integers) -> Integers:
        """Algebraic variables that join the first few (`sizes`) of each row of `scalars`; they belong to the rows at `places`."""
        ...


class Row:
    """Rows of equal width, shape (rows, width), and the slices of them that were joined."""

    def __init__(self, make: Maker, kind: Kind, scalars: Integers) -> None:
        self._make = make
        self._kind: Kind = kind
        self._scalars = scalars
        self._width = scalars.shape[1]
        self._pieces = _Made(self._within_pieces)
        self._slices = _Made(self._over_pieces)
        self._whole: Row | None = None

    def joined(self, slices: Slices) -> Integers:
        """The algebraic variables that join some slices, none of them empty."""
        return self._slices.numbers(self._codes(slices))

    def _codes(self, slices: Slices) -> Integers:
        codes: Integers = (slices.row * self._width + slices.first) * self._width + slices.last
        return codes

    def _decoded(self, codes: Integers) -> Slices:
        rest, last = np.divmod(codes, self._width)
        return Slices(*np.divmod(rest, self._width), last)

    def _within_pieces(self, codes: Integers) -> Integers:
        """Nodes for slices that lie in one piece each."""
        s = self._decoded(codes)
        sizes = s.last - s.first + 1
        places = np.minimum(s.first[:, None] + np.arange(sizes.max()), s.last[:, None])
        scalars = self._scalars[s.row[:, None], places]
        if scalars.shape[1] == 1 and self._kind == "algebraic":
            return scalars[:, 0]
        return self._make(self._kind, scalars, sizes, s.row)

    def _over_pieces(self, codes: Integers) -> Integers:
        """Nodes for slices of any length."""
        s = self._decoded(codes)
        if self._width <= WIDTH:
            return self._pieces.numbers(codes)
        begin, end = s.first // WIDTH, s.last // WIDTH
        heads = bool((s.first % WIDTH).any())
        tails = bool(((s.last + 1) % WIDTH != 0)[s.last + 1 != self._width].any())
        parts: list[Integers] = []
        if tails:
            parts.append(self._codes(Slices(s.row, np.maximum(s.first, end * WIDTH), s.last)))
        if heads:
            parts.append(self._codes(Slices(s.row, s.first, np.minimum(s.last, begin * WIDTH + WIDTH - 1))))
        between = Slices(s.row, begin + heads, end - tails)
        there = between.first <= between.last
        if not parts:
            return self._joined_whole(between)
        made: Integers = self._pieces.numbers(np.concatenate(parts)).reshape(len(parts), -1)
        if not there.any() and len(parts) == 1:
            return made.ravel()
        sizes = np.where(begin == end, 1, len(parts)) + there
        scalars = np.concatenate([made, made[:1]]).T
        if there.any():
            scalars[there, sizes[there] - 1] = self._joined_whole(between.taken(there))
        return self._make("algebraic", scalars[:, : sizes.max()], sizes, s.row)

    def _joined_whole(self, slices: Slices) -> Integers:
        """The variables that join slices of whole pieces."""
        count = -(-self._width // WIDTH)
        if self._whole is None:
            none = np.full((len(self._scalars), count), -1)
            self._whole = Row(self._make, "algebraic", none)
        whole = self._whole
        changes = np.zeros((len(self._scalars), count + 1), np.int64)
        np.add.at(changes, (slices.row, slices.first), 1)
        np.add.at(changes, (slices.row, slices.last + 1), -1)
        needed = changes.cumsum(axis=1)[:, :-1] > 0
        row, piece = np.nonzero(needed & (whole._scalars < 0))
        if len(row):
            first = piece * WIDTH
            last = np.minimum(first + WIDTH, self._width) - 1
            whole._scalars[row, piece] = self._pieces.numbers(self._codes(Slices(row, first, last)))
        return whole.joined(slices)


class _Made:
    """Numbers by codes, which are made when they are first asked for."""

    def __init__(self, make: Callable[[Integers], Integers]) -> None:
        self._make = make
        self._codes = np.zeros(0, np.int64)
        self._numbers = np.zeros(0, np.int64)

    def numbers(self, codes: Integers) -> Integers:
        """The number of each code."""
        fresh = np.setdiff1d(codes, self._codes)
        if len(fresh):
            made = self._make(fresh)
            together = np.concatenate([self._codes, fresh])
            order = np.argsort(together)
            self._codes, self._numbers = together[order], np.concatenate([self._numbers, made])[order]
        return self._numbers[np.searchsorted(self._codes, codes)]
