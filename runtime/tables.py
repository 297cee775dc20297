"""Tables of a generated module: measured values on a rectangular grid, interpolated.

`linear` is continuous, `hold` keeps the value of the grid point before, `cubic` is the monotone cubic of Fritsch and Butland (known as PCHIP): its first
derivative is continuous, it stays between neighbouring values, so it invents no bumps, and one wrong value spoils only the cells around it. On several
axes the slopes along each axis are those of the grid lines, the mixed slopes the mean of taking the axes in either order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.machine.dialect import Array
from hierc.runtime.machine.interpolation import CUBIC, HOLD, LINEAR, interpolate

Floats = NDArray[np.float64]
T = TypeVar("T")
_METHODS = {"hold": HOLD, "linear": LINEAR, "cubic": CUBIC}


@dataclass(frozen=True, slots=True)
class Axis:
    """One argument of a table: its name, and its grid in SI, increasing, two points at least. One of the declared `unit` is `scale` in SI."""

    name: str
    knots: tuple[float, ...]
    unit: str | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class Table:
    """A table, or a derivative of it. `values` are in SI, row by row: the last axis goes fastest.

    `orders` says of each axis how often to differentiate by it: 0 or 1. `outside` is marked at each use beyond the grid: two numbers an axis, 1 where
    the argument was below it, and above it. A table's derivatives mark the same ones.
    """

    name: str
    method: Literal["hold", "linear", "cubic"]
    axes: tuple[Axis, ...]
    values: tuple[float, ...] = field(repr=False)
    orders: tuple[int, ...] = ()
    outside: list[int] = field(default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.orders:
            object.__setattr__(self, "orders", (0,) * len(self.axes))
            self.outside.extend([0] * (2 * len(self.axes)))

    def by(self, axis: int) -> Table:
        """The derivative by argument `axis`, counted from 0."""
        orders = tuple(n + (k == axis) for k, n in enumerate(self.orders))
        made = replace(self, orders=orders)
        made.__dict__["data"] = self.data
        return made

    @property
    def kind(self) -> int:
        """The method, as `interpolate` numbers them."""
        return _METHODS[self.method]

    @cached_property
    def sizes(self) -> list[int]:
        """Points along each axis."""
        return [len(axis.knots) for axis in self.axes]

    @cached_property
    def knots(self) -> list[float]:
        """The grids of all axes, one after the other."""
        return [knot for axis in self.axes for knot in axis.knots]

    @cached_property
    def data(self) -> list[float]:
        """The values, and for `cubic` the planes of slopes that `interpolate` wants."""
        values = np.array(self.values).reshape(self.sizes)
        if self.method != "cubic":
            return [float(v) for v in self.values]
        planes = slope_planes([np.array(axis.knots) for axis in self.axes], values)
        flat: list[float] = np.concatenate([plane.ravel() for plane in planes]).tolist()
        return flat

    @cached_property
    def digest(self) -> str:
        """Hash of all that decides its values."""
        numbers = np.array([*self.knots, *self.values]).tobytes()
        shape = repr((self.method, self.sizes, self.orders)).encode()
        return hashlib.sha256(shape + b"\0" + numbers).hexdigest()

    def __call__(self, *x: float) -> float:
        """The value (or derivative) at x, both in SI."""
        sizes, orders, outside = _array(self.sizes), _array(self.orders), _array(self.outside)
        knots, data, point = _array(self.knots), _array(self.data), _array([float(v) for v in x])
        weights = _array([0.0] * (4 * len(x)))
        count = len(self.values)
        return interpolate(self.kind, len(x), count, sizes, knots, data, orders, point, weights, outside)

    def excursions(self, marks: Sequence[int]) -> list[str]:
        """What went outside, by marks as `outside` has them: `rpm > 3000 rpm`."""
        found = []
        for k, axis in enumerate(self.axes):
            unit = f" {axis.unit}" if axis.unit else ""
            for mark, sign, edge in zip(
                marks[2 * k : 2 * k + 2], "<>", (axis.knots[0], axis.knots[-1]), strict=True
            ):
                if mark:
                    found.append(f"{axis.name} {sign} {edge / axis.scale:.12g}{unit}")
        return found


def _array(items: Sequence[T]) -> Array[T]:
    """What the dialect takes for an array."""
    return cast("Array[T]", items)


# ---- slopes -------------------------------------------------------------------------------------


def slope_planes(grids: Sequence[Floats], values: Floats) -> list[Floats]:
    """Values (plane 0) and slopes of every set of axes; bit j of a plane's number stands for axis j from the end."""
    count = len(grids)
    planes = [values]
    for plane in range(1, 2**count):
        axes = [count - 1 - j for j in range(count) if plane >> j & 1]
        found = [slopes(grids[axis], planes[plane & ~(1 << (count - 1 - axis))], axis) for axis in axes]
        planes.append(np.mean(found, axis=0))
    return planes


def slopes(x: Floats, values: Floats, axis: int) -> Floats:
    """The slopes at the knots x of monotone cubics along one axis (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984)."""
    y = np.moveaxis(values, axis, -1)
    h = np.diff(x)
    secant = np.diff(y, axis=-1) / h
    if len(x) == 2:
        result = np.concatenate([secant, secant], axis=-1)
        return np.moveaxis(result, -1, axis)
    before, after = secant[..., :-1], secant[..., 1:]
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    monotone = np.sign(before) * np.sign(after) > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = np.where(monotone, (w1 + w2) / (w1 / before + w2 / after), 0.0)
    ends = [_end_slope(h[0], h[1], secant[..., 0], secant[..., 1])]
    ends.append(_end_slope(h[-1], h[-2], secant[..., -1], secant[..., -2]))
    result = np.concatenate([ends[0][..., None], inner, ends[1][..., None]], axis=-1)
    return np.moveaxis(result, -1, axis)


def _end_slope(h0: float, h1: float, m0: Floats, m1: Floats) -> Floats:
    """The slope at an end by three points, limited so that the cubic stays monotone there."""
    slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    slope = np.where(np.sign(slope) != np.sign(m0), 0.0, slope)
    limited: Floats = np.where((np.sign(m0) != np.sign(m1)) & (np.abs(slope) > 3 * np.abs(m0)), 3 * m0, slope)
    return limited
