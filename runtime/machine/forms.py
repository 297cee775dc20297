"""From a plan's elements to forms: what each group computes, with equal groups recognised.

The groups of a family are wired together, by columns of elements (`alike.py`); those that differ in what decides about code, apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.alike import Nodes, Read, divided, inputs_of, same
from hierc.runtime.columns import distinct
from hierc.runtime.contract import Plan
from hierc.runtime.elements import Block, Elements, Family, expand, part_of
from hierc.runtime.machine.calls import CallForm, Form, Where

Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Wiring:
    """Groups of one form, and what is their own; arrays have a row a group.

    Input k is channel `channels[:, k]` of the groups at the places `owners[:, k]`, a channel being a state of that group or, after the states, one of its
    published outs. `runs` are the (first, count) of inputs that come from one group, read together. `values` lists the elements whose values
    are laid end to end as the group's p. `published` are the elements, and `outs` which of their outs, of the published channels.
    """

    form: Form
    family: int
    places: Integers
    owners: Integers
    channels: Integers
    runs: tuple[tuple[int, int], ...]
    values: Integers
    published: Integers
    outs: tuple[int, ...]


def wire(plan: Plan | Elements) -> tuple[Wiring, ...]:
    """The wiring of every group of a plan."""
    elements = plan if isinstance(plan, Elements) else expand(plan)
    channels = _Channels(elements)
    return tuple(
        wiring
        for k, family in enumerate(elements.families)
        for wiring in divided(family.count, partial(_wired, elements, channels, k))
    )


def _wired(elements: Elements, channels: _Channels, family: int, rows: Integers) -> Wiring:
    return _Wiring(elements, channels, family, rows).result()


class _Channels:
    """Which outs are published, and the channel of each: after the group's states, by element and out.

    An out is published if a later group reads it, be it to publish an out of its own.
    """

    def __init__(self, elements: Elements) -> None:
        self.elements = elements
        self.published: NDArray[np.bool_] = np.zeros(int(elements.outs[-1]), np.bool_)
        if len(self.published):
            for family in elements.families:
                self._mark_read(family)
            self._mark_behind()

    def _mark_read(self, family: Family) -> None:
        """The outs that the calls of a family's groups read from other groups."""
        elements = self.elements
        for b in distinct(elements.block[family.calls]).tolist():
            block = elements.blocks[b]
            for part in distinct(family.parts).tolist():
                where = (elements.block[family.calls] == b) & (family.parts == part)
                rows = family.calls[where] - block.first
                places = np.broadcast_to(family.places[:, None], family.calls.shape)[where]
                for k in inputs_of(elements.plan.classes[block.kind], part) if len(rows) else ():
                    source = block.sources[k]
                    if source.what == "out":
                        owners = source.elements[rows]
                        others = (elements.home[owners] >= 0) & (elements.home[owners] != places)
                        slots = elements.outs[owners] + source.index[rows]
                        self.published[slots[others]] = True

    def _mark_behind(self) -> None:
        """The outs that are read to make published ones. Few parts read outs, so this goes one by one."""
        elements = self.elements
        slots = np.flatnonzero(self.published)
        owners = np.searchsorted(elements.outs, slots, "right") - 1
        reading = np.array([_reads_outs(elements, block) for block in elements.blocks])[
            elements.block[owners]
        ]
        homes = elements.home.tolist()
        stack = [
            (homes[e], e, part_of(elements.kind(e), slot - int(elements.outs[e])))
            for slot, e in zip(slots[reading].tolist(), owners[reading].tolist(), strict=True)
        ]
        seen = set(stack)
        while stack:
            group, element, part = stack.pop()
            for source, what, index in elements.read_by(element, part):
                if what != "out":
                    continue
                own = homes[source] in (group, -1)
                if not own:
                    self.published[elements.outs[source] + index] = True
                call = (group if own else homes[source], source, part_of(elements.kind(source), index))
                if call not in seen:
                    seen.add(call)
                    stack.append(call)

    @cached_property
    def _ranks(self) -> Integers:
        """The number of each published out among those of its group."""
        elements = self.elements
        slots = np.flatnonzero(self.published)
        owners = np.searchsorted(elements.outs, slots, "right") - 1
        homes = elements.home[owners]
        order = np.lexsort((slots - elements.outs[owners], elements.position[owners], homes))
        ranks = np.full(len(self.published), -1, np.int64)
        firsts = np.searchsorted(homes[order], homes[order], "left")
        ranks[slots[order]] = np.arange(len(slots)) - firsts
        return ranks

    def channel(self, owners: Integers, what: str, index: Integers) -> Integers:
        """The channels of states or outs of elements in other groups."""
        elements = self.elements
        if what == "state":
            return np.asarray(elements.first_state[owners] + index)
        return np.asarray(
            elements.group_states[elements.home[owners]] + self._ranks[elements.outs[owners] + index]
        )


