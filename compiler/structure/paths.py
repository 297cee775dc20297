"""Paths: what an experiment names, at any depth: agents, their parameters and states, variables for results, and elements of them.

In: a path as written, and what the model has. Out: what it means. Everything that the paths of an experiment may be is decided here. What cannot be
meant raises Rejected.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Column, Index, Integers, expanded
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.arrays.elements import plain as plain_path
from hierc.compiler.arrays.errors import EmptyArray, NotAnArray, OutOfArray
from hierc.compiler.collector import Rejected
from hierc.compiler.model import Group, Node, Variable
from hierc.compiler.resolve.errors import GivenTwice
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.errors import WrongIndexCount
from hierc.compiler.shapes.evaluate import known_integer, selected, span_of
from hierc.compiler.shapes.values import Shape, element_names, type_text
from hierc.compiler.structure.errors import MatchesNothing, UnknownPath
from hierc.compiler.structure.instances import Instance
from hierc.compiler.suggest import without_level
from hierc.grammar import tree

Sub = tree.Expr | tree.Range


@dataclass(frozen=True, slots=True)
class Named:
    """What a path names: `name` of an agent of the outline, and the subscripts written after it.

    `elements`: for each array on the way the subscript written after it, or None for all of it.
    """

    owner: Instance
    name: str
    subs: tuple[Sub, ...]
    elements: tuple[Sub | None, ...]


@dataclass(frozen=True, slots=True)
class Gift:
    """What an experiment gives to a parameter or state; `elements` as in `Named`."""

    path: tree.Path
    value: tree.Expr
    elements: tuple[Sub | None, ...]

    @property
    def whole(self) -> bool:
        """Whether all elements of all arrays get it."""
        return all(sub is None for sub in self.elements)


def elements_of(elements: Sequence[Sub | None], domain: Domain, env: Environment) -> NDArray[np.bool_]:
    """Which elements of a domain the subscripts of its arrays choose. Raises Rejected for one that is no known integer or lies outside."""
    mask = np.ones(domain.count, np.bool_)
    for sub, own in zip(elements, domain.indices, strict=True):
        if isinstance(sub, tree.Range):
            wanted = span_of(sub, env)
            mask &= (own >= wanted.start) & (own < wanted.stop)
        elif sub is not None:
            mask &= own == known_integer(sub, env, "index")
    return mask


def in_order(
    gifts: Iterable[Gift], domain: Domain, around: Sequence[range], env: Environment
) -> list[tuple[Gift, NDArray[np.bool_]]]:
    """Gifts with the elements of a block that they are for, those for more elements of the array first: so that the one that means fewer holds.

    `around`: the indices of each array around the block. Raises Rejected (E214) where two that mean equally many give something to the same element.
    """
    marked = [(gift, elements_of(gift.elements, domain, env)) for gift in gifts]
    sizes = {id(gift): _meant(gift, around, env) for gift, _ in marked}
    marked.sort(key=lambda pair: -sizes[id(pair[0])])
    for k, (gift, mask) in enumerate(marked):
        for other, others in marked[:k]:
            same = sizes[id(other)] == sizes[id(gift)] and (mask & others).any()
            if same and gift.path.steps[-1].subs == other.path.steps[-1].subs == ():
                raise Rejected(GivenTwice(gift.path.span, name=gift.path.span.text, first=other.path.span))
    return [(gift, mask) for gift, mask in marked if mask.any()]


def _meant(gift: Gift, around: Sequence[range], env: Environment) -> int:
    """How many elements something is given to."""
    return prod(
        len(span_of(sub, env)) if isinstance(sub, tree.Range) else len(whole) if sub is None else 1
        for sub, whole in zip(gift.elements, around, strict=True)
    )


def find(path: tree.Path, instances: Sequence[Instance]) -> Named:
    """The agent that the last name of a path belongs to. Raises Rejected (E910, E806)."""
    at = instances[0]
    elements: list[Sub | None] = []
    for place, step in enumerate(path.steps[:-1]):
        name = step.name.text
        if name not in at.children:
            rest = ".".join(s.name.text for s in path.steps[:place] + path.steps[place + 1 :])
            level = rest if name in at.agent.levels else None
            known = tuple(at.children)
            raise Rejected(
                UnknownPath(step.span, what="agent", path=step.span.text, candidates=known, shorter=level)
            )
        at = instances[at.children[name]]
        is_array = at.instance is not None and at.instance.index is not None
        if step.subs and not is_array:
            raise Rejected(NotAnArray(step.span, name=name, arrays=()))
        if len(step.subs) > 1:
            count = len(step.subs)
            raise Rejected(
                WrongIndexCount(step.span, name=name, type="array of agents", wanted=1, given=count)
            )
        if is_array:
            elements.append(step.subs[0] if step.subs else None)
    last = path.steps[-1]
    return Named(at, last.name.text, last.subs, tuple(elements))


def group_named(path: tree.Path, groups: Sequence[Group], nodes: Sequence[Node], env: Environment) -> str:
    """The group of this name, or the one that all of an agent or level belongs to; the groups of an array together, or some of them.

    Raises Rejected (E910, E801, E805, E806).
    """
    text = path.span.text
    plain = path.text
    known = {plain_path(group.name): group for group in groups}
    if plain in known:
        name = known[plain].name
        columns = _columns([(group.indices, group.count) for group in groups if group.name == name])
        return _with_indices(name, columns, path.steps, env)[0]
    blocks = Elements(node.first for node in nodes)
    found = tuple(
        name
        for name, group in known.items()
        if any(_is_in(nodes[block], plain) for block in _blocks(group, blocks))
    )
    if any(step.subs for step in path.steps):
        found = ()  # it would mean all of the group that the elements are in
    if len(found) != 1:
        shorter = without_level(text, tuple(known))
        raise Rejected(
            UnknownPath(
                path.span, what="group", path=text, candidates=tuple(known), shorter=shorter, several=found
            )
        )
    return found[0]


def _blocks(group: Group, blocks: Elements) -> Iterator[int]:
    """The nodes that have elements in a group."""
    for members in group.nodes:
        numbers = members.values if isinstance(members, Column) else np.array([members])
        yield from np.unique(blocks.blocks(numbers)).tolist()


def _is_in(node: Node, path: str) -> bool:
    """Whether a node is the agent or level of this name, or in it."""
    whole = plain_path(node.path)
    levels = [plain_path(level) for level in node.levels]
    return whole == path or whole.startswith(f"{path}.") or path in levels


def elements(
    subs: tuple[tree.Expr | tree.Range, ...], name: str, shape: Shape, node: tree.Node, env: Environment
) -> tuple[Shape, Sequence[int]]:
    """The shape and the places of the scalars that subscripts choose from a variable; all of them where there are none."""
    if not subs:
        return shape, range(len(element_names(name, shape)))
    return selected(name, type_text("real", shape), shape, subs, node, env)


def recorded(pattern: tree.Pattern, variables: Sequence[Variable], env: Environment) -> list[str]:
    """The names for results that a pattern of `record` matches, elements by their subscripts. Raises Rejected (E904, E303, E801)."""
    steps = pattern.path.steps
    path = pattern.path.text
    by_name: dict[str, list[Variable]] = {}
    for variable in variables:
        by_name.setdefault(plain_path(variable.path), []).append(variable)
    if pattern.star:
        written = [name for name, (first, *_) in by_name.items() if first.access == "write"]
        found = [name for name in written if name.startswith(f"{path}.")]
        if not found:
            owners = dict.fromkeys(name.rpartition(".")[0] for name in written)
            raise Rejected(_no_match(pattern, [f"{owner}.*" for owner in owners if owner]))
        return [_recorded(by_name[name], steps, env)[0] for name in found]
    if path not in by_name:
        raise Rejected(_no_match(pattern, list(by_name)))
    name, chosen = _recorded(by_name[path], steps[:-1], env)
    if not steps[-1].subs:
        return [name]
    # Where they differ in shape, all must have the elements that are named.
    places, *_ = [elements(steps[-1].subs, path, v.shape, pattern.path, env)[1] for v in chosen]
    names = element_names(name, chosen[0].shape)
    return [names[place] for place in places]


def _recorded(
    variables: Sequence[Variable], steps: Sequence[tree.Step], env: Environment
) -> tuple[str, list[Variable]]:
    """The name of what steps choose from all variables of one path, and those of them that have it."""
    columns = _columns([(v.indices, v.count) for v in variables])
    name, mask = _with_indices(variables[0].path, columns, steps, env)
    parts = np.split(mask, np.cumsum([v.count for v in variables])[:-1])
    return name, [v for v, part in zip(variables, parts, strict=True) if part.any()]


def _columns(parts: Sequence[tuple[Sequence[Index], int]]) -> list[Integers]:
    """The indices of all elements, for each array; given those of some with their counts."""
    columns = [[expanded(own, count) for own in indices] for indices, count in parts]
    return [np.concatenate(own) for own in zip(*columns, strict=True)]


def _with_indices(
    path: str, indices: Sequence[Integers], steps: Sequence[tree.Step], env: Environment
) -> tuple[str, NDArray[np.bool_]]:
    """The name of some elements of arrays, from a path such as `car[].x`, the elements' indices for each `[]`, and the steps that choose some; and which
    they are.

    `car[2..5].x`; `car.x` is all of them. Raises Rejected (E801, E805, E806).
    """
    names = path.split(".")
    arrays = [place for place, name in enumerate(names) if name.endswith("[]")]
    shown = [name.removesuffix("[]") for name in names]
    for place, step in enumerate(steps):
        if step.subs and place not in arrays:
            raise Rejected(NotAnArray(step.span, name=step.name.text, arrays=()))
    chosen = [steps[place] if place < len(steps) and steps[place].subs else None for place in arrays]
    found, mask = _numbers(chosen, indices, env)
    for place, numbers in zip(arrays, found, strict=True):
        shown[place] += f"[{'..'.join(map(str, numbers))}]" if numbers else ""
    return ".".join(shown), mask


def check_gift(gift: Gift, blocks: Sequence[Instance], env: Environment) -> None:
    """Whether there are the elements that something is given to, of the agents `blocks`. Raises Rejected (E801, E805)."""
    if gift.whole:
        return
    subscripted = iter(step for step in gift.path.steps[:-1] if step.subs)
    steps = [None if sub is None else next(subscripted) for sub in gift.elements]
    columns = [np.concatenate(own) for own in zip(*(block.domain.indices for block in blocks), strict=True)]
    _numbers(steps, columns, env)


def _numbers(
    steps: Sequence[tree.Step | None], indices: Sequence[Integers], env: Environment
) -> tuple[list[tuple[int, ...]], NDArray[np.bool_]]:
    """The subscripts of arrays, one inside the other, as numbers: an index, the ends of a range, or none where there is no step; and what they choose.

    `indices`: those of all elements, for each array. Raises Rejected (E801) where those chosen so far have no such index, or E805.
    """
    found: list[tuple[int, ...]] = []
    chosen = np.ones(len(indices[0]) if indices else 1, np.bool_)
    for step, own in zip(steps, indices, strict=True):
        if step is None:
            found.append(())
            continue
        sub = step.subs[0]
        ends = (sub.first, sub.last) if isinstance(sub, tree.Range) else (sub,)
        numbers = tuple(known_integer(end, env, "index") for end in ends)
        there = own[chosen]
        first, last = int(there.min()), int(there.max())
        outside = next((n for n in numbers if not first <= n <= last), None)
        if outside is not None:
            raise Rejected(_outside(step, outside, first, last))
        if numbers[-1] < numbers[0]:
            raise Rejected(EmptyArray(step.span, name=step.name.text, first=numbers[0], last=numbers[-1]))
        chosen &= (own >= numbers[0]) & (own <= numbers[-1])
        found.append(numbers)
    return found, chosen


def _outside(step: tree.Step, index: int, first: int, last: int) -> OutOfArray:
    text = step.span.text
    return OutOfArray(step.span, text=text, index=index, first=first, last=last, where=(), index_name=None)


def _no_match(pattern: tree.Pattern, candidates: Sequence[str]) -> MatchesNothing:
    text = f"{pattern.path.span.text}.*" if pattern.star else pattern.path.span.text
    shorter = without_level(text, candidates)
    return MatchesNothing(pattern.span, pattern=text, candidates=tuple(candidates), shorter=shorter)
