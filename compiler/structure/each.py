"""Values that an experiment gives to agents of arrays: one for all of them, or one for each.

In: a gift, and the block of an array that it goes to. Out: one value, which may differ from element to element. `car.T = 2` gives all cars one value,
`car[2..3].T = [2, 3]` one each, and so does `car.T = [i/2 for i in 1..N]`, whose item is evaluated once, however many cars there are. An array in an
array takes a list of lists. Raises Rejected (E802) where a list has another length than what it is given to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hierc.compiler.arrays.columns import Integers, column
from hierc.compiler.arrays.errors import CountsDiffer
from hierc.compiler.collector import Rejected
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.evaluate import evaluate, known_integer
from hierc.compiler.shapes.picking import gathered
from hierc.compiler.shapes.values import Value, index_value, number, scalar_of, size_of
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.paths import Gift, Sub
from hierc.grammar import tree


@dataclass(frozen=True, slots=True)
class _Axis:
    """An array of which several agents are given something: how many, and the place of each element of a block among them."""

    size: int
    places: Integers


def given(gift: Gift, rank: int, to: Instance, around: Sequence[range], env: Environment) -> Value:
    """What the elements of a block get, for a parameter or state of this rank. `around`: the indices of each array around them, from the outside."""
    several = [sub is None or isinstance(sub, tree.Range) for sub in gift.elements]
    if not is_for_each(gift, rank, env):
        return evaluate(gift.value, env)
    sides = zip(several, gift.elements, around, to.domain.indices, strict=True)
    axes = [_axis(sub, whole, own, env) for chosen, sub, whole, own in sides if chosen]
    return _each(gift, gift.value, axes, env)


def is_for_each(gift: Gift, rank: int, env: Environment) -> bool:
    """Whether a gift has a value for each of several agents, for a parameter or state of this rank."""
    several = sum(sub is None or isinstance(sub, tree.Range) for sub in gift.elements)
    return several > 0 and _rank(gift.value, env) == rank + several


def indices_around(
    instance: Instance, instances: Sequence[Instance], env: Callable[[Instance], Environment]
) -> list[range]:
    """The indices of each array around an agent, from the outside. `env`: the scope of an agent's sizes."""
    found: list[range] = []
    at = instance
    while at.parent is not None and at.instance is not None:
        parent = instances[at.parent]
        if (over := at.instance.index) is not None:
            ends = [
                known_integer(e, env(parent), "end of a range") for e in (over.range.first, over.range.last)
            ]
            found.append(range(ends[0], ends[1] + 1))
        at = parent
    return found[::-1]


def _axis(sub: Sub | None, whole: range, own: Integers, env: Environment) -> _Axis:
    if isinstance(sub, tree.Range):
        first, last = (known_integer(end, env, "index") for end in (sub.first, sub.last))
        whole = range(first, last + 1)
    # Elements that are not meant get something that nobody looks at.
    return _Axis(len(whole), np.clip(own - whole.start, 0, max(len(whole) - 1, 0)))


def _rank(expr: tree.Expr, env: Environment) -> int:
    """How many subscripts the value of an expression takes. Of the items of a long list only the first is looked at."""
    if not isinstance(expr, tree.Comprehension):
        return len(evaluate(expr, env).shape)
    first = known_integer(expr.over.range.first, env, "end of a range")
    return 1 + _rank(expr.item, env.bind(expr.over.index.text, number(first, "int")))


def _each(gift: Gift, expr: tree.Expr, axes: Sequence[_Axis], env: Environment) -> Value:
    """What elements get of a list with an axis for each of `axes`, and perhaps more."""
    if not axes:
        return evaluate(expr, env)
    if isinstance(expr, tree.Comprehension):
        ends = (expr.over.range.first, expr.over.range.last)
        first, last = (known_integer(end, env, "end of a range") for end in ends)
        _check_count(gift, axes[0], max(last + 1 - first, 0), expr)
        index = scalar_of("int", index_value(column(first + axes[0].places), expr.over.index.span))
        return _each(gift, expr.item, axes[1:], env.bind(expr.over.index.text, index))
    value = evaluate(expr, env)
    rest = value.shape[len(axes) :]
    places = np.zeros_like(axes[0].places)
    for axis, size in zip(axes, value.shape, strict=False):
        _check_count(gift, axis, size, expr)
        places = places * size + axis.places
    width = size_of(rest)
    scalars = (gathered(value.elements, places * width + k, expr.span, env) for k in range(width))
    return Value(value.scalar, rest, tuple(scalars))


def _check_count(gift: Gift, axis: _Axis, count: int, list_: tree.Expr) -> None:
    if count != axis.size:
        raise Rejected(CountsDiffer(list_.span, text=gift.path.span.text, wanted=axis.size, given=count))
