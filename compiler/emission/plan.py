"""Plan phase: who calls what, in which order, and where everything is found at run time.

In: `Model` and `Symbolic`. Out: `Plan`, plain data that the emitter prints. Guaranteed: blocks of agents stay blocks, their differences columns; the order
of calls is that of `calls.py`, that of initial values that of `initial.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

from hierc.compiler import model
from hierc.compiler.arrays.columns import Index
from hierc.compiler.emission.calls import Block, Group, families
from hierc.compiler.emission.initial import start
from hierc.compiler.emission.places import Found, Places
from hierc.compiler.model import Model
from hierc.compiler.symbolic.derive import Symbolic


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of results, and where the scalars of one of its elements are found."""

    path: str
    shape: tuple[int, ...]
    elements: tuple[Found, ...]
    unit: str | None
    doc: str
    access: str
    scale: float  # one of the declared unit in SI
    count: int
    indices: tuple[Index, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a generated module says."""

    name: str
    doc: str
    source: str
    digest: str
    files: tuple[tuple[str, str], ...]  # all that it is made of, with their digests
    symbolic: Symbolic
    nodes: tuple[Block, ...]
    groups: tuple[Group, ...]
    parameters: tuple[model.Parameter, ...]
    parameter_count: int
    constants: tuple[model.Constants, ...]
    variables: tuple[Variable, ...]
    order: Index | None  # of all groups, numbered through `groups`
    start_passes: int
    start_order: Index | None
    experiment: model.Experiment


def plan(model: Model, symbolic: Symbolic) -> Plan:
    """The plan of a model. `digest` is the sha256 of all its files, their names included."""
    places = Places(model, symbolic)
    nodes = _nodes(model, symbolic, places)
    groups, order = families(model.groups, model.order, nodes, symbolic.forms, places.elements)
    start_passes, start_order = start(nodes, symbolic.forms, places.elements)
    return Plan(
        name=model.name,
        doc=model.doc,
        source=model.file,
        digest=_digest("\0".join(f"{f.name}\0{f.text}" for f in sorted(model.sources, key=lambda f: f.name))),
        files=tuple((f.name, _digest(f.text)) for f in model.sources),
        symbolic=symbolic,
        nodes=nodes,
        groups=groups,
        parameters=model.parameters,
        parameter_count=model.parameter_count,
        constants=model.constants,
        variables=_variables(model, places),
        order=order,
        start_passes=start_passes,
        start_order=start_order,
        experiment=model.experiment,
    )


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def _nodes(model: Model, symbolic: Symbolic, places: Places) -> tuple[Block, ...]:
    return tuple(
        Block(
            node.path,
            symbolic.kinds[node.id],
            node.parameters,
            tuple(places.channel(s, node.count) for s in node.inputs),
            node.first,
            node.count,
            node.indices,
        )
        for node in model.nodes
    )


def _variables(model: Model, places: Places) -> tuple[Variable, ...]:
    return tuple(
        Variable(
            v.path,
            v.shape,
            tuple(places.record(s, v.count) for s in v.elements),
            v.unit,
            v.doc,
            v.access,
            v.scale,
            v.count,
            v.indices,
        )
        for v in model.variables
    )
