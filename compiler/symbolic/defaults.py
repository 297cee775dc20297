"""Defaults of parameters as programs.

In: a model's parameters. Out: a program for each scalar of single agents; for blocks of agents, programs for the scalars of one element.
Guaranteed: what a program uses is the user's or was set before; programs of blocks name what they use by its place among the element's own scalars
(leaf `value`) or among the entries `given` (leaf `parameter`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from hierc.compiler.arrays.columns import Column, Index
from hierc.compiler.model import Model
from hierc.compiler.model import Parameter as ModelParameter
from hierc.compiler.symbolic.graph import Graph
from hierc.compiler.symbolic.lower import Lowering
from hierc.compiler.symbolic.reduce import expand
from hierc.compiler.symbolic.schedule import Program, schedule


@dataclass(frozen=True, slots=True)
class Defaults:
    """The defaults of a block's parameters: programs that set the scalars of one element, in order."""

    path: str  # of the agents: `car[]`
    given: tuple[Index, ...]  # entries of the parameter vector that they use
    entries: tuple[Index, ...]  # entries that they set
    names: tuple[str, ...]  # of the scalars
    programs: tuple[Program, ...]  # program k sets entry k
    count: int


def single_defaults(graph: Graph, model: Model) -> tuple[tuple[int, Program], ...]:
    """Of single agents: for each scalar its entry in the parameter vector, and a program that sets it."""
    found = []
    for parameter in model.parameters:
        if not _in_block(parameter):
            for k, expression in enumerate(parameter.values):
                value = Lowering(graph).value(expression)
                value = expand(graph, [value])[value]
                entry = parameter.first + k
                found.append((entry, schedule(graph, [(entry, value)], parameter.span)))
    return tuple(found)


def block_defaults(graph: Graph, model: Model) -> tuple[Defaults, ...]:
    """Of blocks of agents: those of one block that follow each other go together."""
    blocks = groupby(
        filter(_in_block, model.parameters), lambda p: (p.path.rpartition(".")[0], p.count, p.indices)
    )
    return tuple(_Block(graph, path, count, tuple(some)).defaults() for (path, count, _), some in blocks)


def _in_block(parameter: ModelParameter) -> bool:
    return bool(parameter.indices) or parameter.count > 1


class _Block:
    """Lowers the defaults of one block."""

    def __init__(self, graph: Graph, path: str, count: int, parameters: tuple[ModelParameter, ...]) -> None:
        self._graph = graph
        self._path = path
        self._count = count
        self._parameters = parameters
        self._own: dict[Index, int] = {}  # the element's scalars so far
        self._given: dict[Index, int] = {}

    def defaults(self) -> Defaults:
        names: list[str] = []
        programs: list[Program] = []
        for parameter in self._parameters:
            size = len(parameter.values)
            elements = parameter.first + size * np.arange(self._count)
            for k, expression in enumerate(parameter.values):
                value = Lowering(self._graph, entry=self._entry).value(expression)
                value = expand(self._graph, [value])[value]
                programs.append(schedule(self._graph, [(len(programs), value)], parameter.span))
                names.append(parameter.path)
                own = Column(elements + k) if self._count > 1 else int(elements[0]) + k
                self._own[own] = len(self._own)
        entries = tuple(self._own)
        return Defaults(self._path, tuple(self._given), entries, tuple(names), tuple(programs), self._count)

    def _entry(self, entry: Index) -> int:
        """The value of an entry of the parameter vector."""
        if entry in self._own:
            return self._graph.leaf("value", self._own[entry])
        return self._graph.leaf("parameter", self._given.setdefault(entry, len(self._given)))
