"""What groups would be like that are made of neighbours in the cascade: sizes that decide what a step of them costs.

In: a plan's groups as they are wired. Out: `Sizes` of any neighbours joined, without making them. Guaranteed: exact for single groups; for several, the chain
rule through outs and the fill of the elimination are estimated from the groups' own and from who reads what.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from hierc.runtime.contract import Class
from hierc.runtime.machine.calls import CallForm, Form
from hierc.runtime.machine.forms import Wiring

#: Part of the fill that an elimination in the best order leaves of what one in the cascade's order would make.
_FILL = 0.5


@dataclass(frozen=True, slots=True)
class Sizes:
    """Of a group: its states, flops of an evaluation, updates of its factorisation, inputs, outs that others read, products of the chain rule
    through outs inside it.
    """

    states: int
    flops: float
    updates: float
    inputs: int
    published: int
    chained: int


@dataclass(frozen=True, slots=True)
class FormFacts:
    """The same of a form, in its equations and in what it publishes. `uses`, `passed`: how many derivatives are taken by each input, in either.

    `rows`: derivatives that some input reaches. `reach`: for each published out its own group's states and the inputs that it may depend on.
    """

    flops: float
    publishing: float
    chained: int
    rows: int
    uses: tuple[int, ...]
    passed: tuple[int, ...]
    reach: tuple[tuple[frozenset[int], frozenset[int]], ...]


def form_facts(form: Form, classes: Sequence[Class]) -> FormFacts:
    """What the calls of a form do."""
    chained, rows, uses, passed = 0, 0, [0] * form.inputs, [0] * form.inputs
    reach: dict[int, tuple[frozenset[int], frozenset[int]]] = {}  # of outs: states, inputs
    nothing = (frozenset[int](), frozenset[int]())
    calls = [*((call, uses) for call in form.calls), *((call, passed) for call in form.publishing)]
    for call, counts in calls:
        found = dict.fromkeys(_rows(call, classes), nothing)
        kind = classes[call.kind]
        for row, column in kind.pattern:
            if row not in found:
                continue
            what, k = ("state", call.x + column)
            if column >= len(kind.states):
                what, k = call.sources[column - len(kind.states)]
            states, inputs = found[row]
            if what == "state":
                states |= {k}
            elif what == "channel":
                inputs |= {k}
                counts[k] += 1
            elif what == "out":
                states, inputs = states | reach[k][0], inputs | reach[k][1]
                chained += len(reach[k][0]) if counts is uses else 0
            found[row] = (states, inputs)
        if call.part < 0:
            rows += sum(bool(inputs) for _, inputs in found.values())
        else:
            first = call.y - len(kind.states)
            reach.update({first + row: both for row, both in found.items()})
    return FormFacts(
        sum(_flops(call, classes) for call in form.calls),
        sum(_flops(call, classes) for call in form.publishing),
        chained,
        rows,
        tuple(uses),
        tuple(passed),
        tuple(reach[k] for k in form.published),
    )


def _rows(call: CallForm, classes: Sequence[Class]) -> list[int]:
    """The rows of its class's Jacobian that a call makes."""
    kind = classes[call.kind]
    if call.part < 0:
        return [*range(len(kind.states))]
    return [len(kind.states) + out for out in kind.parts[call.part].outs]


def _flops(call: CallForm, classes: Sequence[Class]) -> float:
    """Of a right-hand side as its class tells; a part is taken for as large a piece of that as the outs it sets."""
    kind = classes[call.kind]
    if call.part < 0:
        return kind.flops
    part = kind.parts[call.part]
    return len(part.inputs) + kind.flops * len(part.outs) / (len(kind.states) + kind.outs)


@dataclass(slots=True)
class _Group:
    """A group as compiled. `reads`: owner, channel, derivatives taken by it in equations and in what is published.

    `outs`: the states, as bits, that each published out depends on.
    """

    states: int
    facts: FormFacts
    updates: int
    first: int  # of its states among all
    reads: list[tuple[int, int, int, int]]
    outs: list[int]
    rows_on: int  # the states, as bits, that its inputs depend on
    readers: list[int]  # the last group that reads each published out


class Coupling:
    """The groups of a plan in cascade order, and who reads what. `updates(wiring)` are those of the factorisation of a wiring's form."""

    def __init__(
        self, classes: Sequence[Class], wiring: Sequence[Wiring], updates: Callable[[Wiring], int]
    ) -> None:
        places = sorted(
            (place, w, row) for w in range(len(wiring)) for row, place in enumerate(wiring[w].places.tolist())
        )
        facts = [form_facts(w.form, classes) for w in wiring]
        sizes = [updates(w) for w in wiring]
        self.groups: list[_Group] = []
        first = 0
        for place, w, row in places:
            form = wiring[w].form
            owners, channels = wiring[w].owners[row].tolist(), wiring[w].channels[row].tolist()
            reads = [*zip(owners, channels, facts[w].uses, facts[w].passed, strict=True)]
            masks = [self._mask(owner, channel) for owner, channel, *_ in reads]
            outs = [
                sum(1 << (first + s) for s in states) | _joined(masks[k] for k in inputs)
                for states, inputs in facts[w].reach
            ]
            none = [place] * len(outs)
            self.groups.append(
                _Group(form.states, facts[w], sizes[w], first, reads, outs, _joined(masks), none)
            )
            for owner, channel, *_ in reads:
                read = self.groups[owner]
                if channel >= read.states:
                    read.readers[channel - read.states] = max(read.readers[channel - read.states], place)
            first += form.states

    def _mask(self, owner: int, channel: int) -> int:
        """The states, as bits, that a channel depends on."""
        group = self.groups[owner]
        if channel < group.states:
            return 1 << (group.first + channel)
        return group.outs[channel - group.states]

    def joined(self, first: int, end: int) -> Iterator[Sizes]:
        """Sizes of the group `first`, of it and the next one, and so on to the group `end`."""
        groups = self.groups
        states, flops, updates, chained = 0, 0.0, 0.0, 0
        inputs: set[tuple[int, int]] = set()
        published: set[int] = set()  # groups whose outs are read inside
        for last in range(first, end + 1):
            here = groups[last]
            states += here.states
            flops += here.facts.flops
            updates += here.updates + self._fill(first, last)
            chained += here.facts.chained
            for owner, channel, uses, _ in here.reads:
                if owner < first:
                    inputs.add((owner, channel))
                elif channel >= groups[owner].states:
                    chained += uses * self._reach(owner, channel, first)
                    if owner not in published:
                        published.add(owner)
                        flops += groups[owner].facts.publishing
                        chained += sum(n * self._reach(o, c, first) for o, c, _, n in groups[owner].reads)
            read = sum(reader > last for group in groups[first : last + 1] for reader in group.readers)
            yield Sizes(states, flops, updates, len(inputs), read, chained)

    def _fill(self, first: int, last: int) -> float:
        """Updates that the group `last` adds to those of its own by what it reads of groups from `first` on."""
        here = self.groups[last]
        return _FILL * sum(
            here.facts.rows * math.sqrt(other.updates * other.states)
            for other in self.groups[first:last]
            if here.rows_on >> other.first & ((1 << other.states) - 1)
        )

    def _reach(self, owner: int, channel: int, first: int) -> int:
        """How many states of groups from `first` on an out depends on; none for a state, whose derivative is one."""
        if owner < first or channel < self.groups[owner].states:
            return 0
        return (self._mask(owner, channel) >> self.groups[first].first).bit_count()


def _joined(masks: Iterable[int]) -> int:
    found = 0
    for mask in masks:
        found |= mask
    return found
