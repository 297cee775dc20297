"""What an integration method is to the rest of the runtime."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from hierc.runtime.machine.compose import Composer

Piece = Callable[..., float]


class Names(NamedTuple):
    """What a method's pieces are lowered with: constants and functions by name, and the workspace they need, in doubles."""

    names: Mapping[str, Any]
    work: int
    linear: bool
    updates: int = 0  # of a factorisation, and entries of its factors: what linear algebra costs
    entries: int = 0


class Method(Protocol):
    """One method. `lanes` is the width of its values; it reads inputs at `input_rows` times a step; a segment has `degree` + 1 coefficients a channel, padded to `width`.

    `order` is that of the solution at knots, `dense_order` between them, `error_order` of the estimate (err ~ h**error_order).
    `keeps_work`: whether its workspace holds something from one step to the next; otherwise groups may share it.
    `step` decides, the same for all groups; `pieces` compute, lowered for each form of group under their own names.
    """

    @property
    def name(self) -> str: ...
    @property
    def order(self) -> int: ...
    @property
    def dense_order(self) -> int: ...
    @property
    def error_order(self) -> int: ...
    @property
    def lanes(self) -> int: ...
    @property
    def degree(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def input_rows(self) -> int: ...
    @property
    def newton_tolerance(self) -> float: ...
    @property
    def keeps_work(self) -> bool: ...
    @property
    def step(self) -> Piece: ...
    @property
    def pieces(self) -> tuple[Piece, ...]: ...

    def step_names(self) -> Mapping[str, Any]:
        """Constants that `step` is lowered with."""

    def names(self, composer: Composer) -> Names:
        """What the pieces are lowered with for one form of group."""
