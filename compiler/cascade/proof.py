"""Cascade: who depends on whom, and the proof that no level depends on a later one.

In: the nodes. Out: a `Cascade`: for each node what its equations read. Guaranteed, unless E601 or E606 was
reported: in every agent with levels, and in every level with levels, none of them depends continuously on a later one, not even by way of what stands
elsewhere. Dependence is what equations use after substitution: an unused `read` makes none, and initial values make none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hierc.compiler.arrays.columns import expanded
from hierc.compiler.arrays.elements import plain
from hierc.compiler.cascade.detours import Detour, continuous, detours, reads
from hierc.compiler.cascade.errors import BrokenCascade, LaterDerivative
from hierc.compiler.collector import Collector
from hierc.compiler.structure.flat import FlatNode
from hierc.compiler.structure.instances import Block, Instance
from hierc.compiler.structure.nodes import LocalNode, Scalar
from hierc.grammar import tree
from hierc.grammar.source import Span


@dataclass(frozen=True, slots=True)
class Cascade:
    """For each node the nodes that its continuous equations use.

    `direct`: as they are written; `computed`: those of which they use definitions or derivatives.
    """

    direct: tuple[tuple[int, ...], ...]
    computed: tuple[tuple[int, ...], ...]


def prove_cascade(
    instances: Sequence[Instance],
    flat_nodes: Sequence[FlatNode],
    nodes: Sequence[LocalNode],
    problems: Collector,
) -> Cascade:
    """The dependences of the nodes; reports every read of a later level."""
    for here in nodes:
        reported: set[str | None] = set()
        for k, source, span in reads(here):
            reader, owner = flat_nodes[here.node.id], flat_nodes[source.node]
            problem = _broken(instances, reader, owner, source, span)
            if problem is not None and here.node.count > 1:
                problem = (
                    problem if _same_element(instances, here, nodes[source.node], k, reader, owner) else None
                )
            if problem is not None and (problem.read is None or problem.read not in reported):
                reported.add(problem.read)  # one for each coupling is enough
                problems.add(problem)
    for detour in detours(flat_nodes, nodes):
        problems.add(_roundabout(instances, flat_nodes, detour))
    direct = tuple(tuple(dict.fromkeys(source.node for source, _ in continuous(here))) for here in nodes)
    computed = tuple(
        tuple(dict.fromkeys(source.node for source, _ in continuous(here) if source.kind != "state"))
        for here in nodes
    )
    return Cascade(direct, computed)


def _same_element(
    instances: Sequence[Instance],
    here: LocalNode,
    there: LocalNode,
    k: int,
    reader: FlatNode,
    owner: FlatNode,
) -> bool:
    """Whether some element of an array of agents with levels reads, by input k, itself: levels of other elements may stand in any order."""
    levels = dict(owner.levels)
    block = next(b for b, index in reader.levels if b in levels and levels[b] > index)
    around = instances[block[0]].domain
    read = expanded(here.node.inputs[k].node, here.node.count) - there.node.first
    inside = (read >= 0) & (read < there.node.count)
    own = reader.instance.domain.within(around)
    return bool((owner.instance.domain.within(around)[read[inside]] == own[inside]).any())


def _broken(
    instances: Sequence[Instance], reader: FlatNode, owner: FlatNode, source: Scalar, span: Span
) -> BrokenCascade | LaterDerivative | None:
    """The problem if the reader stands in an earlier level of some block than what it reads."""
    levels = dict(owner.levels)
    for block, index in reader.levels:
        if block in levels and levels[block] > index:
            return _problem(instances, block, (reader, index), (owner, levels[block]), source, span)
    return None


def _problem(
    instances: Sequence[Instance],
    block: Block,
    reader: tuple[FlatNode, int],
    owner: tuple[FlatNode, int],
    source: Scalar,
    span: Span,
) -> BrokenCascade | LaterDerivative:
    around = instances[block[0]]
    names = around.agent.inside(block[1])
    reading, owning = _member(instances, around, reader[0]), _member(instances, around, owner[0])
    bind = _binding(instances, reader[0].instance, span)
    if source.kind == "rate" and bind is not None:
        owner_name = owning or names[owner[1]]
        return LaterDerivative(
            span, read=bind.name.text, text=span.text, level=names[reader[1]], owner=owner_name
        )
    return BrokenCascade(
        span,
        reader=reading,
        reader_level=names[reader[1]],
        source=span.text,
        source_level=names[owner[1]],
        read=bind.name.text if bind else None,
        agents=reading is not None and owning is not None,
        observer=reader[0].observer and reading is None,
    )


def _roundabout(
    instances: Sequence[Instance], flat_nodes: Sequence[FlatNode], detour: Detour
) -> BrokenCascade:
    """The problem of a level that reads a later one by way of other agents."""
    around, reader = instances[detour.block[0]], flat_nodes[detour.reader]
    names = around.agent.inside(detour.block[1])
    member = _member(instances, around, reader)
    bind = _binding(instances, reader.instance, detour.span)
    return BrokenCascade(
        detour.span,
        reader=member,
        reader_level=names[detour.level],
        source=detour.span.text,
        source_level=names[detour.later],
        read=bind.name.text if bind else None,
        agents=member is not None,
        through=tuple(
            dict.fromkeys(plain(flat_nodes[n].path) or flat_nodes[n].template for n in detour.through)
        ),
        back=detour.back,
    )


def _member(instances: Sequence[Instance], around: Instance, node: FlatNode) -> str | None:
    """The sub-agent of `around` that a node is in; None if it is a level of `around` itself."""
    here = node.instance
    while here.parent is not None and here.parent != around.id:
        here = instances[here.parent]
    return here.instance.name.text if here.instance is not None and here.id != around.id else None


def _binding(instances: Sequence[Instance], reader: Instance, span: Span) -> tree.Bind | None:
    """The coupling, of the reader or an agent around it, whose text holds `span`."""
    here: Instance | None = reader
    while here is not None and here.instance is not None:
        for bind in here.instance.bindings:
            value = bind.value.span
            if value.file == span.file and value.start <= span.start and span.stop <= value.stop:
                return bind
        here = None if here.parent is None else instances[here.parent]
    return None
