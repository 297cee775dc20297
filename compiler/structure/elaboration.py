"""Elaboration: arrays of agents are divided into blocks of elements that are coupled alike, and every agent gets its parameters.

In: the outline of the model. Out: instances in text order, each after the agent that contains it, and the parameters. Guaranteed: the elements of a block
agree in their structural parameters, in every condition on indices that its couplings and arguments decide by, and in the lengths of slices; nothing is
done element by element.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers, added, difference
from hierc.compiler.arrays.domains import Domain, array_domain, chosen
from hierc.compiler.arrays.errors import EmptyArray, NegativeIndex, TooManyPatterns
from hierc.compiler.collector import Rejected
from hierc.compiler.context import Context
from hierc.compiler.expression import Gather
from hierc.compiler.resolve.errors import TooManyInstances
from hierc.compiler.shapes.environment import Environment, Values
from hierc.compiler.shapes.evaluate import evaluate, index_in, known_integer
from hierc.compiler.shapes.folding import constant
from hierc.compiler.shapes.values import Value, index_value, scalar_of
from hierc.compiler.structure.instances import Array, Instance, inside
from hierc.compiler.structure.parameters import ParameterBuilder, Parameters
from hierc.compiler.walk import Visit, below
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
        waiting = [np.arange(whole.count)]
        found: list[Integers] = []
        while waiting:
            places = waiting.pop()
            domain = chosen(whole, places)
            env = self._builder.environment(parent.id, domain, sub.index)
            decision = next(_decisions(sub, structural, env), None)
            if decision is None:
                found.append(places)
            else:
                values = np.unique(decision.values)
                waiting += [places[decision.values == value] for value in values[::-1].tolist()]
            if len(found) + len(waiting) > MAX_PATTERNS:
                count = len(found) + len(waiting)
                raise Rejected(
                    TooManyPatterns(sub.name.span, name=sub.name.text, count=count, limit=MAX_PATTERNS)
                )
        return sorted(found, key=lambda places: int(places[0]))


def _decisions(sub: tree.Instance, structural: frozenset[str], env: Environment) -> Iterator[Column]:
    """What differs between elements and decides how they are built: the first thing found is enough to divide them."""
    for arg in sub.args:
        yield from _choices(arg.value, env)
        if arg.name.text in structural and (value := _tried(arg.value, env)) is not None:
            yield from _differing(value)
    for bind in sub.bindings:
        yield from _choices(bind.value, env)


def _differing(value: Value) -> Iterator[Column]:
    """The elements of a value that are known when compiling, and differ."""
    for element in value.elements:
        if isinstance(element, Gather) and element.kind == "index" and isinstance(element.at, Column):
            yield element.at


def _choices(expr: tree.Expr, env: Environment) -> Iterator[Column]:
    """Conditions on indices, and lengths of ranges, that differ between elements. A branch that is not taken is not looked at; lists are looked at
    index by index, and functions with their arguments.
    """
    stack = [_Place(expr, env, 0)]
    while stack:
        here = stack.pop()
        node = here.node
        for range_ in _ranges(node):
            yield from _length(range_, here.env)
        match node:
            case tree.Cond(condition=condition) if (test := _tried(condition, here.env)) is not None:
                yield from _differing(test)
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
                stack += [
                    replace(here, node=visit_.node) for visit_ in below(Visit(node, frozenset(), False, 1))
                ]


@dataclass(frozen=True, slots=True)
class _Place:
    """A part of an expression on the way through it, and what is known there; `calls`: how many functions it is inside of."""

    node: tree.Expr
    env: Environment
    calls: int


#: Indices of a list that are looked at one by one, and functions in functions.
MAX_INDICES, MAX_CALLS = 100, 8


def _inside(func: tree.Func, args: tuple[tree.Expr, ...], env: Environment) -> Environment:
    """What is known in the body of a function: the arguments that are, and constants."""
    inner = replace(env, scope=Values(env.constants), indices={})
    for param, arg in zip(func.params, args, strict=False):
        value = _tried(arg, env)
        if value is not None:
            inner = inner.bind(param.name.text, value)
    return inner


def _tried(expr: tree.Expr, env: Environment) -> Value | None:
    """The value of a scalar that is known when compiling; None for any other. What is wrong with it is reported where it is used."""
    try:
        value = evaluate(expr, env)
    except Rejected:
        return None
    known = value.shape == () and (constant(value.single) is not None or any(_differing(value)))
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
    ends = [_tried(end, env) for end in (range_.first, range_.last)]
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
