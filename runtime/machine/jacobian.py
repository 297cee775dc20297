"""The Jacobian of a group of several nodes, by the chain rule, as sums of products of its nodes' derivatives.

In: the calls that states reach, in order, and which entries of their classes' Jacobians matter. Out: a `Chain`, which says what to multiply and add; it
is the same whether that is written out or read from a table. Every number has a slot: first the number one, then the nodes' entries, then sums of products.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

from hierc.runtime.contract import Class
from hierc.runtime.machine.calls import CallForm
from hierc.runtime.machine.elimination import Entry

#: The slot of the number one.
ONE = 0


@dataclass(slots=True)
class Chain:
    """`terms` are (slot, factor, value): add the product of two slots to the first, which begins as zero. `entries` of the group's Jacobian have these slots.

    Slots from `sums` on are sums; what is neither a sum nor one is filled by the calls.
    """

    sums: int
    size: int
    terms: list[tuple[int, int, int]] = field(default_factory=list)
    entries: dict[Entry, int] = field(default_factory=dict)

    def total(self, products: Sequence[tuple[int, int]]) -> int:
        """The slot of a sum of products."""
        if len(products) == 1 and products[0][0] == ONE:
            return products[0][1]
        slot = self.size
        self.size += 1
        self.terms += [(slot, factor, value) for factor, value in products]
        return slot


def wanted(call: CallForm, kind: Class, moving: Callable[[int], bool]) -> tuple[int, ...]:
    """The entries of its class's Jacobian that a call needs: derivatives of what it sets by states of the group. `moving(k)`: out k depends on these."""
    n = len(kind.states)
    rows: Collection[int] = range(n) if call.part < 0 else [n + out for out in kind.parts[call.part].outs]

    def matters(column: int) -> bool:
        if column < n:
            return True
        where, k = call.sources[column - n]
        return where == "state" or (where == "out" and moving(k))

    return tuple(e for e, (row, column) in enumerate(kind.pattern) if row in rows and matters(column))


def chain(
    calls: Sequence[tuple[CallForm, Sequence[int], int]], classes: Sequence[Class], first: int
) -> Chain:
    """The Jacobian of a group: of each call the entries that matter and the slot of the first of them. `first`: the first slot that none of them has."""
    made = Chain(first, first)
    outs: dict[int, dict[int, int]] = {}
    for call, entries, slot in calls:
        kind = classes[call.kind]
        n = len(kind.states)
        rows: dict[int, dict[int, list[tuple[int, int]]]] = {}
        for k, e in enumerate(entries):
            row, column = kind.pattern[e]
            into = rows.setdefault(row, {})
            for state, product in _through(call, column, n, slot + k, outs):
                into.setdefault(state, []).append(product)
        for row, found in rows.items():
            totals = {state: made.total(products) for state, products in found.items()}
            if call.part < 0:
                made.entries.update({(call.x + row, state): total for state, total in totals.items()})
            else:
                outs[call.y + row - n] = totals
    return made


def _through(
    call: CallForm, column: int, n: int, slot: int, outs: dict[int, dict[int, int]]
) -> list[tuple[int, tuple[int, int]]]:
    """The states that a column of a call's Jacobian leads to, each with a product: the entry in `slot`, times what leads there."""
    if column < n:
        return [(call.x + column, (ONE, slot))]
    where, k = call.sources[column - n]
    if where == "state":
        return [(k, (ONE, slot))]
    return [(state, (slot, value)) for state, value in outs.get(k, {}).items()]