def _reads_outs(elements: Elements, block: Block) -> bool:
    """Whether some part of a block reads an out."""
    parts = elements.plan.classes[block.kind].parts
    return any(block.sources[k].what == "out" for part in parts for k in part.inputs)


class _Wiring:
    """The wiring of some groups of a family in the making."""

    def __init__(self, elements: Elements, channels: _Channels, family: int, rows: Integers) -> None:
        self.elements, self.channels, self.number = elements, channels, family
        self.family, self.rows = elements.families[family], rows
        self.places = self.family.places[rows]
        self.nodes = Nodes(elements, self.places)
        self.values: dict[int, int] = {}
        self.outs: dict[int, int] = {}
        self.value_count = 0
        self.out_count = 0

    def result(self) -> Wiring:
        """The wiring. Raises Differ where the groups are not alike."""
        published = self._published()
        publishing = self.nodes.order_parts(published)
        called = self.family.calls[self.rows].T
        calls = [
            (self.nodes.number(column), part)
            for column, part in zip(called, self.family.parts.tolist(), strict=True)
        ]
        order = self._inputs([*calls, *publishing])
        numbers = {key: k for k, key in enumerate(order)}
        form = Form(
            states=same(self.elements.group_states[self.places]),
            inputs=len(order),
            outs=self.out_count,
            calls=tuple(self._call(n, part, numbers) for n, part in calls),
            publishing=tuple(self._call(n, part, numbers) for n, part in publishing),
            published=tuple(self.outs[n] + out for n, out in published),
        )
        owners, channels = ([pair[k] for pair in order.values()] for k in (0, 1))
        return Wiring(
            form,
            self.number,
            self.places,
            self._table(owners),
            self._table(channels),
            _runs(owners),
            self._table([self.nodes.columns[n] for n in self.values]),
            self._table([self.nodes.columns[n] for n, _ in published]),
            tuple(out for _, out in published),
        )

    def _table(self, columns: Sequence[Integers]) -> Integers:
        return np.stack(columns, axis=1) if columns else np.zeros((len(self.rows), 0), np.int64)

    def _published(self) -> list[tuple[int, int]]:
        """(node, out) of what other groups read, in the order of their channels."""
        found = []
        for column in self.family.nodes[self.rows].T:
            node = self.nodes.number(column)
            first = self.elements.outs[column]
            read = self.channels.published
            outs = range(self.nodes.kind(node).outs)
            found += [(node, out) for out in outs if same(read[first + out].astype(np.int64))]
        return found

    def _inputs(
        self, calls: Sequence[tuple[int, int]]
    ) -> dict[tuple[bytes, bytes], tuple[Integers, Integers]]:
        """(places, channels) of every input, those read from one group together; gives each node called its place."""
        found: dict[tuple[bytes, bytes], tuple[Integers, Integers]] = {}
        for node, part in calls:
            self._place(node)
            sources = self.nodes.sources(node)
            for k in inputs_of(self.nodes.kind(node), part):
                if not self.nodes.is_inside(sources[k].node):
                    pair = self._channel(sources[k])
                    found[_key(pair)] = pair
        return dict(
            sorted(found.items(), key=lambda item: (item[1][0][0], item[0][0], item[1][1][0], item[0][1]))
        )

    def _channel(self, read: Read) -> tuple[Integers, Integers]:
        owners = self.nodes.columns[read.node]
        return self.elements.home[owners], self.channels.channel(owners, read.what, read.index)

    def _place(self, node: int) -> None:
        if node not in self.values:
            kind = self.nodes.kind(node)
            self.values[node], self.outs[node] = self.value_count, self.out_count
            self.value_count += kind.values
            self.out_count += kind.outs

    def _call(self, node: int, part: int, numbers: dict[tuple[bytes, bytes], int]) -> CallForm:
        read = set(inputs_of(self.nodes.kind(node), part))
        sources: list[Where] = []
        for k, source in enumerate(self.nodes.sources(node)):
            if k not in read:
                sources.append(("none", 0))
            elif not self.nodes.is_inside(source.node):
                sources.append(("channel", numbers[_key(self._channel(source))]))
            elif source.what == "state":
                first = self.elements.first_state[self.nodes.columns[source.node]]
                sources.append(("state", same(first + source.index)))
            else:
                sources.append(("out", self.outs[source.node] + same(source.index)))
        column = self.nodes.columns[node]
        first = np.where(self.elements.home[column] >= 0, self.elements.first_state[column], 0)
        return CallForm(
            self.nodes.block(node).kind, part, same(first), self.values[node], self.outs[node], tuple(sources)
        )


def _key(pair: tuple[Integers, Integers]) -> tuple[bytes, bytes]:
    return pair[0].tobytes(), pair[1].tobytes()


def _runs(owners: Sequence[Integers]) -> tuple[tuple[int, int], ...]:
    """(first, count) of neighbours that are equal."""
    firsts = [k for k, owner in enumerate(owners) if k == 0 or (owner != owners[k - 1]).any()]
    return tuple((a, b - a) for a, b in zip(firsts, [*firsts[1:], len(owners)], strict=False))
