"""What an integration leaves: the segments of every group, as arrays, and their values at any time."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import records
from hierc.runtime.columns import firsts
from hierc.runtime.elements import Elements
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.machine.program import Program
from hierc.runtime.segments import HEADER
from hierc.runtime.track import Tracks

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_SAMPLE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


@dataclass(frozen=True)
class GroupTrajectory:
    """Segments of one group, a row of `table` each (see `segments.py`); `reached` is the end of the last."""

    name: str
    method: str
    degree: int
    width: int
    table: Floats
    reached: float
    initial: Floats  # (n,): what holds before the first step
    stats: Mapping[str, int]
    program: Program  # whose `sample` evaluates

    @property
    def knots(self) -> Floats:
        """Ends of the steps (k + 1,), s."""
        return np.append(self.table[:, 0], self.reached)

    @property
    def coefficients(self) -> Floats:
        """Coefficients (k, n, degree + 1) of the states in theta = (t - t0)/h, lowest power first."""
        n = len(self.initial)
        places = self.table[:, HEADER : HEADER + n * self.width].reshape(len(self.table), n, self.width)
        return places[:, :, : self.degree + 1]

    def __call__(self, t: Floats) -> Floats:
        """States (len(t), n) at the times t, each within the knots (at a knot: of the segment that ends there)."""
        n = len(self.initial)
        if not len(self.table):
            return np.broadcast_to(self.initial, (len(t), n)).copy()
        places = HEADER + self.width * np.arange(n, dtype=np.int64)
        requests = RecordArray(records.Request, 1)
        count, stride = self.table.shape
        facts = (self.table.ctypes.data, count, stride, self.degree, places.ctypes.data, n)
        requests.memory[0] = facts
        return _sampled(self.program, requests, places, t)


@dataclass(frozen=True)
class Trajectories(Sequence[GroupTrajectory]):
    """The segments of all groups, in cascade order; a group's own are made when they are asked for.

    `initial` (n,) are the states before the first steps; without a `program` that is all there is. `records` are the groups' as they stood at the end.
    """

    elements: Elements
    initial: Floats
    program: Program | None = None
    tracks: Tracks | None = None
    methods: Sequence[str] = ()
    records: RecordArray | None = None

    def __len__(self) -> int:
        return 0 if self.records is None else self.elements.groups

    @overload
    def __getitem__(self, g: int) -> GroupTrajectory: ...

    @overload
    def __getitem__(self, g: slice) -> Sequence[GroupTrajectory]: ...

    def __getitem__(self, g: int | slice) -> GroupTrajectory | Sequence[GroupTrajectory]:
        if isinstance(g, slice):
            return [self[k] for k in range(*g.indices(len(self)))]
        if not -len(self) <= g < len(self):
            raise IndexError(g)
        g %= len(self)
        assert self.records is not None
        assert self.program is not None
        known = self.records
        return GroupTrajectory(
            name=self.elements.group_name(g),
            method=self.methods[g],
            degree=int(known["degree"][g]),
            width=int(known["width"][g]),
            table=self.table(g),
            reached=float(known["t"][g]),
            initial=self.initial[self.elements.group_offsets[g] : self.elements.group_offsets[g + 1]],
            stats={name: int(known[name][g]) for name in records.COUNTERS},
            program=self.program,
        )

    def table(self, g: int) -> Floats:
        """The segments of a group, a row each."""
        assert self.records is not None
        assert self.tracks is not None
        count, stride = int(self.records["count"][g]), int(self.records["stride"][g])
        return self.tracks.array(g)[: count * stride].reshape(count, stride)

    @cached_property
    def _integrated(self) -> NDArray[np.bool_]:
        """Whether a group has made a step, by place."""
        if self.records is None:
            return np.zeros(self.elements.groups, np.bool_)
        return np.asarray(self.records["count"][: self.elements.groups] > 0)

    def states(self, positions: Integers, t: Floats) -> Floats:
        """Some states, by their positions in the state vector, at the times t: (len(t), len(positions)).

        Before a group's first step its initial states hold, after its last knot what its last segment says.
        """
        places = np.searchsorted(self.elements.group_offsets, positions, "right") - 1
        moving = self._integrated[places]
        if moving.all():
            return self._moving(positions, places, t)
        out = np.tile(self.initial[positions], (len(t), 1))
        out[:, moving] = self._moving(positions[moving], places[moving], t)
        return out

    def _moving(self, positions: Integers, places: Integers, t: Floats) -> Floats:
        """States of groups that have made a step."""
        if not len(positions):
            return np.empty((len(t), 0))
        assert self.program is not None
        return _sampled(self.program, *self._requests(positions, places), t)

    def _requests(self, positions: Integers, places: Integers) -> tuple[RecordArray, Integers]:
        """Requests for the states at these positions, one for neighbours in the same group; the places of their coefficients."""
        assert self.records is not None
        assert self.tracks is not None
        begins = firsts(places)
        groups, counts = places[begins], np.diff(begins, append=len(places))
        channels = positions - self.elements.group_offsets[places]
        coefficients = HEADER + channels * self.records["width"][places]
        made = RecordArray(records.Request, len(groups))
        made["track"][:] = self.tracks.addresses[groups]
        for name in ("count", "stride", "degree"):
            made[name][:] = self.records[name][groups]
        made["places"][:] = coefficients.ctypes.data + 8 * begins
        made["channels"][:] = counts
        return made, coefficients


def _sampled(program: Program, requests: RecordArray, places: Integers, t: Floats) -> Floats:
    """The channels of some requests, whose `places` these are, at the times t: (len(t), len(places))."""
    times = np.ascontiguousarray(t, np.float64)
    out = np.empty((len(places), len(times)))
    shape = np.array([len(requests.memory), len(times)], np.int64)
    sample = _SAMPLE(program.sample)
    sample(requests.address, shape.ctypes.data, times.ctypes.data, out.ctypes.data)
    return out.T
