"""Instances: the tree of agents that a chosen top agent is made of.

In: a `Library` and the top agent's name. Out: `Instance`s in text order, each after the agent that contains it, with ids that are their
places in the tuple. Counted before it is built.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from hierc.compiler.collector import Rejected
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import NestedTooDeeply, TooManyInstances
from hierc.compiler.resolve.ordering import ordered
from hierc.grammar import tree

#: Most agents of a model.
MAX_INSTANCES = 100_000
#: Deepest nesting of agents.
MAX_NESTING = 64

#: A place in the text: positions from the outside in, to be compared.
Place = tuple[tuple[float, int], ...]


@dataclass(frozen=True, slots=True)
class Instance:
    """An agent of the model. The top agent has the path "" and no parent."""

    id: int
    path: str
    agent: Agent
    parent: int | None
    instance: tree.Instance | None
    level: str | None  # of the parent
    children: Mapping[str, int]
    levels: tuple[
        tuple[int, int], ...
    ]  # the levels around it, from the outside: (instance, index of its level)
    place: Place

    def named(self, name: str) -> str:
        """The path of something in this agent."""
        return f"{self.path}.{name}" if self.path else name


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
            raise Rejected(NestedTooDeeply(here.agent.definition.name.span, what="agents", limit=MAX_NESTING))
        made.append(here)
        children.append({})
        if parent is not None and name is not None:
            children[parent.id][name] = here.id
        waiting.extend((here, sub) for sub in reversed(list(here.agent.subs)))
    return tuple(replace(i, children=children[i.id]) for i in made)


def _instance(library: Library, id_: int, top: Agent, parent: Instance | None, name: str | None) -> Instance:
    if parent is None or name is None:
        return Instance(id_, "", top, None, None, None, {}, (), ())
    sub = parent.agent.subs[name]
    index = list(parent.agent.levels).index(sub.level) if sub.level is not None else None
    levels = parent.levels if index is None else (*parent.levels, (parent.id, index))
    place = (*parent.place, (-1 if index is None else index, sub.instance.span.start))
    agent = library.agents[sub.instance.agent.text]
    return Instance(id_, parent.named(name), agent, parent.id, sub.instance, sub.level, {}, levels, place)


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
