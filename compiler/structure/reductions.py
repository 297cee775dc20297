"""Reductions: sums and extremes over many agents of an array, made of nodes of their own, which all who ask for the same share.

In: a call of `sum`, `min` or `max` of a variable of agents, or of an expression for each of many indices. Out: its value; None where there is nothing to be
gained, because it is over few, or for each element over something else: then it is written out. Slices whose length differs between elements are
never written out. Part of the phase `flatten.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Column, Index, Integers, added, column, difference, expanded
from hierc.compiler.arrays.domains import Domain, chosen, indexed_domain
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Expr, Gather
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes.environment import REDUCTIONS, Axis, Chosen, Ends, Environment
from hierc.compiler.shapes.errors import WrongArguments
from hierc.compiler.shapes.evaluate import evaluate
from hierc.compiler.shapes.values import (
    Scalar,
    Shape,
    Value,
    index_value,
    joined,
    number,
    scalar_of,
    size_of,
    type_text,
)
from hierc.compiler.structure.array_reads import Reader, View
from hierc.compiler.structure.decisions import choices, depends, differing, divided, names_any
from hierc.compiler.structure.fan_in import FEW
from hierc.compiler.structure.instances import Array
from hierc.compiler.structure.slices import Slices
from hierc.compiler.structure.storage import Kind
from hierc.grammar import tree

#: Most kinds of indices that an expression is evaluated for one by one.
MAX_KINDS = 256


@dataclass(frozen=True, slots=True)
class _Terms:
    """What is joined: scalars of one kind, shape (elements of the agent, indices, scalars for each)."""

    scalar: Scalar
    kind: Kind
    numbers: Integers


@dataclass(frozen=True, slots=True)
class Reductions:
    """What an agent, or elements of an array inside it, reduce."""

    reader: Reader

    def of_variable(
        self, call: tree.Call, ref: tree.Ref, agents: Axis | None, axes: Sequence[Axis]
    ) -> Value | None:
        """See `environment.Scope.reduced`."""
        array = self.reader.instance.arrays.get(ref.path.steps[0].name.text)
        if array is None or not (agents is None or isinstance(agents, Ends)):
            return None
        name, kind = self.reader.variable(ref, array)
        shape = self.reader.shape(array, name, ref)
        ends = _rows(array, agents, axes)
        scalars = _scalars(shape, axes)
        if ends is None or scalars is None or _are_few(ends, len(scalars)):
            return None
        self._check(call, ref, array, ends)
        tables = self.reader.tables(array, name, shape)
        numbers = np.stack([tables[k].reshape(-1, array.size) for k in scalars], axis=2)
        first, last = (added(end, -array.first) for end in ends)
        return self._joined(call, _Terms("real", kind, numbers), first, last)

    def of_expression(
        self, call: tree.Call, comprehension: tree.Comprehension, indices: Axis, env: Environment
    ) -> Value | None:
        """See `environment.Scope.reduced_over`. The expression is evaluated once, for elements that have nothing but their index."""
        arrays = self.reader.instance.arrays
        if not isinstance(indices, Ends) or not names_any(comprehension.item, arrays):
            return None
        ends = indices.first, indices.last
        if _are_few(ends, 1) or depends(comprehension.item, env):
            return None
        first, last = (expanded(end, self.reader.domain.count) for end in ends)
        there = first <= last
        self._check_extent(call, there)
        if not there.any():
            return number(0, "int", call.span)
        low, high = int(first[there].min()), int(last[there].max())
        terms = self._each(comprehension, np.arange(low, high + 1), env, alone=indices.length is None)
        if terms is None:
            return None
        return self._joined(call, terms, added(ends[0], -low), added(ends[1], -low))

    def _joined(self, call: tree.Call, terms: _Terms, first: Index, last: Index) -> Value:
        """The terms from `first` to `last`, counted from 0, of each element that looks."""
        operation, around, span = REDUCTIONS[call.function.text], self.reader.instance, call.args[0].span
        fan_ins, (rows, _, size) = self.reader.owner.fan_ins, terms.numbers.shape
        if isinstance(first, int) and isinstance(last, int):
            joined = terms.numbers[:, first : last + 1].reshape(rows, -1)
            made = fan_ins.joined(operation, terms.kind, joined, around, span)
            return scalar_of(terms.scalar, self.reader.seen(made, span))
        count = self.reader.domain.count
        slices = Slices(
            self.reader.places, expanded(first, count) * size, expanded(last, count) * size + size - 1
        )
        made = fan_ins.sliced(operation, terms.kind, terms.numbers.reshape(rows, -1), slices, around, span)
        return scalar_of(terms.scalar, Gather(span, "algebraic", column(made)))

    def _check(self, call: tree.Call, ref: tree.Ref, array: Array, ends: tuple[Index, Index]) -> None:
        """Refuse slices that reach out of the array, and extremes of nothing."""
        count = self.reader.domain.count
        there = expanded(ends[0], count) <= expanded(ends[1], count)
        self._check_extent(call, there)
        for end in ends:  # an empty slice reaches nowhere, wherever its ends are
            wanted = column(
                np.where(there, np.minimum(expanded(end, count), array.first + array.size), array.first)
            )
            step = next(step for step in ref.path.steps if step.subs or step is ref.path.steps[-1])
            self.reader.slots(array, wanted, Chosen((), several=True, step=step))

    def _check_extent(self, call: tree.Call, there: NDArray[np.bool_]) -> None:
        """Refuse an extreme that is of nothing in some element."""
        if call.function.text != "sum" and not there.all():
            raise _wrong(call, type_text("real", (0,)))

    def _each(
        self, comprehension: tree.Comprehension, numbers: Integers, env: Environment, *, alone: bool
    ) -> _Terms | None:
        """The expression for each index. None where it cannot be had for all of them; raises Rejected if there is no other way (`alone`)."""
        around, index = self.reader.instance, comprehension.over.index.text
        known = {name: value for name, value in env.indices.items() if not any(differing(value))}
        env = replace(env, indices=known)
        domain = indexed_domain(around.domain, numbers)
        parts: list[tuple[Integers, Domain, Value]] = []
        try:
            for places in self._alike(comprehension.item, domain, index, env):
                part = chosen(domain, places)
                spread = self.reader.owner.spread(around, View(part, part.places, index), env)
                own = scalar_of("int", index_value(column(part.indices[-1])))
                parts.append((places, part, evaluate(comprehension.item, spread.bind(index, own))))
        except Rejected:
            if alone:
                raise
            return None  # what is wrong with it is said for a single index
        return self._gathered(parts, domain.count, comprehension)

    def _alike(self, item: tree.Expr, domain: Domain, index: str, env: Environment) -> list[Integers]:
        """The places of elements for which the expression is made alike."""
        owner, around = self.reader.owner, self.reader.instance

        def decisions(part: Domain) -> Iterator[Column]:
            own = scalar_of("int", index_value(column(part.indices[-1])))
            return choices(item, owner.deciding(around, part, env).bind(index, own), around.arrays)

        def refusal(count: int) -> Rejected:
            what = f"an expression of {count} forms"
            return Rejected(ModelTooLarge(item.span, what=what, limit=MAX_KINDS))

        return divided(domain, decisions, MAX_KINDS, refusal)

    def _gathered(
        self, parts: Sequence[tuple[Integers, Domain, Value]], count: int, comprehension: tree.Comprehension
    ) -> _Terms | None:
        """The values of some elements each as one table; None for what cannot be joined."""
        shape, span = parts[0][2].shape, comprehension.span
        if any(value.shape != shape or value.scalar == "bool" for _, _, value in parts):
            return None
        numbers = np.empty((count, size_of(shape)), np.int64)
        kinds = {_kind(element) for _, _, value in parts for element in value.elements}
        kind = kinds.pop() if len(kinds) == 1 else None
        for places, part, value in parts:
            for k, element in enumerate(value.elements):
                if kind is not None and isinstance(element, Gather):
                    numbers[places, k] = expanded(element.at, len(places))
                else:
                    numbers[places, k] = self.reader.owner.computed(element, self.reader.instance, part, span)
        scalar = joined([value.scalar for _, _, value in parts])
        rows = self.reader.instance.domain.count
        return _Terms(scalar, kind or "algebraic", numbers.reshape(rows, -1, numbers.shape[1]))


def _kind(expr: Expr) -> Kind | None:
    """What a variable of other elements is; None for any other expression."""
    match expr:
        case Gather(kind="state" | "rate" | "algebraic" as kind):
            return kind
        case _:
            return None


def _rows(array: Array, agents: Ends | None, axes: Sequence[Axis]) -> tuple[Index, Index] | None:
    """The first and the last of the agents. None where these are not said by one subscript, or are not there."""
    if agents is not None:
        return None if axes else (agents.first, agents.last)
    if not axes:
        return array.first, array.first + array.size - 1
    first, last = _ends(axes[0])
    if isinstance(first, int) and isinstance(last, int) and not 1 <= first <= last <= array.size:
        return None
    return added(first, array.first - 1), added(last, array.first - 1)


def _scalars(shape: Shape, axes: Sequence[Axis]) -> list[int] | None:
    """The scalars of each agent that subscripts after `car.p` choose; None where they are no such choice. The first of them is of the agents."""
    if not axes:
        return list(range(size_of(shape)))
    if len(axes) != 1 + len(shape):
        return None
    scalars = [0]
    for (first, last), size in zip(map(_ends, axes[1:]), shape, strict=True):
        if not (isinstance(first, int) and isinstance(last, int) and first >= 1 and last <= size):
            return None
        scalars = [place * size + i for place in scalars for i in range(first - 1, last)]
    return scalars


def _ends(axis: Axis) -> tuple[Index, Index]:
    return (axis.first, axis.last) if isinstance(axis, Ends) else (axis, axis)


def _are_few(ends: tuple[Index, Index], size: int) -> bool:
    """Whether slices have one length for all elements, and so few scalars that they are better written out."""
    length = difference(ends[1], ends[0])
    return isinstance(length, int) and (length + 1) * size <= FEW


def _wrong(call: tree.Call, given: str) -> Rejected:
    wanted = (
        "1 vector or matrix" if call.function.text == "sum" else "a vector or matrix, or at least 2 numbers"
    )
    return Rejected(WrongArguments(call.span, function=call.function.text, wanted=wanted, given=(given,)))
