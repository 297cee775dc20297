"""Domains: the elements that a block of agents has.

Agents that stand in no array have the domain `SINGLE`, of one element. The agents of an array have a domain of their own, and so have the blocks that
it is divided into; the agents inside them share it, unless they are arrays again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hierc.compiler.arrays.columns import Integers


@dataclass(frozen=True, eq=False, slots=True)
class Domain:
    """`count` elements. `places`: where each stands in the domain `outer` of the agent around the array.

    `indices`: for each array around the elements, from the outside, their index in it.
    """

    count: int
    outer: Domain | None
    places: Integers
    indices: tuple[Integers, ...]

    def within(self, ancestor: Domain) -> Integers:
        """The place of each element in a domain around this one (or in itself)."""
        places = np.arange(self.count)
        at: Domain = self
        while at is not ancestor:
            if at.outer is None:
                raise ValueError("this domain does not lie in that one")
            places = at.places[places]
            at = at.outer
        return places


SINGLE = Domain(1, None, np.zeros(1, np.int64), ())


def array_domain(outer: Domain, first: int, size: int) -> Domain:
    """`size` elements, with indices from `first` on, in each element of `outer`."""
    return indexed_domain(outer, np.arange(first, first + size))


def indexed_domain(outer: Domain, numbers: Integers) -> Domain:
    """Elements with these indices in each element of `outer`."""
    places = np.repeat(np.arange(outer.count), len(numbers))
    own = np.tile(numbers, outer.count)
    return Domain(len(own), outer, places, (*(column[places] for column in outer.indices), own))


def chosen(domain: Domain, elements: Integers) -> Domain:
    """Some elements of a domain as one of their own."""
    columns = tuple(column[elements] for column in domain.indices)
    return Domain(len(elements), domain.outer, domain.places[elements], columns)


def inner_domain(outer: Domain, places: Integers) -> Domain:
    """Elements of their own, which stand at some places of a domain."""
    return Domain(len(places), outer, places, tuple(column[places] for column in outer.indices))
