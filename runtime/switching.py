"""Changing a group's method during a run, where the choice was left to us and fell on an explicit method.

Such a method asks for a review where it sees its steps bounded by stability (`control.watch_stability`). The favourite is then tried for some steps, and stays
if it costs less a second of simulated time than the explicit one did; else that comes back. A trial that failed is repeated after so many steps that it
costs little beside them, twice as many each time, or as soon as the explicit steps have become much shorter: the group may turn stiff in stages. Where the
favourite stays, the explicit method is tried in the same way from time to time: the group may stop being stiff.

All of it follows from the group's own steps, so neither the length of the kernel's calls nor threads change what happens. A group's segments keep their
width, so what readers know of them holds; the polynomials of a lower degree have zeros above it.
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
#: Steps lost where a method comes back after a trial that failed: it begins with small ones.
LOST = 8
#: Between trials the work of at least so many of them is done.
RARELY = 10
#: A failed trial says nothing of explicit steps that are shorter by this factor.
SHORTER = 0.25
#: What a group's record knows of its method, beside what stays as it is.
_STAYS = {"n", "stride", "width", "inputs", "published", "degree"}
_NEVER = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class Lately:
    """What a group's steps with a method were lately: their mean size (s), and what one of them costs (ns)."""

    method: str
    size: float
    cost: float

    @property
    def each_second(self) -> float:
        """What a second costs, ns."""
        return self.cost / self.size


class Reviews:
    """The groups of a run whose methods were looked at again. `methods` are those of all groups now."""

    def __init__(self, methods: Sequence[str]) -> None:
        self.methods = methods
        self._first = methods
        self._left: dict[int, Lately] = {}  # those that another method is tried for
        self._failed: dict[int, int] = {}  # how many trials failed, one after the other
        self._memory: dict[int, list[Floats]] = {}

    def review(self, simulation: Simulation, g: int) -> None:
        """A group asks whether its method is the right one: begin to try the other, or look how it did."""
        wiring = next(w for w in simulation.wiring if g in w.places)
        now = self._lately(simulation, wiring, g)
        if g not in self._left:
            self._left[g] = now
            other = choice.FAVOURITE if now.method == self._first[g] else self._first[g]
            self._change(simulation, wiring, g, other)
            simulation.groups["review"][g] = simulation.groups["steps"][g] + TRIED
            simulation.groups["watched"][g] = 0
        elif now.each_second > self._left[g].each_second:
            self.withdraw(simulation, g)
        else:
            self._failed[g] = 0
            self._settle(simulation, g, now, self._left.pop(g))

    def withdraw(self, simulation: Simulation, g: int) -> bool:
        """Give up what a group tries: it does not pay, or cannot go on. False where it tries nothing."""
        if g not in self._left:
            return False
        wiring = next(w for w in simulation.wiring if g in w.places)
        tried, before = self._lately(simulation, wiring, g), self._left.pop(g)
        self._change(simulation, wiring, g, before.method)
        self._failed[g] = self._failed.get(g, 0) + 1
        self._settle(simulation, g, before, tried)
        return True

    def _settle(self, simulation: Simulation, g: int, stays: Lately, other: Lately) -> None:
        """Say when the group is to ask again."""
        groups = simulation.groups
        steps = int(groups["steps"][g])
        trials = max(RARELY, min(RARELY << min(self._failed[g], 40), steps // TRIED))
        again = steps + int(trials * (TRIED * other.cost / stays.cost + LOST))
        explicit = stays.method == self._first[g]
        groups["watched"][g] = int(explicit)
        groups["review"][g] = _NEVER if explicit else again
        groups["patience"][g], groups["alarm"][g] = again, SHORTER * stays.size

    def _lately(self, simulation: Simulation, wiring: Wiring, g: int) -> Lately:
        """Of the group's latest steps."""
        method = self.methods[g]
        stride, count = int(simulation.groups["stride"][g]), int(simulation.groups["count"][g])
        sizes = simulation.tracks.array(g)[: count * stride].reshape(count, stride)[-TRIED // 2 :, 3]
        pieces = simulation.engine.program_for(wiring.form, method).pieces[wiring.form, method]
        size = float(sizes.mean())
        return Lately(method, size, choice.step_cost(method, simulation.probe(wiring, g, size, pieces)))

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
