"""Scheduling: values become straight-line steps and `if`s.

In: the values a function has to store. Out: a `Program`. Guaranteed: every step comes after what it uses; a value stands outside an `if` only
if it is needed whichever branch is taken, so that a root or quotient guarded by a condition is never evaluated outside its guard;
choices on the same condition share one `if` where their order allows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from hierc.compiler.symbolic.errors import TooDeep, TooLarge
from hierc.compiler.symbolic.graph import Depends, Graph, Value
from hierc.grammar.problems import ModelError
from hierc.grammar.source import Span

#: `if`s inside `if`s in one function: Python reads at most 100 levels of indentation.
DEPTH = 64
#: Steps of one function.
STEPS = 500_000

#: Cost of an operation in flops; every other elementary function costs 20.
FLOPS: Mapping[str, int] = {
    **dict.fromkeys(("add", "sub", "mul", "div", "abs", "sign", "min", "max", "floor", "ceil", "round"), 1),
    **dict.fromkeys(("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not"), 1),
    "neg": 0,  # a sign bit, mostly absorbed by the operation that uses it
    **dict.fromkeys(("element", "det"), 0),
}
ELEMENTARY = 20


@dataclass(frozen=True, slots=True)
class Compute:
    """Evaluate one operation."""

    value: int


@dataclass(frozen=True, slots=True)
class Branch:
    """An `if`: `values` are the choices it decides; each gets what its taken branch (`then` or `other`) computed."""

    condition: int
    values: tuple[int, ...]
    then: Block
    other: Block


@dataclass(frozen=True, slots=True)
class Block:
    """Steps in order, then the values they were made for, one for each of `Branch.values`."""

    steps: tuple[Compute | Branch, ...]
    results: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Program:
    """The body of a function: its steps, then stores of `results` to entries `targets` of the output array."""

    block: Block
    targets: tuple[int, ...]

    @property
    def stores(self) -> tuple[tuple[int, int], ...]:
        """What is stored, as (entry, value)."""
        return tuple(zip(self.targets, self.block.results, strict=True))


def schedule(graph: Graph, stores: Sequence[tuple[int, int]], span: Span) -> Program:
    """A program that stores values: `stores` has (entry, value). `span` is the text to blame when it gets too large."""
    graph.check(value for _, value in stores)
    block = _Scheduler(graph, span).block([value for _, value in stores], frozenset(), 0)
    return Program(block, tuple(entry for entry, _ in stores))


def operations(graph: Graph, roots: Iterable[int]) -> int:
    """Flops of everything the roots are made of that changes during a run, all branches counted."""
    changing = (v for v in graph.reach(roots) if graph.values[v].args and graph.depends[v] & Depends.RUN)
    return sum(cost(graph.values[v]) for v in changing)


def cost(value: Value) -> int:
    """Flops of one operation."""
    n = value.size
    match value.op:
        case "factor":  # sizes of rows; the search for pivots; multipliers; updates
            return n * n + n * (n - 1) + n * (n - 1) // 2 + n * (n - 1) * (2 * n - 1) // 3
        case "solve":
            return 2 * n * n - n
        case op:
            return FLOPS.get(op, ELEMENTARY)


def flops(graph: Graph, block: Block) -> int:
    """Operations of a block, the costlier branch of each `if`."""
    total = 0
    for step in block.steps:
        if isinstance(step, Branch):
            total += max(flops(graph, step.then), flops(graph, step.other))
        else:
            total += cost(graph.values[step.value])
    return total


class _Scheduler:
    def __init__(self, graph: Graph, span: Span) -> None:
        self._graph = graph
        self._span = span
        self._steps = 0

    def block(self, results: Sequence[int], done: Collection[int], depth: int) -> Block:
        """Steps that compute `results` where `done` is already there."""
        graph = self._graph
        if depth > DEPTH:
            raise ModelError([TooDeep(self._span, DEPTH)])
        todo = sorted(v for v in graph.always(results) if v not in done and not graph.is_leaf(v))
        self._steps += len(todo)
        if self._steps > STEPS:
            raise ModelError([TooLarge(self._span, "scheduling", STEPS)])
        ready = {*done}
        waiting: dict[
            int, frozenset[int]
        ] = {}  # choices put off until somebody needs them, with what they need
        here = {*done, *todo}
        steps: list[Compute | Branch] = []
        for v in todo:
            if graph.values[v].op == "choose":
                waiting[v] = self._needs(v, here)
            else:
                self._settle([a for a in graph.values[v].args if a in waiting], waiting, ready, steps, depth)
                steps.append(Compute(v))
                ready.add(v)
        self._settle(list(waiting), waiting, ready, steps, depth)
        return Block(tuple(steps), tuple(results))

    def _needs(self, choice: int, here: Collection[int]) -> frozenset[int]:
        """The values of this scope that a choice uses, in its condition or anywhere in its branches."""
        found: set[int] = set()
        seen: set[int] = set()
        stack = list(self._graph.values[choice].args)
        while stack:
            v = stack.pop()
            if v in here:
                found.add(v)
            elif v not in seen:
                seen.add(v)
                stack.extend(self._graph.values[v].args)
        return frozenset(found)

    def _settle(
        self,
        wanted: Iterable[int],
        waiting: dict[int, frozenset[int]],
        ready: set[int],
        steps: list[Compute | Branch],
        depth: int,
    ) -> None:
        """Writes the `if`s of the wanted choices, those they need first, with others on the same condition that are ready."""
        stack, needed = list(wanted), set[int]()
        while stack:
            choice = stack.pop()
            if choice not in needed:
                needed.add(choice)
                stack.extend(v for v in waiting[choice] if v in waiting)
        for choice in sorted(needed):
            if choice in waiting:
                condition = self._graph.values[choice].args[0]
                together = tuple(
                    v
                    for v, needs in waiting.items()
                    if self._graph.values[v].args[0] == condition and (v == choice or needs <= ready)
                )
                steps.append(self._branch(condition, together, ready, depth))
                ready.update(together)
                for v in together:
                    del waiting[v]

    def _branch(self, condition: int, choices: tuple[int, ...], ready: set[int], depth: int) -> Branch:
        then = [self._graph.values[v].args[1] for v in choices]
        other = [self._graph.values[v].args[2] for v in choices]
        return Branch(
            condition, choices, self.block(then, ready, depth + 1), self.block(other, ready, depth + 1)
        )
