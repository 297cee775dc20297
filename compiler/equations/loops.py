"""Loops: nothing needs its own value.

In: a `Flat` model. Checked: definitions and derivatives do not need themselves (E506), initial values neither (E507), and no initial value needs a
derivative (E510). The closed path that is shown is a shortest one, through the user's own names and lines. In arrays of agents, where one element may
use another, what looks like a loop is followed element by element, on whole columns.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from hierc.compiler.arrays.columns import Index, Integers, expanded
from hierc.compiler.arrays.elements import distinct, slots_of, spelled
from hierc.compiler.cascade.graphs import components
from hierc.compiler.collector import Collector
from hierc.compiler.equations.errors import AlgebraicLoop, DerivativeInInitialValue, InitialLoop, LoopStep
from hierc.compiler.expression import Expr, Gather, Local, Rate, State
from hierc.compiler.structure.flat import Flat, leaves
from hierc.grammar.source import Span


def check_loops(flat: Flat, problems: Collector) -> None:
    """Report every loop of equations and of initial values."""
    continuous = _Graph(flat, [s.rate for s in flat.states], Rate, "'")
    loops = continuous.loops()
    for steps in loops:
        problems.add(AlgebraicLoop(steps[0].span, steps=steps))
    if loops:
        return
    initial = _Graph(flat, [s.initial for s in flat.states], State, "")
    for steps in initial.loops():
        own = {state.name for state in flat.states}
        shown = tuple(s for s in steps if s.user.rpartition(".")[2] in own) or steps
        problems.add(InitialLoop(steps[0].span, steps=shown))
    _check_no_derivatives(flat, problems)


@dataclass(frozen=True, slots=True)
class _Use:
    """An edge: elements of some vertex use those of vertex `used` at `span`. `at`: what each of them gathers; None for the same, or the only one."""

    used: int
    span: Span
    at: Index | None = None


#: A vertex and one of its elements.
_Place = tuple[int, int]


class _Graph:
    """Which scalars need which. Vertices: the definitions, then the states, each with one expression (its derivative or initial value).

    `counted` is the leaf that stands for a state's vertex, `mark` what follows a state's name.
    """

    def __init__(
        self, flat: Flat, expressions: Sequence[Expr], counted: type[State] | type[Rate], mark: str
    ) -> None:
        self._flat = flat
        self._counted = counted
        self._kind = "state" if counted is State else "rate"
        self._mark = mark
        self._first_state = len(flat.definitions)
        self._domains = [d.domain for d in flat.definitions]
        self._domains += [flat.nodes[s.node].instance.domain for s in flat.states]
        self._firsts = [d.first for d in flat.definitions] + [s.first for s in flat.states]
        self._state_firsts = np.array([s.first for s in flat.states], np.int64)
        self._algebraic = [i for i, d in enumerate(flat.definitions) if d.owner is not None]
        self._algebraic_firsts = np.array([flat.definitions[i].first for i in self._algebraic], np.int64)
        self._edges = [self._uses(d.value, d.span) for d in flat.definitions]
        self._edges += [self._uses(e, s.rate_span) for e, s in zip(expressions, flat.states, strict=True)]

    def _uses(self, expr: Expr, span: Span) -> list[_Use]:
        found: list[_Use] = []
        for leaf in leaves(expr):
            if isinstance(leaf, Local):
                found.append(_Use(leaf.index, leaf.span or span))
            elif isinstance(leaf, self._counted):
                found.append(_Use(self._first_state + leaf.index, leaf.span or span))
            elif isinstance(leaf, Gather) and leaf.kind in (self._kind, "algebraic"):
                found += self._gathered(leaf, leaf.span or span)
        return found

    def _gathered(self, leaf: Gather, span: Span) -> list[_Use]:
        """The edges to scalars of other elements, one for each vertex that has some of them."""
        algebraic = leaf.kind == "algebraic"
        firsts = self._algebraic_firsts if algebraic else self._state_firsts
        slots = slots_of(firsts, expanded(leaf.at, 1))
        vertices = (
            self._algebraic[slot] if algebraic else self._first_state + slot
            for slot in distinct(slots).tolist()
        )
        return [_Use(vertex, span, leaf.at) for vertex in vertices]

    def loops(self) -> list[tuple[LoopStep, ...]]:
        """One closed path for each set of scalars that need each other."""
        parts = components([[use.used for use in uses] for uses in self._edges])
        cyclic = [p for p in parts if len(p) > 1 or any(use.used == p[0] for use in self._edges[p[0]])]
        return [self._steps(cycle) for part in cyclic for cycle in self._cycles(part)]

    def _cycles(self, part: Sequence[int]) -> Iterator[list[tuple[_Place, Span]]]:
        """The closed paths of elements in a set of vertices that need each other: a shortest one for each set of elements that do."""
        offsets = dict(
            zip(part, np.cumsum([0, *(self._domains[v].count for v in part)]).tolist(), strict=False)
        )
        uses, used = self._element_edges(part, offsets)
        total = sum(self._domains[v].count for v in part)
        graph = csr_array((np.ones(len(uses), np.int8), (uses, used)), shape=(total, total))
        _, labels = connected_components(graph, directed=True, connection="strong")
        large = np.flatnonzero(np.bincount(labels) > 1).tolist()
        starts = [int(np.argmax(labels == label)) for label in large]
        starts += [
            int(uses[k]) for k in np.flatnonzero(uses == used).tolist() if labels[uses[k]] not in large
        ]
        places = [(v, element) for v in part for element in range(self._domains[v].count)] if starts else []
        for start in starts:
            yield self._shortest_cycle(
                places[start], {places[k] for k in np.flatnonzero(labels == labels[start]).tolist()}
            )

    def _element_edges(self, part: Sequence[int], offsets: Mapping[int, int]) -> tuple[Integers, Integers]:
        """The edges inside a set of vertices, between elements numbered through them."""
        uses: list[Integers] = [np.zeros(0, np.int64)]
        used: list[Integers] = [np.zeros(0, np.int64)]
        for vertex in part:
            for use in self._edges[vertex]:
                if use.used in offsets:
                    at = self._elements(vertex, use)
                    there = np.flatnonzero(at >= 0)
                    uses.append(offsets[vertex] + there)
                    used.append(offsets[use.used] + at[there])
        return np.concatenate(uses), np.concatenate(used)

    def _elements(self, vertex: int, use: _Use) -> Integers:
        """For each element of a vertex, the element that it uses; -1 for none."""
        count = self._domains[vertex].count
        if use.at is not None:
            own = expanded(use.at, count) - self._firsts[use.used]
            return np.where((own >= 0) & (own < self._domains[use.used].count), own, -1)
        return np.arange(count) if self._domains[use.used].count > 1 else np.zeros(count, np.int64)

    def _shortest_cycle(self, start: _Place, inside: set[_Place]) -> list[tuple[_Place, Span]]:
        """A shortest closed path through the first of some elements that need each other: each with the place where it uses the next."""
        came_from: dict[_Place, tuple[_Place, Span]] = {}
        queue = deque([start])
        while start not in came_from:
            here = queue.popleft()
            for use in self._edges[here[0]]:
                there = use.used, int(self._elements(here[0], use)[here[1]])
                if there in inside and there not in came_from:
                    came_from[there] = here, use.span
                    queue.append(there)
        path: list[tuple[_Place, Span]] = []
        here = start
        while not path or here != start:
            here, span = came_from[here]
            path.append((here, span))
        return path[::-1]

    def _steps(self, cycle: Sequence[tuple[_Place, Span]]) -> tuple[LoopStep, ...]:
        """The closed path without what the compiler put in, starting at its first place in the text."""
        shown = [(self._name(v), span) for v, span in cycle if not self._hidden(v[0])]
        shown = shown or [(self._name(v), span) for v, span in cycle]
        first = min(range(len(shown)), key=lambda i: (shown[i][1].file.name, shown[i][1].start))
        shown = shown[first:] + shown[:first]
        following = shown[1:] + shown[:1]
        return tuple(
            LoopStep(name, used, span) for (name, span), (used, _) in zip(shown, following, strict=True)
        )

    def _hidden(self, vertex: int) -> bool:
        return vertex < self._first_state and self._flat.definitions[vertex].hidden

    def _name(self, place: _Place) -> str:
        vertex, element = place
        if vertex < self._first_state:
            path = self._flat.definitions[vertex].path
        else:
            path = _state_path(self._flat, vertex - self._first_state) + self._mark
        return spelled(path, [int(column[element]) for column in self._domains[vertex].indices])


def _state_path(flat: Flat, index: int) -> str:
    state = flat.states[index]
    return flat.nodes[state.node].instance.named(state.name)


def _check_no_derivatives(flat: Flat, problems: Collector) -> None:
    """No initial value uses a derivative, not even by way of a `let`."""
    for index, state in enumerate(flat.states):
        seen: set[int] = set()
        waiting = [state.initial]
        while waiting:
            for leaf in leaves(waiting.pop()):
                if isinstance(leaf, Rate) or (isinstance(leaf, Gather) and leaf.kind == "rate"):
                    used = _state_path(flat, _slot(flat, leaf))
                    place = leaf.span or state.span
                    problems.add(DerivativeInInitialValue(place, name=_state_path(flat, index), used=used))
                elif isinstance(leaf, Local) and leaf.index not in seen:
                    seen.add(leaf.index)
                    waiting.append(flat.definitions[leaf.index].value)


def _slot(flat: Flat, leaf: Rate | Gather) -> int:
    """The state that a derivative is of, in one of the elements that use it."""
    if isinstance(leaf, Rate):
        return leaf.index
    number = leaf.at if isinstance(leaf.at, int) else int(leaf.at.values[0])
    return bisect_right([s.first for s in flat.states], number) - 1
