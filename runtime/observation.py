"""Values of variables at any times, from the trajectories of a run: states from their polynomials, what is algebraic by the model's own functions.

Only what is asked for is computed, and what that needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct
from hierc.runtime.contract import Plan, Variable
from hierc.runtime.elements import expanded
from hierc.runtime.paths import Catalogue, Selection
from hierc.runtime.system import System
from hierc.runtime.trajectory import Trajectories

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Evaluations for each function, on average, from which on machine code is worth its compilation.
MANY = 10_000


def catalogue(plan: Plan) -> Catalogue:
    """The names of a plan's variables."""
    entries = [(v.path, v.count, v.indices) for v in plan.variables]
    return Catalogue("unknown variable", entries, [v.shape for v in plan.variables])


def evaluate(
    system: System, trajectories: Trajectories, names: Sequence[str], t: Floats
) -> dict[str, Floats]:
    """Values (len(t), *shape) of variables by name, in their declared units. Raises PathError."""
    known = catalogue(system.plan)
    wanted = [_Wanted(system, known.find(name)) for name in names]
    positions = np.concatenate([np.zeros(0, np.int64), *(w.places[w.is_state] for w in wanted)])
    states = trajectories.states(positions, t)
    elements = np.concatenate([np.zeros(0, np.int64), *(w.elements[~w.is_state] for w in wanted)])
    observed = _Observed(system, trajectories, distinct(elements), t)
    found = {}
    first = 0
    for name, w in zip(names, wanted, strict=True):
        values = np.empty((len(t), *w.places.shape))
        count = int(w.is_state.sum())
        values[:, w.is_state] = states[:, first : first + count]
        values[:, ~w.is_state] = observed.columns(w.elements[~w.is_state], w.places[~w.is_state])
        first += count
        found[name] = values.reshape((len(t), *w.shape)) / w.scale
    return found


class _Wanted:
    """The scalars of a selection, (elements, scalars of each): where each is found. `places` are positions in the state vector, or numbers of observed
    variables.
    """

    def __init__(self, system: System, selection: Selection) -> None:
        variables = system.plan.variables
        named = selection.named
        entry, row = named.entry[selection.chosen], named.row[selection.chosen]
        variable = variables[entry[0]]
        size = (len(entry), len(variable.elements))
        self.elements, self.places = np.zeros(size, np.int64), np.zeros(size, np.int64)
        self.is_state = np.zeros(size, np.bool_)
        self.shape, self.scale = selection.shape + variable.shape, variable.scale
        for k in distinct(entry).tolist():
            self._put(system, variables[k], entry == k, row[entry == k])

    def _put(self, system: System, variable: Variable, own: NDArray[np.bool_], rows: Integers) -> None:
        for scalar, (elements, what, index) in enumerate(variable.elements):
            element = expanded(elements, variable.count)[rows]
            place = expanded(index, variable.count)[rows]
            if what == "state":
                place = place + system.elements.offsets[element]
            self.elements[own, scalar], self.places[own, scalar] = element, place
            self.is_state[own, scalar] = what == "state"


class _Observed:
    """The observed variables of some elements (in ascending order) at all times."""

    def __init__(self, system: System, trajectories: Trajectories, elements: Integers, t: Floats) -> None:
        counts = np.array([system.kind(int(e)).observed for e in elements], np.int64)
        self.elements, self.firsts = elements, np.cumsum(counts) - counts
        self.table = np.empty((len(t), int(counts.sum())))
        if len(elements):
            self._compute(system, trajectories, t)

    def _compute(self, system: System, trajectories: Trajectories, t: Floats) -> None:
        nodes: list[int] = self.elements.tolist()
        calls = system.calls_for(nodes)
        if worth := (len(calls) + len(nodes)) * len(t) // MANY:
            from hierc.runtime.batch import batch

            many = batch(system, calls, nodes, worth)
            if many is not None:
                self.table = many.observe(trajectories, t)
                return
        needed = _states_of(system, [*nodes, *(e for e, _ in calls)])
        states = trajectories.states(needed, t)
        world, positions = system.world(np.full(system.size, np.nan)), needed.tolist()
        for k, time in enumerate(t.tolist()):
            for position, value in zip(positions, states[k].tolist(), strict=True):
                world[position] = value
            system.evaluate(calls, time, world)
            found = system.observe(time, world, nodes)
            self.table[k] = [value for n in nodes for value in found[n]]

    def columns(self, elements: Integers, numbers: Integers) -> Floats:
        """The observed variables (len(t), scalars) of these numbers."""
        return self.table[:, self.firsts[np.searchsorted(self.elements, elements)] + numbers]


def _states_of(system: System, nodes: Sequence[int]) -> Integers:
    """Positions of the states that some elements have or read."""
    own = [k for n in nodes for k in range(system.offsets[n], system.offsets[n] + len(system.kind(n).states))]
    read = [k for n in nodes for k in system.reads[n] if k < system.size]
    return distinct(np.array([*own, *read], np.int64))
