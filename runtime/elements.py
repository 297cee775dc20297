"""A plan's tables expanded: which elements there are, what each of them reads, and which groups they make.

In: a `Plan`. Out: `Elements`. Guaranteed: every column of the plan is an array with one integer an element (or group), worked out by a few operations on
whole columns, so that ten thousand agents cost little more than ten.

Groups have *places*: their numbers in cascade order. State vectors hold the states group by group, in the order of places, element by element.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.contract import Class, Group, Index, Members, Packed, Plan, Run, Steps

Integers = NDArray[np.int64]


def expanded(index: Index, count: int) -> Integers:
    """The integers of `count` elements."""
    match index:
        case int():
            return np.full(count, index, np.int64)
        case Steps(first, step):
            return first + step * np.arange(count, dtype=np.int64)
        case Packed(text):
            differences = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<i4")
            return np.cumsum(differences, dtype=np.int64)
        case _:
            return np.array(index, np.int64)


def members(entries: Sequence[Members], count: int) -> Integers:
    """Elements (count, members) of a table of groups: a row a group."""
    columns = [_columns(entry, count) for entry in entries]
    return np.concatenate(columns, axis=1) if columns else np.zeros((count, 0), np.int64)


def _columns(entry: Members, count: int) -> Integers:
    if not isinstance(entry, Run):
        return expanded(entry, count)[:, None]
    within = entry.step * np.arange(entry.count, dtype=np.int64)
    return entry.first + entry.shift * np.arange(count, dtype=np.int64)[:, None] + within


@dataclass(frozen=True, slots=True)
class Source:
    """One input of a block's elements: the elements it is read from, and which state or out of them."""

    elements: Integers
    what: str
    index: Integers


@dataclass(frozen=True, slots=True)
class Block:
    """Elements `first`, `first + 1`, … of a class; `parameters` (count, k) are places in the parameter vector."""

    path: str
    kind: int
    first: int
    count: int
    parameters: Integers
    sources: tuple[Source, ...]


@dataclass(frozen=True, slots=True)
class Family:
    """The groups of one table entry: rows of `nodes` (count, members), their elements, and of `calls` (count, calls), whose parts are `parts`.

    `places` are the groups' numbers in cascade order, `indices` (count, levels) those in their names.
    """

    name: str
    count: int
    nodes: Integers
    calls: Integers
    parts: Integers
    places: Integers
    indices: Integers


@dataclass(frozen=True)
class Elements:
    """A plan with its tables expanded. Arrays go by element (`block`, `home`, `position`, `first_state`, `offsets`) or by place of a group.

    `home`: the place of an element's group, -1 for an element without states; `position`: which of its group's elements it is; `first_state`: where
    its states begin among its group's.
    """

    plan: Plan
    blocks: tuple[Block, ...]
    families: tuple[Family, ...]
    block: Integers
    home: Integers
    position: Integers
    first_state: Integers
    group_states: Integers

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.block)

    @property
    def groups(self) -> int:
        """Number of single groups."""
        return len(self.group_states)

    def kind(self, element: int) -> Class:
        """The class of an element."""
        return self.plan.classes[self.blocks[int(self.block[element])].kind]

    def row(self, element: int) -> tuple[Block, int]:
        """An element's block and its number within it."""
        block = self.blocks[int(self.block[element])]
        return block, element - block.first

    @cached_property
    def group_offsets(self) -> Integers:
        """Where each group's states begin in the state vector; at the end, the number of states."""
        return np.concatenate([[0], np.cumsum(self.group_states)])

    @cached_property
    def offsets(self) -> Integers:
        """Where each element's states begin in the state vector (0 for those without)."""
        if not self.groups:
            return np.zeros(self.count, np.int64)
        return np.where(self.home >= 0, self.group_offsets[self.home] + self.first_state, 0)

    @cached_property
    def order(self) -> Integers:
        """Elements in groups, in the order of the state vector."""
        rows = [(f.places.repeat(f.nodes.shape[1]), f.nodes.ravel()) for f in self.families]
        if not rows:
            return np.zeros(0, np.int64)
        places, nodes = (np.concatenate(column) for column in zip(*rows, strict=True))
        return np.asarray(nodes[np.argsort(places, kind="stable")])

    @cached_property
    def family(self) -> Integers:
        """The number of each group's family."""
        found = np.zeros(self.groups, np.int64)
        for k, family in enumerate(self.families):
            found[family.places] = k
        return found

    @cached_property
    def _row_of_group(self) -> Integers:
        found = np.zeros(self.groups, np.int64)
        for family in self.families:
            found[family.places] = np.arange(family.count)
        return found

    def nodes_of(self, place: int) -> list[int]:
        """The elements of a group."""
        found: list[int] = self.families[int(self.family[place])].nodes[self._row_of_group[place]].tolist()
        return found

    def group_indices(self, places: Integers) -> Integers:
        """The indices (k, levels) in the names of some groups of one name."""
        families = [self.families[k] for k in self.family[places].tolist()]
        rows = self._row_of_group[places].tolist()
        return np.stack([family.indices[row] for family, row in zip(families, rows, strict=True)])

    def group_name(self, place: int) -> str:
        """The name of a group: `arm`, `car[3]`."""
        family = self.families[int(self.family[place])]
        return numbered(family.name, family.indices[self._row_of_group[place]].tolist())

    @cached_property
    def outs(self) -> Integers:
        """Where each element's outs begin, all elements' outs in a row; at the end, how many there are."""
        counts = np.array([self.plan.classes[b.kind].outs for b in self.blocks] or [0], np.int64)[self.block]
        return np.concatenate([[0], np.cumsum(counts)])

    def read_by(self, element: int, part: int) -> list[tuple[int, str, int]]:
        """Sources that one part of an element (-1: its right-hand side) may read."""
        block, row = self.row(element)
        sources = (
            block.sources if part < 0 else [block.sources[k] for k in self.kind(element).parts[part].inputs]
        )
        return [(int(s.elements[row]), s.what, int(s.index[row])) for s in sources]

    def order_parts(
        self, wanted: Iterable[tuple[int, int]], inside: Callable[[int], bool]
    ) -> list[tuple[int, int]]:
        """Calls (element, part) that make the outs (element, out); see `order_parts`."""
        return order_parts(wanted, lambda e, out: part_of(self.kind(e), out), self.read_by, inside)


