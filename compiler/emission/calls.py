"""Calls: what one evaluation of a group does, in which order.

In: a model's groups and the places of inputs. Out: `Group`s with their calls. Guaranteed: every out is set before it is read; outs of other groups are
channels and never called; all elements of an entry belong to one block. A family whose groups call elements of different blocks is divided into families
that do not. The calls of a family follow from its first group, those of its other groups by whole columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hierc.compiler import model
from hierc.compiler.arrays.columns import Column, Index, Integers, column, expanded, taken
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.emission.places import Found
from hierc.compiler.emission.runs import Members, members
from hierc.compiler.emission.sequence import Link, sequence
from hierc.compiler.symbolic.derive import Form

#: In a call: the node's right-hand side rather than one of its parts.
RATES = -1

#: A part of the nodes of a block.
Vertex = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Block:
    """A block of nodes: its form, where its parameters stand and where its inputs come from."""

    path: str
    kind: int
    parameters: tuple[Index, ...]
    sources: tuple[Found, ...]
    first: int
    count: int
    indices: tuple[Index, ...]


@dataclass(frozen=True, slots=True)
class Group:
    """A family of subsystems: what one evaluation calls, in order."""

    name: str
    nodes: tuple[Members, ...]
    calls: tuple[tuple[Members, int], ...]
    count: int
    indices: tuple[Index, ...]


def families(
    groups: Sequence[model.Group],
    order: Index | None,
    blocks: Sequence[Block],
    forms: Sequence[Form],
    elements: Elements,
) -> tuple[tuple[Group, ...], Index | None]:
    """The families, and the cascade order of all groups as they are numbered now (None: as they are numbered)."""
    rows = [[_rows(nodes, group.count) for nodes in group.nodes] for group in groups]
    homes = np.full(sum(block.count for block in blocks), -1, np.int64)
    firsts = np.cumsum([0, *(group.count for group in groups)]).tolist()
    for first, columns in zip(firsts, rows, strict=False):
        for r in columns:
            homes[r] = first + np.arange(r.shape[1])
    found: list[Group] = []
    old: list[Integers] = []  # the former numbers of groups
    wiring = _Wiring(blocks, forms, elements, homes)
    for first, group, columns in zip(firsts, groups, rows, strict=False):
        for places, family in _divided(wiring, group, columns, first, np.arange(group.count)):
            found.append(family)
            old.append(first + places)
    former = np.concatenate([np.zeros(0, np.int64), *old])
    numbers = np.argsort(former, kind="stable")  # by former number
    cascade = numbers if order is None else numbers[expanded(order, len(numbers))]
    same = (cascade == np.arange(len(cascade))).all()
    return tuple(found), None if same else column(cascade)


def _rows(nodes: Index, count: int) -> Integers:
    """Elements of each group, shape (elements of a group, groups)."""
    return np.array([nodes]).reshape(1, 1) if isinstance(nodes, int) else nodes.values.reshape(count, -1).T


def _divided(
    wiring: _Wiring, group: model.Group, columns: Sequence[Integers], first: int, places: Integers
) -> Iterator[tuple[Integers, Group]]:
    """Families of those groups of a family that stand at `places`."""
    try:
        family = _Family(wiring, [r[:, places] for r in columns], first + places)
        nodes, calls = family.nodes(), family.calls()
    except _Uneven as uneven:
        _, begins = np.unique(uneven.labels, return_index=True)
        for label in uneven.labels[np.sort(begins)]:
            yield from _divided(wiring, group, columns, first, places[uneven.labels == label])
    else:
        indices = tuple(taken(index, places) for index in group.indices)
        yield places, Group(group.name, nodes, calls, len(places), indices)


class _Uneven(Exception):
    """The groups of a family differ: those with equal labels may be alike."""

    def __init__(self, labels: Integers) -> None:
        self.labels = labels


def _even(codes: Integers) -> None:
    """Check that all groups (columns) have the same codes. Raises _Uneven."""
    if codes.shape[1] > 1 and (codes != codes[:, :1]).any():
        raise _Uneven(np.unique(codes, axis=1, return_inverse=True)[1].ravel())


@dataclass(frozen=True, slots=True)
class _Wiring:
    """What all groups share. `homes`: the group of each element that has one, otherwise -1."""

    blocks: Sequence[Block]
    forms: Sequence[Form]
    elements: Elements
    homes: Integers

    def form(self, block: int) -> Form:
        return self.forms[self.blocks[block].kind]

    def owner(self, block: int, out: int) -> int:
        """The part that sets an out."""
        return next(k for k, part in enumerate(self.form(block).parts) if out in part.outs)


class _Family:
    """Finds the calls of a family. `columns` are the elements that belong to the groups, `groups` the groups' numbers."""

    def __init__(self, wiring: _Wiring, columns: Iterable[Integers], groups: Integers) -> None:
        self._wiring = wiring
        self._groups = groups
        self._members = [piece for rows in columns for piece in self._pieces(rows)]
        self._vertices: dict[Vertex, Integers] = {}  # rows that are called, ascending in the first group
        self._links: list[tuple[Vertex, Vertex, Integers, Integers]] = []

    def nodes(self) -> tuple[Members, ...]:
        """The elements that belong to the groups."""
        return tuple(entry for _, rows in self._members for entry in members(rows))

    def calls(self) -> tuple[tuple[Members, int], ...]:
        """The parts that the members' equations use, in order of dependency, then the members' right-hand sides."""
        wanted = self._discover()
        number = {vertex: k for k, vertex in enumerate(self._vertices)}
        links = [
            Link(number[v], number[w], self._positions(v, readers), self._positions(w, sources))
            for v, w, readers, sources in self._links
        ]
        sizes = [len(rows) for rows in self._vertices.values()]
        vertices = list(self._vertices)
        calls: list[tuple[Members, int]] = []
        for k, items in sequence(sizes, links, (number[v] for v in wanted)):
            calls += [(entry, vertices[k][1]) for entry in members(self._vertices[vertices[k]][items])]
        for block, rows in self._members:
            if self._wiring.form(block).states:
                calls += [(entry, RATES) for entry in members(rows)]
        return tuple(calls)

    def _pieces(self, rows: Integers) -> Iterator[tuple[int, Integers]]:
        """Rows in a row that belong to one block."""
        blocks = self._wiring.elements.blocks(rows)
        _even(blocks)
        cuts = 1 + np.flatnonzero(np.diff(blocks[:, 0]))
        for piece in np.split(np.arange(len(rows)), cuts):
            yield int(blocks[piece[0], 0]), rows[piece]

    def _discover(self) -> list[Vertex]:
        """Finds all rows that are called, and what needs what; the parts that the members use themselves, in their order."""
        wanted: list[Vertex] = []
        waiting: list[tuple[Vertex, Integers]] = []
        for block, rows in self._members:
            form = self._wiring.form(block)
            if not form.states:  # what it computes is read by other groups
                own = [(block, part) for part in range(len(form.parts))]
                wanted += own
                waiting += [(vertex, rows) for vertex in own]
            for vertex, _, read in self._read(block, form.needs, rows):
                wanted.append(vertex)
                waiting.append((vertex, read))
        while waiting:
            vertex, rows = waiting.pop()
            new = self._add(vertex, rows)
            block, part = vertex
            for other, at, read in self._read(block, self._wiring.form(block).parts[part].inputs, new):
                self._links.append((vertex, other, new[at, 0], read[:, 0]))
                waiting.append((other, read))
        for rows in self._vertices.values():  # what differs in the first group must differ in the others
            _even((np.diff(np.sort(rows, axis=0), axis=0) == 0).astype(np.int64))
        return wanted

    def _read(
        self, block: int, inputs: Iterable[int], rows: Integers
    ) -> Iterator[tuple[Vertex, Integers, Integers]]:
        """The parts that set these inputs of elements of a block: which of the rows need them, and the rows they need."""
        here, wiring = self._wiring.blocks[block], self._wiring
        if not len(rows):
            return
        for k in sorted(inputs):
            node, kind, index = here.sources[k]
            if kind != "out":
                continue
            numbers, outs = _at(node, rows - here.first), _at(index, rows - here.first)
            homes = wiring.homes[numbers]
            inside = (homes < 0) | (homes == self._groups)
            blocks = wiring.elements.blocks(numbers)
            width = int(outs.max()) + 1
            codes = np.where(inside, blocks * width + outs, -1)
            _even(codes)
            for code in np.unique(codes[:, 0]).tolist():
                if code >= 0:
                    other, out = divmod(code, width)
                    at = np.flatnonzero(codes[:, 0] == code)
                    yield (other, wiring.owner(other, out)), at, numbers[at]

    def _add(self, vertex: Vertex, rows: Integers) -> Integers:
        """Notes that rows are called; gives those that were not noted before."""
        known = self._vertices.get(vertex, rows[:0])
        together = np.concatenate([known, rows])
        _, begins, inverse = np.unique(together[:, 0], return_index=True, return_inverse=True)
        rows = together[begins]
        _even((together != rows[inverse.ravel()]).astype(np.int64))
        self._vertices[vertex] = rows
        return rows[begins >= len(known)]

    def _positions(self, vertex: Vertex, firsts: Integers) -> Integers:
        """The places of rows in a vertex, by their elements in the first group."""
        return np.searchsorted(self._vertices[vertex][:, 0], firsts)


def _at(index: Index, places: Integers) -> Integers:
    """What the elements at `places` of a block have."""
    return index.values[places] if isinstance(index, Column) else np.full(places.shape, index, np.int64)
