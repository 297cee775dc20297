"""Names of groups that are made of others: `drive+motor`, `lead+car[1..3]`, `car[3].body+car[3].motor`.

In: `Elements`, and which of their groups are divided. Out: names of new groups, from their members. Guaranteed: a group that stays as it is keeps its name;
one made of whole groups is named after them, one of parts of groups after the agents in it; no two have one name, though a long name shows only its
first and its last part.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.elements import Elements, index_table, numbered

Integers = NDArray[np.int64]
#: The longest name that shows all of its parts.
LONGEST = 60


class Names:
    """What elements contribute to names: each belongs to a *unit*, a group that stays whole or, in a divided one, the element itself.

    `pattern`: the number, in `patterns`, of an element's part of a name, with `[]` for its indices.
    """

    def __init__(self, elements: Elements, divided: NDArray[np.bool_]) -> None:
        """`divided` (groups,): whether a group's elements go to several new ones."""
        self._elements = elements
        families = [family.name for family in elements.families]
        paths = [node.path or elements.plan.name for node in elements.plan.nodes]
        self.patterns = [*dict.fromkeys([*families, *paths])]
        numbers = {pattern: k for k, pattern in enumerate(self.patterns)}
        own = np.array([numbers[path] for path in paths], np.int64)[elements.block]
        whole = np.array([numbers[name] for name in families], np.int64)[elements.family]
        divided = _without_clashes(elements, divided, own, whole)
        inside = np.flatnonzero(elements.home >= 0)
        homes = elements.home[inside]
        self.unit = np.full(elements.count, -1, np.int64)
        self.unit[inside] = np.where(divided[homes], elements.groups + inside, homes)
        self.pattern = own.copy()
        self.pattern[inside] = np.where(divided[homes], own[inside], whole[homes])
        units = dict(zip(self.unit[inside].tolist(), self.pattern[inside].tolist(), strict=True))
        self._total = np.bincount([*units.values()], minlength=len(self.patterns))

    def of(self, nodes: Integers) -> Iterator[tuple[str, Integers, Integers]]:
        """Names of groups (k, members): each with the rows that it is for, and the indices (rows, levels) that belong into it."""
        begins = np.ones(nodes.shape, np.bool_)
        begins[:, 1:] = self.unit[nodes[:, 1:]] != self.unit[nodes[:, :-1]]
        first = np.flatnonzero(begins[0])
        patterns = [self.patterns[k] for k in self.pattern[nodes[0, first]].tolist()]
        if (begins == begins[0]).all() and len(set(patterns)) == len(patterns):
            shown, hidden = _cut(patterns)
            kept = [first[k] for k in shown]
            indices = np.concatenate([self._indices(nodes[:, k]) for k in kept], axis=1)
            yield _joined([patterns[k] for k in shown], hidden), np.arange(len(nodes)), indices
            return
        for row in range(len(nodes)):
            members = nodes[row, begins[row]]
            yield self._literal(members), np.array([row]), np.zeros((1, 0), np.int64)

    def _literal(self, members: Integers) -> str:
        """A name with indices and ranges written out, of the first elements of units."""
        found: dict[int, list[tuple[int, ...]]] = {}
        for element in members.tolist():
            indices = self._indices(np.array([element]))[0].tolist()
            found.setdefault(int(self.pattern[element]), []).append(tuple(indices))
        parts = [
            *chain.from_iterable(
                _ranges(self.patterns[k], indices, whole=len(indices) == self._total[k])
                for k, indices in found.items()
            )
        ]
        shown, hidden = _cut(parts)
        return _joined([parts[k] for k in shown], hidden)

    def _indices(self, column: Integers) -> Integers:
        """The indices (k, levels) in the names of some elements' units, all of one pattern."""
        elements = self._elements
        if self.unit[column[0]] < elements.groups:
            return elements.group_indices(elements.home[column])
        rows = []
        for element in column.tolist():
            block, row = elements.row(element)
            node = elements.plan.nodes[int(elements.block[element])]
            rows.append(index_table(node.indices, block.count)[row])
        return np.stack(rows)


def _without_clashes(
    elements: Elements, divided: NDArray[np.bool_], own: Integers, whole: Integers
) -> NDArray[np.bool_]:
    """Groups that are named after their elements: the divided ones, and those that are called like an agent in one of these."""
    inside = elements.home >= 0
    while True:
        taken = own[inside & divided[elements.home]]
        clashing = divided | np.isin(whole, taken)
        if (clashing == divided).all():
            return divided
        divided = clashing


def _ranges(pattern: str, indices: Sequence[tuple[int, ...]], *, whole: bool) -> Iterator[str]:
    """Parts of a name for some elements of an array: all of them, those in a row, single ones."""
    if whole:
        yield pattern.replace("[]", "")
        return
    begin = 0
    for end in range(1, len(indices) + 1):
        follows = end < len(indices) and (*indices[end - 1][:-1], indices[end - 1][-1] + 1) == indices[end]
        if not follows:
            *outer, low = indices[begin]
            high = indices[end - 1][-1]
            yield numbered(pattern, [*outer, low if low == high else f"{low}..{high}"])
            begin = end


def _cut(parts: Sequence[str]) -> tuple[list[int], int]:
    """Which parts of a name are shown, and how many are not."""
    if len(parts) < 3 or sum(map(len, parts)) + len(parts) <= LONGEST:
        return [*range(len(parts))], 0
    return [0, len(parts) - 1], len(parts) - 2


def _joined(parts: Sequence[str], hidden: int) -> str:
    return "+".join([parts[0], f"{hidden} more", *parts[1:]] if hidden else parts)
