"""Initial values: in which order the `start` functions run over all elements, and how often.

In: blocks of nodes with the places of their inputs. Out: the order (None: by number) and the passes. Guaranteed: after that many passes all initial values
are final. One pass is enough unless elements need each other's; then they run by number, as often as it takes.

A pass visits each element once: its inputs are gathered, its initial values set, its outs evaluated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hierc.compiler.arrays.columns import Index, Integers, column, expanded
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.emission.calls import Block
from hierc.compiler.emission.sequence import Circular, Link, sequence
from hierc.compiler.symbolic.derive import Form


def start(blocks: Sequence[Block], forms: Sequence[Form], elements: Elements) -> tuple[int, Index | None]:
    """How many passes over the elements, in which order."""
    starting = _Start(blocks, forms, elements)
    if starting.follows_numbers():
        return 1, None
    try:
        return 1, starting.order()
    except Circular:
        return starting.passes(), None


class _Start:
    def __init__(self, blocks: Sequence[Block], forms: Sequence[Form], elements: Elements) -> None:
        self._blocks = blocks
        self._elements = elements
        self._forms = [forms[block.kind] for block in blocks]
        self._outs: list[set[int]] = [set() for _ in blocks]  # that initial values read
        self._inputs = [{k for needs in form.initial_needs for k in needs} for form in self._forms]
        self._find()

    def _find(self) -> None:
        """The inputs that initial values need, through outs of others."""
        waiting = [(b, k) for b, inputs in enumerate(self._inputs) for k in inputs]
        while waiting:
            block, k = waiting.pop()
            for other, out in self._read(block, k):
                if out not in self._outs[other]:
                    self._outs[other].add(out)
                    new = self._forms[other].outs[out].inputs - self._inputs[other]
                    self._inputs[other] |= new
                    waiting += [(other, n) for n in sorted(new)]

    def _read(self, block: int, k: int) -> list[tuple[int, int]]:
        """The outs, by their blocks, that an input reads."""
        node, kind, index = self._blocks[block].sources[k]
        if kind != "out":
            return []
        count = self._blocks[block].count
        pairs = np.stack([self._elements.blocks(expanded(node, count)), expanded(index, count)])
        return [(other, out) for other, out in np.unique(pairs, axis=1).T.tolist()]

    def _sources(self) -> Iterator[tuple[int, Integers]]:
        """Each input that is needed: its block, and the element that each of the block's elements reads."""
        for b, inputs in enumerate(self._inputs):
            for k in sorted(inputs):
                yield b, expanded(self._blocks[b].sources[k][0], self._blocks[b].count)

    def follows_numbers(self) -> bool:
        """Whether all elements need only elements before them."""
        return all((numbers < self._numbers(b)).all() for b, numbers in self._sources())

    def order(self) -> Index:
        """An order in which elements need only elements before them. Raises Circular."""
        links = []
        for b, numbers in self._sources():
            blocks = self._elements.blocks(numbers)
            for other in np.unique(blocks).tolist():
                readers = np.flatnonzero(blocks == other)
                links.append(Link(b, other, readers, numbers[readers] - self._blocks[other].first))
        sizes = [block.count for block in self._blocks]
        pieces = sequence(sizes, links, range(len(sizes)))
        return column(np.concatenate([self._blocks[b].first + items for b, items in pieces]))

    def _numbers(self, block: int) -> Integers:
        """The numbers of a block's elements."""
        b = self._blocks[block]
        return b.first + np.arange(b.count)

    def passes(self) -> int:
        """The passes that runs by number take: how often each scalar is set until it is final, found by repeating that until nothing changes."""
        states, outs = (
            self._bases(len(f.states) for f in self._forms),
            self._bases(len(f.outs) for f in self._forms),
        )
        of_state, of_out = np.ones(states[1], np.int64), np.ones(outs[1], np.int64)

        def through(b: int, inputs: frozenset[int]) -> Integers:
            """When the inputs are final for visits of a block's elements: an element sees what came before it in the same pass."""
            late = np.ones(self._blocks[b].count, np.int64)
            for k in inputs:
                node, kind, index = self._blocks[b].sources[k]
                numbers, indices = (expanded(i, len(late)) for i in (node, index))
                bases, passes = (states, of_state) if kind == "state" else (outs, of_out)
                late = np.maximum(late, passes[bases[0][numbers] + indices] + (numbers >= self._numbers(b)))
            return late

        for _ in range(len(of_state) + len(of_out) + 1):
            before = of_state.copy(), of_out.copy()
            for b, form in enumerate(self._forms):
                own = self._numbers(b)
                for i, needs in enumerate(form.initial_needs):
                    of_state[states[0][own] + i] = through(b, needs)
                for o in self._outs[b]:
                    needed = [of_state[states[0][own] + i] for i in form.outs[o].states]
                    of_out[outs[0][own] + o] = np.max([through(b, form.outs[o].inputs), *needed], axis=0)
            if (of_state == before[0]).all() and (of_out == before[1]).all():
                return int(of_state.max())
        raise ValueError("initial values need each other")

    def _bases(self, sizes: Iterator[int]) -> tuple[Integers, int]:
        """Where each element's scalars begin if there are so many in each element of a block; how many in all."""
        widths = np.repeat(list(sizes), [block.count for block in self._blocks])
        ends = np.cumsum(widths)
        return ends - widths, int(ends[-1])
