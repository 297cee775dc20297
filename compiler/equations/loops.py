"""Loops: nothing needs its own value.

In: a `Flat` model. Checked: definitions and derivatives do not need themselves (E506), initial values neither (E507), and no initial value needs a
derivative (E510). The closed path that is shown is a shortest one, through the user's own names and lines.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from hierc.compiler.cascade.graphs import components
from hierc.compiler.collector import Collector
from hierc.compiler.equations.errors import AlgebraicLoop, DerivativeInInitialValue, InitialLoop, LoopStep
from hierc.compiler.expression import Expr, Local, Rate, State
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
    """An edge: some vertex uses vertex `used` at `span`."""

    used: int
    span: Span


class _Graph:
    """Which scalars need which. Vertices: the definitions, then the states, each with one expression (its derivative or initial value).

    `counted` is the leaf that stands for a state's vertex, `mark` what follows a state's name.
    """

    def __init__(
        self, flat: Flat, expressions: Sequence[Expr], counted: type[State] | type[Rate], mark: str
    ) -> None:
        self._flat = flat
        self._counted = counted
        self._mark = mark
        self._first_state = len(flat.definitions)
        self._edges = [self._uses(d.value, d.span) for d in flat.definitions]
        self._edges += [self._uses(e, s.rate_span) for e, s in zip(expressions, flat.states, strict=True)]

    def _uses(self, expr: Expr, span: Span) -> list[_Use]:
        found: list[_Use] = []
        for leaf in leaves(expr):
            if isinstance(leaf, Local):
                found.append(_Use(leaf.index, leaf.span or span))
            elif isinstance(leaf, self._counted):
                found.append(_Use(self._first_state + leaf.index, leaf.span or span))
        return found

    def loops(self) -> list[tuple[LoopStep, ...]]:
        """One closed path for each set of scalars that need each other."""
        parts = components([[use.used for use in uses] for uses in self._edges])
        cyclic = [p for p in parts if len(p) > 1 or any(use.used == p[0] for use in self._edges[p[0]])]
        return [self._steps(self._shortest_cycle(part)) for part in cyclic]

    def _shortest_cycle(self, part: Sequence[int]) -> list[tuple[int, Span]]:
        """A shortest closed path through the first vertex of a strongly connected part: vertices with the places where they use the next."""
        start, inside = part[0], set(part)
        came_from: dict[int, tuple[int, Span]] = {}
        queue = deque([start])
        while start not in came_from:
            here = queue.popleft()
            for use in self._edges[here]:
                if use.used in inside and use.used not in came_from:
                    came_from[use.used] = (here, use.span)
                    queue.append(use.used)
        path: list[tuple[int, Span]] = []
        here = start
        while not path or here != start:
            here, span = came_from[here]
            path.append((here, span))
        return path[::-1]

    def _steps(self, cycle: Sequence[tuple[int, Span]]) -> tuple[LoopStep, ...]:
        """The closed path without what the compiler put in, starting at its first place in the text."""
        shown = [(self._name(v), span) for v, span in cycle if not self._hidden(v)]
        shown = shown or [(self._name(v), span) for v, span in cycle]
        first = min(range(len(shown)), key=lambda i: (shown[i][1].file.name, shown[i][1].start))
        shown = shown[first:] + shown[:first]
        following = shown[1:] + shown[:1]
        return tuple(
            LoopStep(name, used, span) for (name, span), (used, _) in zip(shown, following, strict=True)
        )

    def _hidden(self, vertex: int) -> bool:
        return vertex < self._first_state and self._flat.definitions[vertex].hidden

    def _name(self, vertex: int) -> str:
        if vertex < self._first_state:
            return self._flat.definitions[vertex].path
        return _state_path(self._flat, vertex - self._first_state) + self._mark


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
                if isinstance(leaf, Rate):
                    used = _state_path(flat, leaf.index)
                    place = leaf.span or state.span
                    problems.add(DerivativeInInitialValue(place, name=_state_path(flat, index), used=used))
                elif isinstance(leaf, Local) and leaf.index not in seen:
                    seen.add(leaf.index)
                    waiting.append(flat.definitions[leaf.index].value)
