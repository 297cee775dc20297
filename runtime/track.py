"""Growing memory for a group's segments.

Small tracks are plain arrays. A large one is a mapping of its own, which the operating system can make longer without copying it, so that growth never
holds up the run; where the system cannot, it is copied.
"""

from __future__ import annotations

import mmap
import sys

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
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
        made = _private_mapping(8 * count) if 8 * count >= _MAPPED else None
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
    """Zeroed memory that can be lengthened; None where the system has none. A shared mapping, mmap's default, cannot grow."""
    if sys.platform != "linux":
        return None
    return mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
