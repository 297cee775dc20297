"""Values of variables at any times, from the trajectories of a run: states from their polynomials, what is algebraic by the model's own functions.

Only what is asked for is computed, and what that needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct
from hierc.runtime.contract import Plan
from hierc.runtime.elements import Elements, expanded
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


class Variables:
    """The variables of a plan by name, and where they are found. What was asked for once need not be looked up again."""

    def __init__(self, elements: Elements) -> None:
        self.elements = elements
        self.catalogue = catalogue(elements.plan)
        self._found: dict[str, _Wanted] = {}

    def find(self, name: str) -> _Wanted:
        """Where the scalars of a variable are. Raises PathError."""
        if name not in self._found:
            self._found[name] = _Wanted(self.elements, self.catalogue.find(name))
        return self._found[name]


def evaluate(
    variables: Variables, system: System, trajectories: Trajectories, names: Sequence[str], t: Floats
) -> dict[str, Floats]:
    """Values (len(t), *shape) of variables by name, in their declared units. Raises PathError."""
    wanted = [variables.find(name) for name in names]
    none = np.zeros(0, np.int64)
    states = trajectories.states(np.concatenate([none, *(w.states for w in wanted)]), t)
    counts = np.array([len(w.states) for w in wanted], np.int64)
    states /= np.repeat(np.array([w.scale for w in wanted]), counts)
    elements = distinct(np.concatenate([none, *(w.elements for w in wanted)]))
    observed = _Observed(system, trajectories, elements, t)
    found = {}
    first = 0
    for name, w in zip(names, wanted, strict=True):
        values = states[:, first : first + len(w.states)]
        first += len(w.states)
        if len(w.elements):
            own, values = values, np.empty((len(t), *w.is_state.shape))
            values[:, w.is_state] = own
            values[:, ~w.is_state] = observed.columns(w.elements, w.numbers) / w.scale
        found[name] = values.reshape((len(t), *w.shape))
    return found


class _Wanted:
    """The scalars of a selection: which of them (elements, scalars of each) are states; of those, the positions in the state vector, `states`; of
    the others, the `elements` and the `numbers` among what is observed there.
    """

    def __init__(self, elements: Elements, selection: Selection) -> None:
        variables = elements.plan.variables
        named = selection.named
        entry, row = named.entry[selection.chosen], named.row[selection.chosen]
        variable = variables[entry[0]]
        size = (len(entry), len(variable.elements))
        self.shape, self.scale = selection.shape + variable.shape, variable.scale
        self.is_state = np.zeros(size, np.bool_)
        owners, places = np.zeros(size, np.int64), np.zeros(size, np.int64)
        for k in distinct(entry).tolist():
            own, rows = entry == k, row[entry == k]
            for scalar, (which, what, index) in enumerate(variables[k].elements):
                owners[own, scalar] = expanded(which, variables[k].count)[rows]
                places[own, scalar] = expanded(index, variables[k].count)[rows]
                self.is_state[own, scalar] = what == "state"
        self.states = (elements.offsets[owners] + places)[self.is_state]
        self.elements, self.numbers = owners[~self.is_state], places[~self.is_state]


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
