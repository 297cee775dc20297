"""From a generated module's tables to forms: what each group computes, with equal groups recognised."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.runtime.contract import Class, Plan
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
    return tuple(_Wiring(plan, g).result() for g in range(len(plan.groups)))


def read_between_groups(plan: Plan) -> dict[int, list[tuple[int, int]]]:
    """For each group the (node, out) pairs that other groups read, in order of first use."""
    home = {n: g for g, group in enumerate(plan.groups) for n in group.nodes}
    published: dict[int, list[tuple[int, int]]] = {g: [] for g in range(len(plan.groups))}
    for g, group in enumerate(plan.groups):
        for node, part in group.calls:
            for source, kind, index in read_by(plan, node, part):
                owner = home.get(source)
                if (
                    kind == "out"
                    and owner is not None
                    and owner != g
                    and (source, index) not in published[owner]
                ):
                    published[owner].append((source, index))
    return published


class _Wiring:
    def __init__(self, plan: Plan, group: int) -> None:
        self.plan = plan
        self.group = group
        self.home = {n: g for g, members in enumerate(plan.groups) for n in members.nodes}
        self.published = read_between_groups(plan)
        self.members = plan.groups[group].nodes
        self.states: dict[int, int] = {}
        count = 0
        for node in self.members:
            self.states[node] = count
            count += len(self._class(node).states)
        self.count = count
        self.values: dict[int, int] = {}
        self.outs: dict[int, int] = {}
        self.channels: set[tuple[int, int]] = set()

    def _class(self, node: int) -> Class:
        return self.plan.classes[self.plan.nodes[node].kind]

    def result(self) -> Wiring:
        calls = list(self.plan.groups[self.group].calls)
        published = self.published[self.group]
        publishing = order_parts(self.plan, published, lambda n: self.home.get(n, self.group) == self.group)
        for node, part in calls + publishing:
            self._place(node)
            for source in read_by(self.plan, node, part):
                if (channel := self._channel(source)) is not None:
                    self.channels.add(channel)
        order = {c: k for k, c in enumerate(sorted(self.channels))}
        form = Form(
            states=self.count,
            inputs=len(order),
            outs=sum(self._class(n).outs for n in self.outs),
            calls=tuple(self._call(n, part, order) for n, part in calls),
            publishing=tuple(self._call(n, part, order) for n, part in publishing),
            published=tuple(self.outs[n] + out for n, out in published),
        )
        return Wiring(form, tuple(order), tuple(self.values), tuple(published))

    def _place(self, node: int) -> None:
        if node not in self.values:
            self.values[node] = sum(self._class(n).values for n in self.values)
            self.outs[node] = sum(self._class(n).outs for n in self.outs)

    def _channel(self, source: tuple[int, str, int]) -> tuple[int, int] | None:
        """(group, channel) where another group publishes this; None where it is the group's own."""
        node, kind, index = source
        owner = self.home.get(node)
        if owner is None or owner == self.group:
            return None
        if kind == "state":
            members = self.plan.groups[owner].nodes
            before = sum(len(self._class(n).states) for n in members[: members.index(node)])
            return owner, before + index
        states = sum(len(self._class(n).states) for n in self.plan.groups[owner].nodes)
        return owner, states + self.published[owner].index((node, index))

    def _call(self, node: int, part: int, order: dict[tuple[int, int], int]) -> CallForm:
        read = set(read_by(self.plan, node, part))
        sources: list[Where] = []
        for source in self.plan.nodes[node].sources:
            channel = self._channel(source)
            if source not in read:
                sources.append(("none", 0))
            elif channel is not None:
                sources.append(("channel", order[channel]))
            elif source[1] == "state":
                sources.append(("state", self.states[source[0]] + source[2]))
            else:
                sources.append(("out", self.outs[source[0]] + source[2]))
        kind = self.plan.nodes[node].kind
        return CallForm(
            kind, part, self.states.get(node, 0), self.values[node], self.outs[node], tuple(sources)
        )
