"""A generated module as one system of equations, in plain Python: initial values, right-hand side, Jacobian, observed variables.

This is the exact oracle of what the kernel integrates, and what users hand to other solvers. Where CPython raises on a domain error (1/0.0,
math.sqrt(-1.0)) the values concerned are NaN.

A *world* is a list of all states, in the order of the state vector, and after them all outs, element by element: whatever an element can read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import ieee
from hierc.runtime.columns import distinct
from hierc.runtime.contract import Class, Plan
from hierc.runtime.elements import Elements, expand, expanded, index_table, numbered, spread

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_NAN = float("nan")
_FAULTS = (ZeroDivisionError, ValueError, OverflowError)
#: Stands for the discrete variables, of which there are none yet.
NO_DISCRETE: list[float] = []


@dataclass(frozen=True)
class System:
    """A plan with values for all its parameters. Vectors of states follow `state_names`: group by group, element by element."""

    plan: Plan
    parameters: Floats
    expansion: Elements | None = None  # of the plan, where it is known

    @cached_property
    def elements(self) -> Elements:
        """The plan's tables, expanded."""
        return self.expansion or expand(self.plan)

    @cached_property
    def offsets(self) -> list[int]:
        """Where each element's states begin in the state vector."""
        found: list[int] = self.elements.offsets.tolist()
        return found

    @property
    def size(self) -> int:
        """Number of states."""
        return int(self.elements.group_offsets[-1])

    def kind(self, element: int) -> Class:
        """The class of an element."""
        return self.elements.kind(element)

    # ---- what depends on parameters alone -----------------------------------------------------------

    @cached_property
    def values(self) -> tuple[list[float], ...]:
        """p of each element: what depends on parameters alone. Elements with equal parameters share it."""
        found: list[list[float]] = []
        known: dict[tuple[int, bytes], list[float]] = {}
        for block in self.elements.blocks:
            kind = self.plan.classes[block.kind]
            rows = self.parameters[block.parameters]
            for row in rows:
                key = (block.kind, row.tobytes())
                if key not in known:
                    known[key] = [_NAN] * kind.values
                    call(kind.fill, row.tolist(), known[key])
                found.append(known[key])
        return tuple(found)

    def values_of(self, elements: Integers) -> Floats:
        """The values of some elements, laid end to end."""
        lengths = np.fromiter(map(len, self.values), np.int64)
        firsts = np.cumsum(lengths) - lengths
        return np.asarray(self.all_values[spread(firsts[elements], lengths[elements])])

    @cached_property
    def all_values(self) -> Floats:
        """The values of all elements, laid end to end."""
        return np.fromiter(chain.from_iterable(self.values), np.float64)

    @cached_property
    def nominal(self) -> Floats:
        """Error scale of each state."""
        known: dict[tuple[int, int], list[float]] = {}
        found: list[list[float]] = []
        kinds = self._kinds
        for element in self.elements.order.tolist():
            key = (kinds[element], id(self.values[element]))
            if key not in known:
                kind = self.plan.classes[key[0]]
                known[key] = [_NAN] * len(kind.states)
                call(kind.nominal, self.values[element], known[key])
            found.append(known[key])
        return np.fromiter(chain.from_iterable(found), np.float64)

    # ---- names --------------------------------------------------------------------------------------

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of all scalar states, as results and files have them; not those of variables elsewhere that only repeat a state."""
        names = [""] * self.size
        for v in sorted(self.plan.variables, key=lambda v: -v.path.count(".")):
            owner, dot, own = v.path.rpartition(".")
            rows = index_table(v.indices, v.count)
            for (element, what, index), place in zip(v.elements, np.ndindex(v.shape), strict=True):
                if what != "state" or v.access == "read":
                    continue
                subscript = f"[{','.join(str(i + 1) for i in place)}]" if place else ""
                elements, states = expanded(element, v.count), expanded(index, v.count)
                fits = self._at_home(elements, states, owner + dot, own + subscript)
                at = self.elements.offsets[elements] + states
                for k, row in zip(at[fits].tolist(), rows[fits].tolist(), strict=True):
                    names[k] = names[k] or numbered(v.path, row) + subscript
        return tuple(names)

    def _at_home(self, elements: Integers, states: Integers, owner: str, name: str) -> NDArray[np.bool_]:
        """Whether each of these states is in an agent whose path begins with `owner`, and is called `name` there."""
        fits = np.zeros(len(elements), np.bool_)
        blocks = self.elements.block[elements]
        for b in distinct(blocks).tolist():
            block = self.elements.blocks[b]
            if f"{block.path}.".startswith(owner):
                names = np.array([own == name for own in self.plan.classes[block.kind].states], np.bool_)
                fits[blocks == b] = names[states[blocks == b]]
        return fits

    def state_at(self, k: int) -> tuple[str, str]:
        """Name of scalar state k of the state vector, and where its equation stands: `line 12`, `wheels.hier, line 12`; "" if that is not known."""
        place = int(np.searchsorted(self.elements.group_offsets, k, "right")) - 1
        element = next(
            e for e in reversed(self.elements.nodes_of(place)) if self.offsets[e] <= k and self.kind(e).states
        )
        kind, index = self.kind(element), k - self.offsets[element]
        line = f"line {kind.lines[index]}" if kind.lines[index] else ""
        return self.state_names[k] or kind.states[index], ", ".join(filter(None, (kind.file, line)))

    # ---- the equations ------------------------------------------------------------------------------

    def initial(self, t: float) -> Floats:
        """Initial values of all states."""
        elements, world = self.elements, self.world(np.full(self.size, _NAN))
        order = self.plan.start_order
        turns = range(elements.count) if order is None else expanded(order, elements.count).tolist()
        for _ in range(self.plan.start_passes):
            for element, part in self._calls:
                self._evaluate(element, part, t, world)
            for element in turns:
                kind = self.plan.classes[self._kinds[element]]
                if kind.states:
                    own = [_NAN] * len(kind.states)
                    call(kind.start, t, self._inputs(element, world), self.values[element], own)
                    first = self.offsets[element]
                    world[first : first + len(own)] = own
                for part in range(len(kind.parts)):
                    self._evaluate(element, part, t, world)
        return np.array(world[: self.size])

    def rhs(self, t: float, x: Sequence[float] | Floats) -> Floats:
        """Derivatives (n,) of the states x (n,)."""
        world = self.world_at(t, x)
        result = [_NAN] * self.size
        for element in self.elements.order.tolist():
            kind = self.plan.classes[self._kinds[element]]
            dx = [_NAN] * len(kind.states)
            first = self.offsets[element]
            own = world[first : first + len(dx)]
            call(kind.rhs, t, own, self._inputs(element, world), NO_DISCRETE, self.values[element], dx)
            result[first : first + len(dx)] = dx
        return np.array(result)

    def jacobian(self, t: float, x: Sequence[float] | Floats) -> Floats:
        """d rhs/d x, shape (n, n), from the elements' own derivatives by the chain rule."""
        return self.jacobian_of(self.elements.order.tolist(), t, x)

    def jacobian_of(self, nodes: Sequence[int], t: float, x: Sequence[float] | Floats) -> Floats:
        """d rhs/d x of some elements' states by those states alone, in the order of `nodes`; x is the whole state vector."""
        calls = self.calls_for(nodes)
        world = self.world(x)
        self.evaluate(calls, t, world)
        ends = np.cumsum([0, *(len(self.kind(n).states) for n in nodes)])
        places = dict(zip(nodes, ends.tolist(), strict=False))
        size = int(ends[-1])
        through: dict[tuple[int, int], Floats] = {}
        result = np.zeros((size, size))
        for node, part in [*calls, *((n, -1) for n in nodes)]:
            kind = self.kind(node)
            n = len(kind.states)
            wanted = range(n) if part < 0 else [n + out for out in kind.parts[part].outs]
            rows = {row: np.zeros(size) for row in wanted}
            sources = self.elements.read_by(node, -1)
            for (row, column), entry in zip(kind.pattern, self._entries(node, t, world), strict=True):
                if row not in rows:
                    continue
                source, what, index = (node, "state", column) if column < n else sources[column - n]
                if what == "out":
                    rows[row] += entry * through[source, index]
                elif source in places:
                    rows[row][places[source] + index] += entry
            for row, values in rows.items():
                if part < 0:
                    result[places[node] + row] = values
                else:
                    through[node, row - n] = values
        return result

    def _entries(self, element: int, t: float, world: list[float]) -> list[float]:
        """Nonzeros of the Jacobian of an element's class."""
        kind, first = self.kind(element), self.offsets[element]
        entries = [_NAN] * len(kind.pattern)
        own, inputs = world[first : first + len(kind.states)], self._inputs(element, world)
        call(kind.jac, t, own, inputs, NO_DISCRETE, self.values[element], entries)
        return entries

    def observe(self, t: float, world: list[float], nodes: Iterable[int]) -> dict[int, list[float]]:
        """All observed variables of some elements, in a world with what they read (see `calls_for`)."""
        result = {}
        for element in nodes:
            kind, first = self.kind(element), self.offsets[element]
            result[element] = [_NAN] * kind.observed
            if kind.observe is not None:
                own, inputs = world[first : first + len(kind.states)], self._inputs(element, world)
                call(kind.observe, t, own, inputs, NO_DISCRETE, self.values[element], result[element])
        return result

    # ---- outs ---------------------------------------------------------------------------------------

    def world(self, x: Sequence[float] | Floats) -> list[float]:
        """The world at states x, its outs not yet known."""
        return [*np.asarray(x, np.float64).tolist(), *[_NAN] * int(self.elements.outs[-1])]

    def world_at(self, t: float, x: Sequence[float] | Floats) -> list[float]:
        """The world at time t and states x."""
        world = self.world(x)
        self.evaluate(self._calls, t, world)
        return world

    def outs_of(self, element: int, world: list[float]) -> list[float]:
        """An element's outs in a world."""
        first = self._slots[element]
        return world[first : first + self.kind(element).outs]

    def evaluate(self, calls: Iterable[tuple[int, int]], t: float, world: list[float]) -> None:
        """Put the outs of some calls (element, part) into a world."""
        for element, part in calls:
            self._evaluate(element, part, t, world)

    def _evaluate(self, element: int, part: int, t: float, world: list[float]) -> None:
        kind, first = self.plan.classes[self._kinds[element]], self.offsets[element]
        made = kind.parts[part]
        y = [_NAN] * kind.outs
        own, inputs = world[first : first + len(kind.states)], self._inputs(element, world)
        call(made.function, t, own, inputs, NO_DISCRETE, self.values[element], y)
        slot = self._slots[element]
        for out in made.outs:
            world[slot + out] = y[out]

    def calls_for(self, nodes: Iterable[int]) -> list[tuple[int, int]]:
        """Calls (element, part), in order, that make the outs which some elements read, and those that they need."""
        elements = self.elements
        if not elements.outs[-1]:
            return []
        wanted = [(e, k) for n in nodes for e, what, k in elements.read_by(n, -1) if what == "out"]
        return elements.order_parts(wanted, lambda _: True)

    @cached_property
    def _calls(self) -> list[tuple[int, int]]:
        """Calls that make all outs: first those that read none."""
        elements = self.elements
        first: dict[tuple[int, int], None] = {}
        wanted: list[tuple[int, int]] = []
        for block in elements.blocks:
            for k, part in enumerate(self.plan.classes[block.kind].parts):
                own = range(block.first, block.first + block.count)
                if any(block.sources[i].what == "out" for i in part.inputs):
                    wanted += [(e, part.outs[0]) for e in own if part.outs]
                else:
                    first |= dict.fromkeys((e, k) for e in own)
        rest = elements.order_parts(wanted, lambda _: True)
        return [*first, *(call for call in rest if call not in first)]

    @cached_property
    def _kinds(self) -> list[int]:
        kinds = np.array([b.kind for b in self.elements.blocks] or [0], np.int64)
        found: list[int] = kinds[self.elements.block].tolist()
        return found

    @cached_property
    def _slots(self) -> list[int]:
        """Where each element's outs begin in a world."""
        found: list[int] = (self.size + self.elements.outs).tolist()
        return found

    @cached_property
    def reads(self) -> list[list[int]]:
        """Where in a world each element finds its inputs."""
        elements, found = self.elements, list[list[int]]()
        firsts = {"state": elements.offsets, "out": self.size + elements.outs}
        for block in elements.blocks:
            columns = [firsts[s.what][s.elements] + s.index for s in block.sources]
            found += np.stack(columns, axis=1).tolist() if columns else [[]] * block.count
        return found

    def _inputs(self, element: int, world: list[float]) -> list[float]:
        return [world[k] for k in self.reads[element]]


def call(function: Callable[..., None], *args: Any) -> None:
    """Call a generated function; what it could not compute is NaN."""
    try:
        function(*args)
    except _FAULTS:
        ieee.call(function, *args)
