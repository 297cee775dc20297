"""Decisions: what differs between elements of an array and decides how they are built.

In: an expression, and what its elements know when compiling: indices, structural parameters. Out: columns, of conditions that come out differently and of
ranges that differ in length; elements for which there are none agree in everything that the equations made of the expression depend on. A branch that is
not taken is not looked at; lists are looked at index by index, and functions with their arguments.

Lengths do not decide where a sum or an extreme is over slices of many lengths: these are joined by nodes of their own, see `slices.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers, added, difference
from hierc.compiler.arrays.domains import Domain, chosen
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Gather
from hierc.compiler.shapes.environment import REDUCTIONS, Environment, Values
from hierc.compiler.shapes.evaluate import evaluate, index_in
from hierc.compiler.shapes.folding import constant
from hierc.compiler.shapes.values import Value, index_value, scalar_of
from hierc.compiler.walk import Visit, below, visit
from hierc.grammar import tree

#: Lengths of the slices that a sum is over up to which elements are divided by them, and each sum is written out.
FEW_LENGTHS = 8
#: Indices of a list that are looked at one by one, and functions in functions.
MAX_INDICES, MAX_CALLS = 100, 8


def differing(value: Value) -> Iterator[Column]:
    """The elements of a value that are known when compiling, and differ."""
    for element in value.elements:
        if isinstance(element, Gather) and element.kind == "index" and isinstance(element.at, Column):
            yield element.at


def divided(
    whole: Domain,
    decisions: Callable[[Domain], Iterator[Column]],
    limit: int,
    refusal: Callable[[int], Rejected],
) -> list[Integers]:
    """The places in `whole` of elements for which there are no decisions, in the order of their first ones. Raises `refusal` for more than `limit`."""
    waiting = [np.arange(whole.count)]
    found: list[Integers] = []
    while waiting:
        places = waiting.pop()
        decision = next(decisions(chosen(whole, places)), None)
        if decision is None:
            found.append(places)
        else:
            values = np.unique(decision.values)
            waiting += [places[decision.values == value] for value in values[::-1].tolist()]
        if (count := len(found) + len(waiting)) > limit:
            raise refusal(count)
    return sorted(found, key=lambda places: int(places[0]))


def choices(expr: tree.Expr, env: Environment, arrays: Collection[str] = ()) -> Iterator[Column]:
    """Conditions on indices, and lengths of ranges, that differ between elements. `arrays`: those whose slices nodes may join."""
    free: set[int] = set()  # ids of ranges whose lengths do not decide
    stack = [_Place(expr, env, 0)]
    while stack:
        here = stack.pop()
        node = here.node
        for range_ in _ranges(node):
            if id(range_) not in free:
                yield from _length(range_, here.env)
        match node:
            case tree.Cond(condition=condition) if (test := tried(condition, here.env)) is not None:
                yield from differing(test)
                taken = node.then if constant(test.single) else node.other
                stack += [replace(here, node=part) for part in (taken, condition)]
            case tree.Comprehension(over=over) if (numbers := _numbers(over.range, here.env)) is not None:
                inner = [here.env.bind(over.index.text, scalar_of("int", index_value(k))) for k in numbers]
                stack += [replace(here, node=node.item, env=each) for each in inner]
            case tree.Call(function=function, args=args) if function.text in here.env.library.funcs:
                stack += [replace(here, node=arg) for arg in args]
                if here.calls < MAX_CALLS:
                    func = here.env.library.funcs[function.text]
                    stack.append(_Place(func.body, _inside(func, args, here.env), here.calls + 1))
            case _:
                if isinstance(node, tree.Call):
                    free |= {id(range_) for range_ in _joined(node, here.env, arrays)}
                stack += [
                    replace(here, node=visit_.node) for visit_ in below(Visit(node, frozenset(), False, 1))
                ]


def _joined(call: tree.Call, env: Environment, arrays: Collection[str]) -> Iterator[tree.Range]:
    """The range of agents that a sum or an extreme is over, where it has many lengths."""
    if call.function.text not in REDUCTIONS or len(call.args) != 1:
        return
    match call.args[0]:
        case tree.Ref(path=path) if len(path.steps) == 2 and path.steps[0].name.text in arrays:
            subs = [step.subs[0] for step in path.steps if step.subs]
            found = [sub for sub in subs if isinstance(sub, tree.Range)] if len(subs) == 1 else []
        case tree.Comprehension(item=item, over=over) if names_any(item, arrays) and not depends(item, env):
            found = [over.range]
        case _:
            found = []
    for range_ in found:
        if any(len(np.unique(lengths.values)) > FEW_LENGTHS for lengths in _length(range_, env)):
            yield range_


def names_any(expr: tree.Expr, arrays: Collection[str]) -> bool:
    """Whether an expression names agents of arrays."""
    refs = (here.node.path.steps for here in visit(expr) if isinstance(here.node, tree.Ref))
    return any(steps[0].name.text in arrays for steps in refs)


def depends(expr: tree.Expr, env: Environment) -> bool:
    """Whether an expression uses an index that differs between elements."""
    indices = {name for name, value in env.indices.items() if any(differing(value))}
    return any(
        here.node.path.steps[0].name.text in indices - here.bound
        for here in visit(expr)
        if isinstance(here.node, tree.Ref)
    )


@dataclass(frozen=True, slots=True)
class _Place:
    """A part of an expression on the way through it, and what is known there; `calls`: how many functions it is inside of."""

    node: tree.Expr
    env: Environment
    calls: int


def _inside(func: tree.Func, args: tuple[tree.Expr, ...], env: Environment) -> Environment:
    """What is known in the body of a function: the arguments that are, and constants."""
    inner = replace(env, scope=Values(env.constants), indices={})
    for param, arg in zip(func.params, args, strict=False):
        value = tried(arg, env)
        if value is not None:
            inner = inner.bind(param.name.text, value)
    return inner


def tried(expr: tree.Expr, env: Environment) -> Value | None:
    """The value of a scalar that is known when compiling; None for any other. What is wrong with it is reported where it is used."""
    try:
        value = evaluate(expr, env)
    except Rejected:
        return None
    known = value.shape == () and (constant(value.single) is not None or any(differing(value)))
    return value if known else None


def _ranges(node: tree.Expr) -> list[tree.Range]:
    match node:
        case tree.Ref(path=path):
            return [sub for step in path.steps for sub in step.subs if isinstance(sub, tree.Range)]
        case tree.Comprehension(over=over):
            return [over.range]
        case _:
            return []


def _ends(range_: tree.Range, env: Environment) -> tuple[Index, Index] | None:
    ends = [tried(end, env) for end in (range_.first, range_.last)]
    first, last = (None if end is None else index_in(end) for end in ends)
    return None if first is None or last is None else (first, last)


def _length(range_: tree.Range, env: Environment) -> Iterator[Column]:
    """The length of a range, if it differs between elements."""
    ends = _ends(range_, env)
    if ends is not None and isinstance(length := difference(ends[1], ends[0]), Column):
        yield length


def _numbers(range_: tree.Range, env: Environment) -> list[Index] | None:
    """The indices of a short range whose length is known."""
    ends = _ends(range_, env)
    length = None if ends is None else difference(ends[1], ends[0])
    if ends is None or not isinstance(length, int) or length >= MAX_INDICES:
        return None
    return [added(ends[0], k) for k in range(length + 1)]