def numbered(path: str, indices: Iterable[int | str]) -> str:
    """A path with its indices put in: `car[].x` and 3 make `car[3].x`."""
    first, *rest = path.split("[]")
    return first + "".join(f"[{i}]{text}" for i, text in zip(indices, rest, strict=True))


def part_of(kind: Class, out: int) -> int:
    """The part of a class that sets an out."""
    return next(k for k, part in enumerate(kind.parts) if out in part.outs)


def order_parts(
    wanted: Iterable[tuple[int, int]],
    part: Callable[[int, int], int],
    read: Callable[[int, int], Iterable[tuple[int, str, int]]],
    inside: Callable[[int], bool],
) -> list[tuple[int, int]]:
    """Calls (node, part) that make the outs (node, out), in order: whatever a part reads from nodes that are `inside` comes before it.

    `part(node, out)` is the part that sets an out, `read(node, part)` tells what it may read.
    """
    calls: dict[tuple[int, int], None] = {}
    stack = [(node, part(node, out), False) for node, out in reversed(list(wanted))]
    while stack:
        node, number, ready = stack.pop()
        if (node, number) in calls:
            continue
        if ready:
            calls[node, number] = None
            continue
        stack.append((node, number, True))
        for source, what, index in read(node, number):
            if what == "out" and inside(source):
                stack.append((source, part(source, index), False))
    return list(calls)


def spread(offsets: Integers, lengths: Integers) -> Integers:
    """offset, offset + 1, …, as many as the length says, of each pair, all in a row."""
    starts = np.cumsum(lengths) - lengths
    return np.asarray(np.repeat(offsets - starts, lengths) + np.arange(int(lengths.sum())))


def index_table(indices: Sequence[Index], count: int) -> Integers:
    """Indices (count, levels) of a table's entry."""
    columns = [expanded(index, count) for index in indices]
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0), np.int64)


def expand(plan: Plan) -> Elements:
    """The elements and groups of a plan."""
    blocks = _blocks(plan)
    count = sum(b.count for b in blocks)
    block = np.repeat(np.arange(len(blocks)), [b.count for b in blocks])
    sizes = np.array([len(plan.classes[b.kind].states) for b in blocks] or [0], np.int64)[block]
    families = _families(plan)
    home = np.full(count, -1, np.int64)
    position, first_state = np.zeros(count, np.int64), np.zeros(count, np.int64)
    group_states = np.zeros(sum(f.count for f in families), np.int64)
    for f in families:
        states = sizes[f.nodes]
        ends = np.cumsum(states, axis=1)
        home[f.nodes] = f.places[:, None]
        position[f.nodes] = np.arange(f.nodes.shape[1])
        first_state[f.nodes] = ends - states
        group_states[f.places] = states.sum(axis=1)
    return Elements(plan, blocks, families, block, home, position, first_state, group_states)


def _blocks(plan: Plan) -> tuple[Block, ...]:
    made: list[Block] = []
    first = 0
    for node in plan.nodes:
        sources = tuple(
            Source(expanded(element, node.count), what, expanded(index, node.count))
            for element, what, index in node.sources
        )
        parameters = index_table(node.parameters, node.count)
        made.append(Block(node.path, node.kind, first, node.count, parameters, sources))
        first += node.count
    return tuple(made)


def _families(plan: Plan) -> tuple[Family, ...]:
    total = sum(group.count for group in plan.groups)
    places = np.arange(total)
    if plan.order is not None:
        places[expanded(plan.order, total)] = np.arange(total)
    made: list[Family] = []
    first = 0
    for group in plan.groups:
        made.append(_family(group, places[first : first + group.count]))
        first += group.count
    return tuple(made)


def _family(group: Group, places: Integers) -> Family:
    called = [m for m, _ in group.calls]
    lengths = [m.count if isinstance(m, Run) else 1 for m in called]
    return Family(
        name=group.name,
        count=group.count,
        nodes=members(group.nodes, group.count),
        calls=members(called, group.count),
        parts=np.repeat(np.array([part for _, part in group.calls], np.int64), lengths),
        places=places,
        indices=index_table(group.indices, group.count),
    )
