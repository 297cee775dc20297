"""Elaboration: arrays of agents are divided into blocks of elements that are coupled alike, and every agent gets its parameters.

In: the outline of the model. Out: instances in text order, each after the agent that contains it, and the parameters. Guaranteed: the elements of a block
agree in their structural parameters and in every decision (`decisions.py`) of their couplings and arguments; nothing is done element by element.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from hierc.compiler.arrays.columns import Column, Integers
from hierc.compiler.arrays.domains import Domain, array_domain, chosen
from hierc.compiler.arrays.errors import EmptyArray, NegativeIndex, TooManyPatterns
from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.resolve.errors import TooManyInstances
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.evaluate import known_integer
from hierc.compiler.structure.decisions import choices, differing, divided, tried
from hierc.compiler.structure.instances import Array, Instance, inside
from hierc.compiler.structure.parameters import ParameterBuilder, Parameters
from hierc.grammar import tree

#: Most elements of all arrays of a model.
MAX_ELEMENTS = 1_000_000
#: Most blocks of one array.
MAX_PATTERNS = 256


def elaborate(
    context: Context, outline: Sequence[Instance], builder: ParameterBuilder
) -> tuple[tuple[Instance, ...], Parameters]:
    """All agents, arrays in blocks, and their parameters. Problems go to the collector; raises Rejected where there are too many elements."""
    return _Elaboration(context, outline, builder).result()


class _Elaboration:
    """Makes instances one after the other, each after its parent, with its parameters."""

    def __init__(self, context: Context, outline: Sequence[Instance], builder: ParameterBuilder) -> None:
        self._context = context
        self._outline = outline
        self._builder = builder
        self._made: list[Instance] = []
        self._children: list[dict[str, int]] = []
        self._arrays: list[dict[str, Array]] = []
        self._elements = 0

    def result(self) -> tuple[tuple[Instance, ...], Parameters]:
        blocks: list[list[int]] = []
        for here in self._outline:
            if here.parent is None:
                blocks.append([self._add(here)])
                continue
            name = here.instance.name.text if here.instance is not None else ""
            found: list[int] = []
            for parent in blocks[here.parent]:
                try:
                    found += self._in(self._made[parent], name, here.id)
                except Rejected as rejection:
                    self._context.problems.rejected(rejection)
            blocks.append(found)
        instances = tuple(
            replace(i, children=self._children[i.id], arrays=self._arrays[i.id]) for i in self._made
        )
        return instances, self._builder.result()

    def _add(self, instance: Instance) -> int:
        self._made.append(instance)
        self._children.append({})
        self._arrays.append({})
        self._builder.add(instance)
        return instance.id

    def _in(self, parent: Instance, name: str, outline: int) -> list[int]:
        """The sub-agent `name` of an agent: one instance, or the blocks of an array."""
        sub = parent.agent.subs[name].instance
        if sub.index is None:
            here = inside(self._context.library, parent, name, len(self._made), outline, parent.domain)
            self._children[parent.id][name] = here.id
            return [self._add(here)]
        env = self._builder.environment(parent.id, parent.domain)
        first, last = (
            known_integer(end, env, "end of a range") for end in (sub.index.range.first, sub.index.range.last)
        )
        size = last - first + 1
        if size < 1:
            raise Rejected(EmptyArray(sub.index.range.span, name=name, first=first, last=last))
        if first < 0:
            raise Rejected(NegativeIndex(sub.index.range.first.span, name=name, first=first))
        self._count(sub, parent.domain.count, size)
        whole = array_domain(parent.domain, first, size)
        slots = self._patterns(parent, sub, whole)
        found = []
        for places in slots:
            domain = chosen(whole, places)
            here = inside(self._context.library, parent, name, len(self._made), outline, domain)
            found.append(self._add(here))
        self._arrays[parent.id][name] = Array(first, size, tuple(found), tuple(slots))
        return found

    def _count(self, sub: tree.Instance, outer: int, size: int) -> None:
        self._elements += outer * size
        if self._elements > MAX_ELEMENTS:
            product = f"{outer} x {size}" if outer > 1 else str(size)
            raise Rejected(
                TooManyInstances(
                    sub.name.span,
                    agent=sub.name.text,
                    count=self._elements,
                    limit=MAX_ELEMENTS,
                    product=product,
                )
            )

    def _patterns(self, parent: Instance, sub: tree.Instance, whole: Domain) -> list[Integers]:
        """The places in `whole` of the elements of each block, in the order of their first ones."""
        structural = self._builder.structural(sub.agent.text)
        arrays = [name for name, other in parent.agent.subs.items() if other.instance.index is not None]

        def decisions(part: Domain) -> Iterator[Column]:
            return _decisions(sub, structural, self._builder.environment(parent.id, part, sub.index), arrays)

        def refusal(count: int) -> Rejected:
            name = sub.name
            return Rejected(TooManyPatterns(name.span, name=name.text, count=count, limit=MAX_PATTERNS))

        return divided(whole, decisions, MAX_PATTERNS, refusal)


def _decisions(
    sub: tree.Instance, structural: frozenset[str], env: Environment, arrays: Collection[str]
) -> Iterator[Column]:
    """What differs between elements and decides how they are built: the first thing found is enough to divide them."""
    for arg in sub.args:
        yield from choices(arg.value, env)
        if arg.name.text in structural and (value := tried(arg.value, env)) is not None:
            yield from differing(value)
    for bind in sub.bindings:
        yield from choices(bind.value, env, arrays)
