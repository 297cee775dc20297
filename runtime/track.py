"""Growing memory for the groups' segments.

At first all groups' tracks are parts of one array; a group that outgrows its part gets a track of its own. Small ones are plain arrays. A large one is a
mapping of its own, which the operating system can make longer without copying it, so that growth never holds up the run; where the system cannot,
it is copied. Of the array in parts each group uses only the beginning of its own, so it is not made of the huge pages that numpy asks for: clearing what
nobody uses, and looking for room for it, took longer than the steps themselves.
"""

from __future__ import annotations

import mmap
import sys
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Bytes from which a track is a mapping.
_MAPPED = 1 << 20


class Track:
    """`count` doubles, zero at first; `array` is a view of them until the next `grow`."""

    def __init__(self, count: int) -> None:
        self._map: mmap.mmap | None = None
        self.array: Floats = np.zeros(count)

    @property
    def address(self) -> int:
        """Where the doubles are."""
        return int(self.array.ctypes.data)

    def grow(self, count: int) -> None:
        """Make room for `count` doubles; those there are stay."""
        if self._map is not None and self._extend(8 * count):
            return
        made = _private_mapping(8 * count)
        larger: Floats = np.zeros(count) if made is None else np.frombuffer(made, np.float64)
        larger[: len(self.array)] = self.array
        self._map, self.array = made, larger

    def _extend(self, size: int) -> bool:
        """Make the mapping longer where it is, or move it, without copying; False where that is not possible."""
        assert self._map is not None
        count = len(self.array)
        self.array = np.zeros(0)  # a mapping in use cannot be resized
        try:
            self._map.resize(size)
        except (BufferError, OSError, SystemError, ValueError):
            self.array = np.frombuffer(self._map, np.float64, count)
            return False
        self.array = np.frombuffer(self._map, np.float64)
        return True


def _private_mapping(size: int) -> mmap.mmap | None:
    """Zeroed memory that can be lengthened; None for little, and where the system has none. A shared mapping, mmap's default, cannot grow."""
    if sys.platform != "linux" or size < _MAPPED:
        return None
    return mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)


def _in_small_pages(count: int) -> Floats:
    """Zeros that take memory only where they are used, as far as the system can."""
    made = _private_mapping(8 * count)
    if made is None:
        return np.zeros(count)
    with suppress(OSError):  # a system without huge pages
        made.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(made, np.float64)


class Tracks:
    """The tracks of all groups, of so many doubles at first. `addresses` are those of their first segments, `bytes` what they take altogether."""

    def __init__(self, lengths: Integers) -> None:
        self._lengths = lengths
        ends = np.cumsum(lengths)
        self._firsts: Integers = ends - lengths
        self._shared: Floats = _in_small_pages(int(ends[-1]) if len(ends) else 0)
        self._own: dict[int, Track] = {}
        self.addresses: Integers = self._shared.ctypes.data + 8 * self._firsts
        self.bytes = self._shared.nbytes

    def array(self, g: int) -> Floats:
        """The doubles of a group's track, until it grows."""
        if g in self._own:
            return self._own[g].array
        first = int(self._firsts[g])
        return self._shared[first : first + int(self._lengths[g])]

    def grow(self, g: int) -> None:
        """Twice the room for a group; what there is stays."""
        before = self.array(g)
        count = 2 * len(before)
        if g not in self._own:
            self._own[g] = Track(0)
            self._own[g].array = before
        del before  # a mapping in use could not be made longer where it is
        self._own[g].grow(count)
        self.addresses[g] = self._own[g].address
        self.bytes += 4 * count
