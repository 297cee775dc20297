"""Instances: the tree of agents that a chosen top agent is made of.

In: a `Library` and the top agent's name. Out: the outline, `Instance`s in text order, each after the agent that contains it, with ids that are their
places in the tuple; an array of agents is one of them. Counted before it is built. `elaboration.py` divides arrays into blocks, which are `Instance`s
again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from hierc.compiler.arrays.columns import Integers
from hierc.compiler.arrays.domains import SINGLE, Domain
from hierc.compiler.collector import Rejected
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import NestedTooDeeply, TooManyInstances
from hierc.compiler.resolve.ordering import ordered
from hierc.grammar import tree

#: Most agents of a model.
MAX_INSTANCES = 100_000
#: Deepest nesting of agents and levels.
MAX_NESTING = 64

#: A place in the text: positions from the outside in, to be compared.
Place = tuple[tuple[float, int], ...]

#: What has levels: an agent, by its id and None, or a level of it, by its name.
Block = tuple[int, str | None]

#: A level, as a block and the index of the level among those of the block.
Standing = tuple[Block, int]


@dataclass(frozen=True, slots=True)
class Array:
    """The agents `name[first]`, `name[first + 1]`, …: `size` of them in each element of the agent around them, in blocks.

    `blocks` are ids of instances. `slots` gives the places of each block's elements among all: those of the first element around them, then those of
    the next.
    """

    first: int
    size: int
    blocks: tuple[int, ...]
    slots: tuple[Integers, ...]


@dataclass(frozen=True, slots=True)
class Instance:
    """An agent of the model, or a block of an array of agents. The top agent has the path "" and no parent."""

    id: int
    path: str
    agent: Agent
    parent: int | None
    instance: tree.Instance | None
    level: str | None  # of the parent, the innermost around it
    children: Mapping[str, int]
    levels: tuple[Standing, ...]  # the levels around it, of all agents around it, from the outside
    place: Place
    outline: int  # the agent's id in the outline
    domain: Domain = SINGLE
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def named(self, name: str) -> str:
        """The path of something in this agent."""
        return f"{self.path}.{name}" if self.path else name

    def standing(self, level: str | None) -> tuple[Standing, ...]:
        """The levels around what stands in `level` of this agent, from the outside."""
        inner = (self.agent.levels[name] for name in self.agent.around(level))
        return (*self.levels, *(((self.id, level.outer), level.index) for level in inner))

    def place_in(self, level: str | None, position: int) -> Place:
        """The place of what stands at `position` of the text in `level` of this agent."""
        inner = [self.agent.levels[name] for name in self.agent.around(level)]
        if not inner:
            return (*self.place, (-1, position))
        outer = ((level.index, level.level.span.start) for level in inner[:-1])
        return (*self.place, *outer, (inner[-1].index, position))


def level_name(instances: Sequence[Instance], standing: Standing) -> str:
    """The full name of a level: the path of its agent, then its own name; outer levels are no part of it."""
    (instance, outer), index = standing
    around = instances[instance]
    return around.named(around.agent.inside(outer)[index])


def instances(library: Library, top: Agent) -> tuple[Instance, ...]:
    """All agents of the model. Raises Rejected when there are too many."""
    _count(library, top)
    made: list[Instance] = []
    waiting: list[tuple[Instance | None, str | None]] = [(None, None)]
    children: list[dict[str, int]] = []
    while waiting:
        parent, name = waiting.pop()
        here = _instance(library, len(made), top, parent, name)
        if len(here.place) > MAX_NESTING:
            raise Rejected(
                NestedTooDeeply(here.agent.definition.name.span, what="agents and levels", limit=MAX_NESTING)
            )
        made.append(here)
        children.append({})
        if parent is not None and name is not None:
            children[parent.id][name] = here.id
        waiting.extend((here, sub) for sub in reversed(list(here.agent.subs)))
    return tuple(replace(i, children=children[i.id]) for i in made)


def _instance(library: Library, id_: int, top: Agent, parent: Instance | None, name: str | None) -> Instance:
    if parent is None or name is None:
        return Instance(id_, "", top, None, None, None, {}, (), (), id_)
    return inside(library, parent, name, id_, id_, parent.domain)


def inside(library: Library, parent: Instance, name: str, id_: int, outline: int, domain: Domain) -> Instance:
    """The sub-agent `name` of an agent, with these ids and this domain."""
    sub = parent.agent.subs[name]
    path = parent.named(name) + ("" if sub.instance.index is None else "[]")
    return Instance(
        id_, path, library.agents[sub.instance.agent.text], parent.id, sub.instance, sub.level, {},
        parent.standing(sub.level), parent.place_in(sub.level, sub.instance.span.start), outline, domain,
    )  # fmt: skip


def _count(library: Library, top: Agent) -> None:
    """Refuse too many agents before any is made."""
    inside, _ = ordered(
        {n: [s.instance.agent.text for s in a.subs.values()] for n, a in library.agents.items()}
    )
    counts: dict[str, int] = {}
    for name in inside:
        counts[name] = 1 + sum(counts[s.instance.agent.text] for s in library.agents[name].subs.values())
    if counts[top.name] > MAX_INSTANCES:
        span = top.definition.name.span
        raise Rejected(TooManyInstances(span, agent=top.name, count=counts[top.name], limit=MAX_INSTANCES))
