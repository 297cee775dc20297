"""From a generated module's tables to forms: what each group computes, with equal groups recognised."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from hierc.runtime.contract import Plan
from hierc.runtime.machine.compose import CallForm, Form, Where
from hierc.runtime.system import order_parts, read_by


@dataclass(frozen=True, slots=True)
class Wiring:
    """One group: its form and what is its own.

    channels[k] is input k: (group, channel), a channel being a state of that group or, after the states, one of its published outs. Inputs are ordered
    by group, so that those of one group are read together. `values` lists the nodes whose values are laid end to end as the group's p.
    """

    form: Form
    channels: tuple[tuple[int, int], ...]
    values: tuple[int, ...]
    published: tuple[tuple[int, int], ...]  # (node, out) of each published channel


def wire(plan: Plan) -> tuple[Wiring, ...]:
    """The wiring of every group of a plan, in cascade order."""
    layout = _Layout(plan)
    return tuple(_Wiring(plan, layout, g).result() for g in range(len(plan.groups)))


class _Layout:
    """Where states and published outs are found: the home of each node with states, its first state in its group, each group's channels."""

    def __init__(self, plan: Plan) -> None:
        self.home: dict[int, int] = {}
        self.first: dict[int, int] = {}
        self.states: list[int] = []
        for g, group in enumerate(plan.groups):
            count = 0
            for node in group.nodes:
                self.home[node], self.first[node] = g, count
                count += len(plan.classes[plan.nodes[node].kind].states)
            self.states.append(count)
        #: For each group the (node, out) pairs that later groups read, numbered; and the calls that make them.
        self.published: list[dict[tuple[int, int], int]] = [{} for _ in plan.groups]
        self.publishing: list[list[tuple[int, int]]] = [[] for _ in plan.groups]
        for g in reversed(range(len(plan.groups))):  # readers come later: what they read is complete
            inside = functools.partial(self._inside, g)
            self.publishing[g] = order_parts(plan, self.published[g], inside)
            for node, part in [*plan.groups[g].calls, *self.publishing[g]]:
                for source, kind, index in read_by(plan, node, part):
                    if kind == "out" and not inside(source):
                        outs = self.published[self.home[source]]
                        outs.setdefault((source, index), len(outs))

    def _inside(self, group: int, node: int) -> bool:
        """Whether a group computes a node's outs itself: its own nodes', and those of nodes without states."""
        return self.home.get(node, group) == group

    def channel(self, group: int, source: tuple[int, str, int]) -> tuple[int, int] | None:
        """(group, channel) where another group publishes this; None where it is the group's own."""
        node, kind, index = source
        owner = self.home.get(node, group)
        if owner == group:
            return None
        if kind == "state":
            return owner, self.first[node] + index
        return owner, self.states[owner] + self.published[owner][node, index]


class _Wiring:
    """The wiring of one group in the making: where each node's values and outs begin in the group's own arrays."""

    def __init__(self, plan: Plan, layout: _Layout, group: int) -> None:
        self.plan, self.layout, self.group = plan, layout, group
        self.values: dict[int, int] = {}
        self.outs: dict[int, int] = {}
        self.value_count = 0
        self.out_count = 0
        self.channels: set[tuple[int, int]] = set()

    def result(self) -> Wiring:
        calls = self.plan.groups[self.group].calls
        published = tuple(self.layout.published[self.group])
        publishing = self.layout.publishing[self.group]
        for node, part in [*calls, *publishing]:
            self._place(node)
            for source in read_by(self.plan, node, part):
                if (channel := self.layout.channel(self.group, source)) is not None:
                    self.channels.add(channel)
        order = {c: k for k, c in enumerate(sorted(self.channels))}
        form = Form(
            states=self.layout.states[self.group],
            inputs=len(order),
            outs=self.out_count,
            calls=tuple(self._call(n, part, order) for n, part in calls),
            publishing=tuple(self._call(n, part, order) for n, part in publishing),
            published=tuple(self.outs[n] + out for n, out in published),
        )
        return Wiring(form, tuple(order), tuple(self.values), published)

    def _place(self, node: int) -> None:
        if node not in self.values:
            kind = self.plan.classes[self.plan.nodes[node].kind]
            self.values[node], self.outs[node] = self.value_count, self.out_count
            self.value_count += kind.values
            self.out_count += kind.outs

    def _call(self, node: int, part: int, order: dict[tuple[int, int], int]) -> CallForm:
        read = set(read_by(self.plan, node, part))
        sources: list[Where] = []
        for source in self.plan.nodes[node].sources:
            channel = self.layout.channel(self.group, source)
            if source not in read:
                sources.append(("none", 0))
            elif channel is not None:
                sources.append(("channel", order[channel]))
            elif source[1] == "state":
                sources.append(("state", self.layout.first[source[0]] + source[2]))
            else:
                sources.append(("out", self.outs[source[0]] + source[2]))
        kind = self.plan.nodes[node].kind
        first = self.layout.first.get(node, 0)
        return CallForm(kind, part, first, self.values[node], self.outs[node], tuple(sources))
