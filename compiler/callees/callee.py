"""Tables and external functions as data: what expressions that call them refer to.

Numbers are in SI. Two that are read from the same text are equal; their data takes no part in comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import prod
from typing import Literal

from hierc.grammar.source import Span

Method = Literal["hold", "linear", "cubic"]
METHODS: tuple[Method, ...] = ("hold", "linear", "cubic")


@dataclass(frozen=True, slots=True)
class Axis:
    """An argument of a table: its grid in SI, increasing. One of the declared unit is `scale` in SI."""

    name: str
    unit: str | None
    scale: float
    knots: tuple[float, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Table:
    """A table on a rectangular grid; `values` row by row, the last axis fastest. `file` is as the model names it."""

    name: str
    file: str
    digest: str  # of all that decides its values
    method: Method = field(compare=False)
    axes: tuple[Axis, ...] = field(compare=False)
    values: tuple[float, ...] = field(compare=False, repr=False)

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """The shapes of its arguments."""
        return ((),) * len(self.axes)


@dataclass(frozen=True, slots=True)
class Extern:
    """An external function. One of the declared unit of argument k is `scales[k]` in SI, one of the result's is `scale`."""

    name: str
    target: str  # `module:function`
    shapes: tuple[tuple[int, ...], ...]
    scales: tuple[float, ...]
    scale: float
    span: Span = field(compare=False, repr=False)  # of the target

    def scale_of_scalar(self, place: int) -> float:
        """One of the declared unit of scalar argument `place`, in SI; the elements of vectors are counted."""
        every = [s for shape, s in zip(self.shapes, self.scales, strict=True) for _ in range(prod(shape))]
        return every[place]


Callee = Table | Extern
