"""Channels: what others read of the nodes of each class, and whether they find it among the states.

In: sources with columns, and the class of each block. Out: `Keys` of each class. Guaranteed: what the elements of one source find is a state for all
of them or for none, whatever classes they belong to; where it is a state in one class only, it is computed in the others as well as in that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal

from hierc.compiler.arrays.elements import Elements
from hierc.compiler.model import Source

#: A scalar of a node that others name: a rate by its state, an algebraic variable by its definition.
Key = tuple[Literal["state", "rate", "local"], int]
#: Of one class: what others name, in a fixed order, and whether it is a channel of its own even where it is just a state.
Keys = Mapping[Key, bool]
#: A key of a class.
Known = tuple[int, Key]


def keys(
    sources: Iterable[tuple[Source, int]],
    elements: Elements,
    kinds: Sequence[int],
    classes: int,
    is_state: Callable[[int, Key], bool],
) -> list[Keys]:
    """The keys of each class; `sources` with their counts of elements, `kinds` the classes of blocks."""
    together = {_known(source, count, elements, kinds) for source, count in sources}
    found = frozenset(known for some in together for known in some)
    computed = {known for known in found if not is_state(*known)}
    mixed = [some for some in together if len(some) > 1]
    while spread := {known for some in mixed if some & computed for known in some} - computed:
        computed |= spread
    result: list[dict[Key, bool]] = [{} for _ in range(classes)]
    for kind, key in sorted(found):
        result[kind][key] = (kind, key) in computed and is_state(kind, key)
    return list(result)


def _known(source: Source, count: int, elements: Elements, kinds: Sequence[int]) -> frozenset[Known]:
    """What the elements of a source find."""
    return frozenset((kinds[block], (source.kind, index)) for block, index in elements.touched(source, count))
