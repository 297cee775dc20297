"""The subset of Python that is lowered to machine code, as Python sees it.

Types, by annotation: `float` (double), `int` (64 bits, signed, wraps), `Lanes` (a fixed number of doubles), `Array[T]` (a pointer), and
records. Everything here also works under CPython, with numpy arrays for lanes and arrays, so the same text can be run and tested there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, Generic, TypeVar, get_type_hints

import numpy as np
import numpy.typing as npt

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., object])

Lanes = npt.NDArray[np.float64]


class Array(Generic[T]):
    """A pointer to consecutive items of type T. Under CPython: anything that can be indexed."""

    def __getitem__(self, index: int) -> T:
        raise TypeError("an annotation only")

    def __setitem__(self, index: int, value: T) -> None:
        raise TypeError("an annotation only")


class Record:
    """Fields of 8 bytes each, in the order of their annotations: float, int, or Array (a pointer).

    Under CPython an instance is any object with these attributes.
    """

    @classmethod
    @functools.cache
    def fields(cls) -> dict[str, Any]:
        """Field names and their annotated types, in order of layout."""
        return get_type_hints(cls, include_extras=True)

    @classmethod
    @functools.cache
    def numbers(cls) -> dict[str, int]:
        """The number of each field."""
        return {name: k for k, name in enumerate(cls.fields())}


class RecordArray:
    """Memory for `count` records: `self["t"]` is a numpy view of one field over all records (int64 or float64)."""

    def __init__(self, record: type[Record], count: int, memory: npt.NDArray[np.int64] | None = None) -> None:
        """`memory`: of (records, fields), where it exists already."""
        self.record = record
        self.memory = np.zeros((max(count, 1), len(record.fields())), np.int64) if memory is None else memory
        self._views: dict[str, npt.NDArray[Any]] = {}

    def copy(self) -> RecordArray:
        """The same records in memory of their own."""
        return RecordArray(self.record, len(self.memory), self.memory.copy())

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        if name not in self._views:
            column = self.memory[:, self.record.numbers()[name]]
            self._views[name] = column.view(np.float64) if self.record.fields()[name] is float else column
        return self._views[name]

    @property
    def address(self) -> int:
        """Address of the first record."""
        return int(self.memory.ctypes.data)


def aligned(count: int, alignment: int = 64) -> npt.NDArray[np.float64]:
    """`count` zero doubles whose address is a multiple of `alignment` bytes."""
    raw = np.zeros(count + alignment // 8)
    skip = (-raw.ctypes.data % alignment) // 8
    return raw[skip : skip + count]


# ---- built-in functions -------------------------------------------------------------------------


def lane(v: Lanes, k: int) -> float:
    """Lane k (a constant) of v."""
    return float(v[k])


def splat(x: float) -> Lanes:
    """x in every lane (under CPython: in one)."""
    return np.full(1, x)


def swap_halves(v: Lanes) -> Lanes:
    """The upper half of the lanes below the lower half."""
    half = len(v) // 2
    return np.concatenate([v[half:], v[:half]])


def lower_twice(v: Lanes) -> Lanes:
    """The lower half of the lanes, in both halves."""
    half = len(v) // 2
    return np.concatenate([v[:half], v[:half]])


def upper_twice(v: Lanes) -> Lanes:
    """The upper half of the lanes, in both halves."""
    half = len(v) // 2
    return np.concatenate([v[half:], v[half:]])


def total(v: Lanes) -> float:
    """Sum over the lanes, by halves."""
    while len(v) > 1:
        half = len(v) // 2
        v = v[:half] + v[half:]
    return float(v[0])


def largest(v: Lanes) -> float:
    """The largest lane; NaN if a lane is."""
    return float(np.max(v))


def select(mask: Any, a: Lanes | float, b: Lanes | float) -> Lanes:
    """a where mask, else b; lane by lane. Under CPython a lane may be just a number."""
    chosen: Any = (a if mask else b) if isinstance(mask, bool | np.bool_) else np.where(mask, a, b)
    lanes: Lanes = chosen
    return lanes


def any_lane(mask: Any) -> bool:
    """Whether the mask holds in some lane."""
    return bool(mask) if isinstance(mask, bool | np.bool_) else bool(np.any(mask))


def at(array: Array[T], offset: int) -> Array[T]:
    """The array from item `offset` on."""
    rest: Array[T] = array[offset:]  # type: ignore[index, assignment]
    return rest


def put(array: Any, value: Lanes) -> None:
    """Store the lanes of a value as consecutive items of an array of floats."""
    array[: len(value)] = value


def unroll(count: int) -> range:
    """`range(count)` for a constant count: the loop is written out when lowered, its index a constant."""
    return range(count)


def bits(x: float) -> int:
    """The 64 bits of a double, as an integer."""
    return int(np.float64(x).view(np.int64))


def bit(v: Lanes, k: int) -> Any:
    """Whether bit k (a constant, 0 the lowest) of each lane is set."""
    return (np.asarray(v, np.float64).view(np.int64) >> k) & 1 != 0


def from_bits(n: int) -> float:
    """The double with these 64 bits."""
    return float(np.int64(n).view(np.float64))


def fma(a: Any, b: Any, c: Any) -> Any:
    """a*b + c, contracted to one rounding where the machine can."""
    return a * b + c


def release() -> None:
    """What was stored before is seen by other threads before what is stored after. (Under CPython there are none.)"""


def acquire() -> None:
    """What is loaded after is at least as new as what was loaded before."""


def is_finite(x: float) -> bool:
    """Whether x is neither infinite nor NaN."""
    return math.isfinite(x)


def each_lane(function: Callable[..., float], *args: Lanes) -> Lanes:
    """A scalar function applied lane by lane."""
    return np.array([function(*scalars) for scalars in zip(*args, strict=True)])


def power_of_two(n: Lanes) -> Lanes:
    """2**n for whole numbers n from -1022 to 1023."""
    return np.ldexp(np.ones_like(n), n.astype(np.int64))


def standalone(function: F) -> F:
    """Mark a pure function that is called, not inlined, so that equal calls are made once."""
    function.standalone = True  # type: ignore[attr-defined]
    return function


def rare(function: F) -> F:
    """Mark a function that is hardly ever called: what surrounds the call keeps its registers."""
    function.rare = True  # type: ignore[attr-defined]
    return function


def outlined(function: F) -> F:
    """Mark a function that is called, not inlined, because it is large and called from many places."""
    function.outlined = True  # type: ignore[attr-defined]
    return function


def exact(function: F) -> F:
    """Mark a function whose products and sums are each rounded, so that its machine code has CPython's very bits."""
    function.exact = True  # type: ignore[attr-defined]
    return function


def invoke(address: int, *args: Any) -> float:
    """Call the piece at `address`, which returns a float. Under CPython the address is a callable."""
    result: float = address(*args)  # type: ignore[operator]
    return result
