"""Plan phase: who calls what, in which order, and where everything is found at run time.

In: `Model` and `Symbolic`. Out: `Plan`, plain data that the emitter prints. Guaranteed: in a group's calls every out is set before it is read;
outs of other groups are channels and never called; `start_passes` runs of all `start` functions settle all initial values.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import TypeVar

from hierc.compiler import model
from hierc.compiler.model import Model, Source
from hierc.compiler.symbolic.derive import Symbolic

#: In a call: the node's right-hand side rather than one of its parts.
RATES = -1

Call = tuple[int, int]
Found = tuple[int, str, int]
Item = TypeVar("Item", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Node:
    """A node: its form, where its parameters stand and where its inputs come from."""

    path: str
    kind: int
    parameters: tuple[int, ...]
    sources: tuple[Found, ...]


@dataclass(frozen=True, slots=True)
class Group:
    """A subsystem: what one evaluation calls, in order."""

    name: str
    nodes: tuple[int, ...]
    calls: tuple[Call, ...]


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of results, and where its scalars are found."""

    path: str
    shape: tuple[int, ...]
    elements: tuple[Found, ...]
    unit: str | None
    doc: str
    access: str
    scale: float  # one of the declared unit in SI


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a generated module says."""

    name: str
    doc: str
    source: str
    digest: str
    files: tuple[tuple[str, str], ...]  # all that it is made of, with their digests
    symbolic: Symbolic
    nodes: tuple[Node, ...]
    groups: tuple[Group, ...]
    parameters: tuple[model.Parameter, ...]
    parameter_count: int
    variables: tuple[Variable, ...]
    start_passes: int
    experiment: model.Experiment


def plan(model: Model, symbolic: Symbolic) -> Plan:
    """The plan of a model. `digest` is the sha256 of all its files, their names included."""
    return Plan(
        name=model.name,
        doc=model.doc,
        source=model.file,
        digest=_digest("\0".join(f"{f.name}\0{f.text}" for f in sorted(model.sources, key=lambda f: f.name))),
        files=tuple((f.name, _digest(f.text)) for f in model.sources),
        symbolic=symbolic,
        nodes=_nodes(model, symbolic),
        groups=_groups(model, symbolic),
        parameters=model.parameters,
        parameter_count=model.parameter_count,
        variables=_variables(model, symbolic),
        start_passes=_start_passes(model, symbolic),
        experiment=model.experiment,
    )


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


# ---- places ---------------------------------------------------------------------------------


def _channel(symbolic: Symbolic, source: Source) -> Found:
    """Where a node finds what it reads of another."""
    return source.node, *symbolic.forms[symbolic.kinds[source.node]].channels[source.kind, source.index]


def _record(symbolic: Symbolic, source: Source) -> Found:
    """Where results find a scalar."""
    return source.node, *symbolic.forms[symbolic.kinds[source.node]].records[source.kind, source.index]


def _nodes(model: Model, symbolic: Symbolic) -> tuple[Node, ...]:
    return tuple(
        Node(
            node.path,
            symbolic.kinds[node.id],
            node.parameters,
            tuple(_channel(symbolic, s) for s in node.inputs),
        )
        for node in model.nodes
    )


def _variables(model: Model, symbolic: Symbolic) -> tuple[Variable, ...]:
    return tuple(
        Variable(
            v.path,
            v.shape,
            tuple(_record(symbolic, s) for s in v.elements),
            v.unit,
            v.doc,
            v.access,
            v.scale,
        )
        for v in model.variables
    )


# ---- calls ------------------------------------------------------------------------------------


def _groups(model: Model, symbolic: Symbolic) -> tuple[Group, ...]:
    nodes = _nodes(model, symbolic)
    home = {n: g for g, group in enumerate(model.groups) for n in group.nodes}
    return tuple(
        Group(group.name, group.nodes, _calls(symbolic, nodes, group.nodes, g, home))
        for g, group in enumerate(model.groups)
    )


def _calls(
    symbolic: Symbolic, nodes: Sequence[Node], members: Sequence[int], group: int, home: Mapping[int, int]
) -> tuple[Call, ...]:
    """The parts that the members' equations use, in order of dependency, then the members' right-hand sides.

    `home` is the group of each node that has one; outs of other groups are channels.
    """
    owner = [{out: p for p, part in enumerate(form.parts) for out in part.outs} for form in symbolic.forms]

    def parts(node: int, inputs: Iterable[int]) -> list[Call]:
        """The calls that set these inputs of a node."""
        found = []
        for k in sorted(inputs):
            source, kind, index = nodes[node].sources[k]
            if kind == "out" and home.get(source, group) == group:
                found.append((source, owner[nodes[source].kind][index]))
        return found

    def needs(call: Call) -> list[Call]:
        node, part = call
        return parts(node, symbolic.forms[nodes[node].kind].parts[part].inputs)

    wanted = [call for n in members for call in parts(n, symbolic.forms[nodes[n].kind].needs)]
    rates = [(n, RATES) for n in members if symbolic.forms[nodes[n].kind].states]
    return (*ordered(wanted, needs), *rates)


def ordered(wanted: Iterable[Item], needs: Callable[[Item], Iterable[Item]]) -> list[Item]:
    """The wanted items and all that they need, each after what it needs. Raises ValueError if they need each other."""
    order: dict[Item, None] = {}
    open_: set[Item] = set()
    stack = list(wanted)[::-1]
    while stack:
        item = stack[-1]
        missing = [] if item in order else [i for i in needs(item) if i not in order]
        if not missing:
            order[item] = None
            stack.pop()
        elif item in open_:
            raise ValueError(f"{item} and {missing[0]} need each other")
        else:
            open_.add(item)
            stack.extend(missing[::-1])
    return list(order)


# ---- initial values ------------------------------------------------------------------------------


def _start_passes(model: Model, symbolic: Symbolic) -> int:
    """How often the `start` functions must run over all nodes, in order, until every initial value is final.

    A pass visits each node once: its inputs are gathered, its initial values set, its outs evaluated.
    """
    nodes = _nodes(model, symbolic)

    def needs(found: Found) -> list[Found]:
        node, kind, index = found
        form = symbolic.forms[nodes[node].kind]
        if kind == "state":
            return [nodes[node].sources[k] for k in sorted(form.initial_needs[index])]
        out = form.outs[index]
        return [
            *((node, "state", i) for i in sorted(out.states)),
            *(nodes[node].sources[k] for k in sorted(out.inputs)),
        ]

    states = [
        (n, "state", i) for n, node in enumerate(nodes) for i in range(len(symbolic.forms[node.kind].states))
    ]
    passes: dict[Found, int] = {}
    for found in ordered(states, needs):
        own = [(passes[p], p[0]) for p in needs(found)]
        # An out follows from its own node's states in the visit that set them.
        passes[found] = max(
            (n + (node > found[0] or (node == found[0] and found[1] == "state")) for n, node in own),
            default=1,
        )
    return max((passes[s] for s in states), default=1)
