"""Picking: what each element of an array of agents takes from a vector or matrix by subscripts that differ from element to element."""

from __future__ import annotations

import numpy as np

from hierc.compiler.arrays.columns import Index, Integers, column, expanded
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Choose, Expr, Gather, Number
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.errors import IndexOutside, WrongIndexCount
from hierc.compiler.shapes.values import Value, index_value
from hierc.grammar import tree
from hierc.grammar.source import Span


def picked(ref: tree.Ref, value: Value, indices: list[list[Index]], env: Environment) -> Value:
    """What each element of an array picks from a vector or matrix by subscripts that differ from element to element."""
    last, count = ref.path.steps[-1], _common_length(indices)
    if len(indices) != len(value.shape):
        name, wanted = ref.path.text, len(value.shape)
        raise Rejected(
            WrongIndexCount(last.span, name=name, type=value.type, wanted=wanted, given=len(indices))
        )
    places = [np.zeros(count, np.int64)]
    for axis, (choice, size) in enumerate(zip(indices, value.shape, strict=True), start=1):
        columns = [expanded(index, count) for index in choice]
        for column_ in columns:
            if (outside := (column_ < 1) | (column_ > size)).any():
                wrong = str(int(column_[np.argmax(outside)]))
                raise Rejected(
                    IndexOutside(
                        last.subs[axis - 1].span,
                        name=ref.path.text,
                        sizes=value.shape,
                        index=wrong,
                        axis=axis,
                    )
                )
        places = [place * size + column_ - 1 for place in places for column_ in columns]
    shape = tuple(
        len(choice) for choice, sub in zip(indices, last.subs, strict=True) if isinstance(sub, tree.Range)
    )
    return Value(
        value.scalar, shape, tuple(gathered(value.elements, place, ref.span, env) for place in places)
    )


def _common_length(indices: list[list[Index]]) -> int:
    return next(len(index) for axis in indices for index in axis if not isinstance(index, int))


#: Expressions that the elements of an array may choose between, where they are not variables, parameters or numbers.
MAX_CHOICES = 1_000


def gathered(elements: tuple[Expr, ...], places: Integers, span: Span, env: Environment) -> Expr:
    """One scalar in which each element of an array takes the one of `elements` at its own place."""
    assert env.gathering is not None
    used, which = np.unique(places, return_inverse=True)
    leaves = [env.gathering.leaf(elements[place]) for place in used.tolist()]
    if len(leaves) == 1:
        return elements[int(used[0])]
    numbers = [leaf.value for leaf in leaves if isinstance(leaf, Number)]
    if len(numbers) == len(leaves):
        if all(number.is_integer() for number in numbers):
            return index_value(column(np.array(numbers).astype(np.int64)[which]), span)
        return Gather(span, "parameter", column(env.gathering.table(tuple(numbers)) + which))
    gathers = [leaf for leaf in leaves if isinstance(leaf, Gather)]
    if len(gathers) == len(leaves) and len({gather.kind for gather in gathers}) == 1:
        table = np.stack([expanded(gather.at, len(places)) for gather in gathers])
        return Gather(span, gathers[0].kind, column(table[which, np.arange(len(places))]))
    if len(leaves) > MAX_CHOICES:
        raise Rejected(
            ModelTooLarge(span, what=f"a choice of {len(leaves)} expressions by an index", limit=MAX_CHOICES)
        )
    chosen = elements[int(used[-1])]
    for place in used[-2::-1].tolist():
        here = index_value(column((places == place).astype(np.int64)), span)
        chosen = Choose(span, here, elements[place], chosen)
    return chosen
