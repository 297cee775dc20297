"""Changing a group's method during a run, where the choice was left to us and the group turns stiff.

An explicit method that sees its steps bounded by stability asks for a review (`control.watch_stability`). The favourite is then tried for some steps, and
stays if it costs less a second of simulated time than the explicit one did; else the explicit one comes back for good. All of it follows from the group's own
steps, so neither the length of the kernel's calls nor threads change what happens.

A group's segments keep their width, so what readers know of them holds; the polynomials of a lower degree have zeros above it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice
from hierc.runtime.layout import facts
from hierc.runtime.machine.dialect import aligned
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.methods.catalogue import METHODS

if TYPE_CHECKING:
    from hierc.runtime.simulation import Simulation

Floats = NDArray[np.float64]
#: Steps for which a method is tried; the later half of them counts.
TRIED = 24
#: What a group's record knows of its method, beside what stays as it is.
_STAYS = {"n", "stride", "width", "inputs", "published", "degree"}
_NEVER = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class Left:
    """A method that another is tried for, and what it cost, ns for a second."""

    method: str
    cost: float


class Reviews:
    """The groups of a run whose methods were looked at again. `methods` are those of all groups now."""

    def __init__(self, methods: Sequence[str]) -> None:
        self.methods = methods
        self._left: dict[int, Left] = {}
        self._memory: dict[int, list[Floats]] = {}

    def review(self, simulation: Simulation, g: int) -> None:
        """A group asks whether its method is the right one."""
        groups = simulation.groups
        wiring = next(w for w in simulation.wiring if g in w.places)
        cost = self._cost(simulation, wiring, g)
        if g not in self._left:
            self._left[g] = Left(self.methods[g], cost)
            self._change(simulation, wiring, g, choice.FAVOURITE)
            groups["review"][g] = groups["steps"][g] + TRIED
            return
        if cost > self._left[g].cost:
            self._change(simulation, wiring, g, self._left[g].method)
        groups["review"][g], groups["watched"][g] = _NEVER, 0

    def _cost(self, simulation: Simulation, wiring: Wiring, g: int) -> float:
        """What the group's steps cost lately, ns for a second."""
        method = self.methods[g]
        stride, count = int(simulation.groups["stride"][g]), int(simulation.groups["count"][g])
        sizes = simulation.tracks.array(g)[: count * stride].reshape(count, stride)[-TRIED // 2 :, 3]
        pieces = simulation.engine.program_for(wiring.form, method).pieces[wiring.form, method]
        probe = simulation.probe(wiring, g, float(sizes.mean()), pieces)
        return choice.step_cost(method, probe) / probe.step

    def _change(self, simulation: Simulation, wiring: Wiring, g: int, name: str) -> None:
        """From where the group stands it goes on with this method, as if it began there."""
        groups, form, method = simulation.groups, wiring.form, METHODS[name]
        program = simulation.engine.program_for(form, name)
        made = program.pieces[form, name]
        for field, fact in facts(form, method, program, made).items():
            if field not in _STAYS:
                groups[field][g] = fact
        groups["degree"][g] = max(int(groups["degree"][g]), method.degree)
        self._memory[g] = [aligned(max(form.inputs * method.input_rows, 1)), aligned(max(made.work, 1))]
        for field, array in zip(("u", "work"), self._memory[g], strict=True):
            groups[field][g] = array.ctypes.data
        for field in ("h", "fresh", "last_size", "last_error", "rejections", "limited"):
            groups[field][g] = 0
        self.methods = [name if k == g else m for k, m in enumerate(self.methods)]
