"""Symbolic phase: one set of programs for all nodes that say the same thing.

In: a `Model`. Out: `Symbolic`: for each class of nodes (a *form*) the programs of its functions, with sparsity pattern and operation count.
Guaranteed: nodes share a form exactly if their agents, state names and expressions agree (not their paths, sources of inputs or places of
parameters); what depends on parameters alone is computed by `fill`, once a run; outs that need the same inputs share a part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal

from hierc.compiler.arrays.elements import Elements
from hierc.compiler.model import Model, Node
from hierc.compiler.symbolic.algebra import tidy
from hierc.compiler.symbolic.channels import Key, Keys, keys
from hierc.compiler.symbolic.defaults import Defaults, block_defaults, single_defaults
from hierc.compiler.symbolic.derivative import jacobian
from hierc.compiler.symbolic.graph import Called, Graph, Value
from hierc.compiler.symbolic.lower import Lowering
from hierc.compiler.symbolic.reduce import constants, expand, replace
from hierc.compiler.symbolic.schedule import Program, flops, schedule
from hierc.grammar.source import Span

#: Where it is found at run time.
Place = tuple[Literal["state", "out", "observed"], int]
Stores = list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Out:
    """What others read of a node, with the states and inputs it is made of."""

    states: frozenset[int]
    inputs: frozenset[int]


@dataclass(frozen=True, slots=True)
class Part:
    """Outs that need the same inputs, and the program that sets them."""

    outs: tuple[int, ...]
    inputs: tuple[int, ...]
    program: Program


@dataclass(frozen=True, slots=True)
class Form:
    """A class of nodes: what its nodes share."""

    template: str
    states: tuple[str, ...]
    inputs: int
    parameters: int
    values: int
    outs: tuple[Out, ...]
    channels: Mapping[Key, Place]  # where other nodes find what they read
    records: Mapping[Key, Place]  # where results find variables
    needs: frozenset[int]  # inputs that rhs, outs and jac read
    initial_needs: tuple[frozenset[int], ...]  # inputs that each state's initial value reads
    rhs: Program
    parts: tuple[Part, ...]
    observe: Program | None
    jac: Program
    pattern: tuple[tuple[int, int], ...]
    start: Program
    fill: Program
    nominal: Program
    flops: int
    spans: tuple[Span, ...]  # of the differential equations
    names: Mapping[int, str]  # of definitions, by value: for readers of the generated code

    @property
    def observed(self) -> int:
        """How many scalars `observe` sets."""
        return 0 if self.observe is None else len(self.observe.targets)


@dataclass(frozen=True, slots=True)
class Symbolic:
    """The programs of a model."""

    values: tuple[Value, ...]  # what programs refer to
    forms: tuple[Form, ...]
    kinds: tuple[int, ...]  # the form of each node
    defaults: tuple[
        tuple[int, Program], ...
    ]  # for each scalar parameter of single agents: its entry, and a program that sets it
    block_defaults: tuple[Defaults, ...]  # of blocks of agents, in order
    called: tuple[Called, ...]  # tables and external functions that programs call


def derive(model: Model) -> Symbolic:
    """The symbolic phase. Raises ModelError where a model grows beyond the limits or a literal has no finite value."""
    graph = Graph()
    lowered = [_lower(graph, node) for node in model.nodes]
    kinds, firsts = _classes(model.nodes, lowered)
    elements = Elements(node.first for node in model.nodes)

    def is_state(kind: int, key: Key) -> bool:
        return key[0] == "state" or graph.values[_named(graph, lowered[firsts[kind]], key)].op == "state"

    inputs = [(s, node.count) for node in model.nodes for s in node.inputs]
    recorded = [(s, variable.count) for variable in model.variables for s in variable.elements]
    channels = keys(inputs, elements, kinds, len(firsts), is_state)
    records = keys(recorded, elements, kinds, len(firsts), is_state)
    forms = tuple(
        _FormBuilder(graph, model.nodes[n], lowered[n]).form(channels[k], records[k])
        for k, n in enumerate(firsts)
    )
    singles, blocks = single_defaults(graph, model), block_defaults(graph, model)
    return Symbolic(tuple(graph.values), forms, kinds, singles, blocks, tuple(graph.called))


# ---- classes ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Lowered:
    """A node's expressions as values."""

    rates: tuple[int, ...]
    definitions: tuple[int, ...]
    initials: tuple[int, ...]
    nominals: tuple[int, ...]


def _lower(graph: Graph, node: Node) -> _Lowered:
    running, initial = Lowering(graph, node), Lowering(graph, node, initial=True)
    return _Lowered(
        rates=tuple(running.value(s.rate) for s in node.states),
        definitions=tuple(running.value(d.value) for d in node.definitions),
        initials=tuple(initial.value(s.initial) for s in node.states),
        nominals=tuple(running.value(s.nominal) for s in node.states),
    )


def _classes(nodes: Sequence[Node], lowered: Sequence[_Lowered]) -> tuple[tuple[int, ...], list[int]]:
    """The class of each node, and the first node of each class."""
    numbers: dict[object, int] = {}
    firsts: list[int] = []
    kinds: list[int] = []
    for n, (node, values) in enumerate(zip(nodes, lowered, strict=True)):
        names = tuple(s.name for s in node.states)
        key = (node.template, names, values, len(node.inputs), len(node.parameters))
        if key not in numbers:
            numbers[key] = len(firsts)
            firsts.append(n)
        kinds.append(numbers[key])
    return tuple(kinds), firsts


def _named(graph: Graph, lowered: _Lowered, key: Key) -> int:
    """The value of what others name."""
    match key:
        case ("state", index):
            return graph.leaf("state", index)
        case ("rate", index):
            return lowered.rates[index]
        case (_, index):
            return lowered.definitions[index]


# ---- one class ------------------------------------------------------------------------------


class _FormBuilder:
    """Makes the form of the class that `node` is the first of."""

    def __init__(self, graph: Graph, node: Node, lowered: _Lowered) -> None:
        self._graph = graph
        self._node = node
        self._lowered = lowered

    def form(self, read: Keys, recorded: Keys) -> Form:
        graph, node, lowered = self._graph, self._node, self._lowered
        channels, outs = self._places(read, "out")
        records, observed = self._places(recorded, "observed")
        pattern, entries = self._jacobian(outs)
        functions = {
            "rhs": list(enumerate(lowered.rates)),
            "out": list(enumerate(outs)),
            "observe": list(enumerate(observed)),
            "jac": list(enumerate(entries)),
            "start": list(enumerate(lowered.initials)),
            "nominal": list(enumerate(lowered.nominals)),
        }
        functions, fill, names = self._reduce(functions)
        out_details = tuple(
            Out(self._leaves("state", v), self._leaves("input", v)) for _, v in functions["out"]
        )
        needs = self._leaves("input", *(v for f in ("rhs", "out", "jac") for _, v in functions[f]))
        rhs = self._program(functions["rhs"])
        return Form(
            template=node.template,
            states=tuple(s.name for s in node.states),
            inputs=len(node.inputs),
            parameters=len(node.parameters),
            values=sum(graph.values[v].entries for _, v in fill),
            outs=out_details,
            channels=channels,
            records=records,
            needs=needs,
            initial_needs=tuple(self._leaves("input", v) for _, v in functions["start"]),
            rhs=rhs,
            parts=self._parts(functions["out"], out_details),
            observe=self._program(functions["observe"]) if observed else None,
            jac=self._program(functions["jac"]),
            pattern=pattern,
            start=self._program(functions["start"]),
            fill=self._program(fill),
            nominal=self._program(functions["nominal"]),
            flops=flops(graph, rhs.block),
            spans=tuple(s.rate_span for s in node.states),
            names=names,
        )

    def _places(self, named: Keys, kind: Literal["out", "observed"]) -> tuple[dict[Key, Place], list[int]]:
        """Where each scalar is found, and the values that must be computed for it: none for what may just be a state."""
        places: dict[Key, Place] = {}
        values: dict[int, int] = {}
        for key, computed in named.items():
            value = _named(self._graph, self._lowered, key)
            leaf = self._graph.values[value]
            if leaf.op == "state" and not computed:
                places[key] = ("state", leaf.index)
            else:
                places[key] = (kind, values.setdefault(value, len(values)))
        return places, list(values)

    def _jacobian(self, outs: Sequence[int]) -> tuple[tuple[tuple[int, int], ...], list[int]]:
        """Pattern and entries of d(rates, outs)/d(states, inputs)."""
        states = [self._graph.leaf("state", i) for i in range(len(self._node.states))]
        inputs = [self._graph.leaf("input", i) for i in range(len(self._node.inputs))]
        column = {leaf: k for k, leaf in enumerate(states + inputs)}
        rows = [*self._lowered.rates, *outs]
        gradients = jacobian(self._graph, rows, list(column), self._node.span)
        nonzeros = [
            (row, k, d)
            for row, gradient in enumerate(gradients)
            for k, d in sorted((column[leaf], d) for leaf, d in gradient.items())
        ]
        entries = tidy(self._graph, [d for _, _, d in nonzeros], self._graph.reach(rows))
        zero = self._graph.number(0.0)  # algebra may find that terms cancel
        left = [(row, k, d) for (row, k, _), d in zip(nonzeros, entries, strict=True) if d != zero]
        return tuple((row, k) for row, k, _ in left), [d for _, _, d in left]

    def _reduce(self, functions: dict[str, Stores]) -> tuple[dict[str, Stores], Stores, dict[int, str]]:
        """Functions with powers expanded and constants taken out; the stores of `fill`; names of values."""
        graph, definitions = self._graph, self._lowered.definitions
        stored = [v for stores in functions.values() for _, v in stores]
        expanded = expand(graph, [*stored, *definitions])
        functions = {f: [(k, expanded[v]) for k, v in stores] for f, stores in functions.items()}
        roots = {f: [v for _, v in stores] for f, stores in functions.items()}
        fill = constants(graph, [roots[f] for f in roots if f != "observe"], roots["observe"])
        ends = accumulate((graph.values[v].entries for v in fill), initial=0)
        places = dict(zip(fill, ends, strict=False))
        leaves = {v: graph.kept(v, place) for v, place in places.items()}
        new = replace(graph, expanded.values(), leaves)
        names: dict[int, str] = {}
        for definition, value in zip(self._node.definitions, definitions, strict=True):
            names.setdefault(expanded[value], definition.name)
            names.setdefault(new[expanded[value]], definition.name)
        names = {v: name for v, name in names.items() if not graph.is_leaf(v)}
        functions = {f: [(k, new[v]) for k, v in stores] for f, stores in functions.items()}
        return functions, [(place, v) for v, place in places.items()], names

    def _parts(self, stores: Stores, outs: Sequence[Out]) -> tuple[Part, ...]:
        together: dict[frozenset[int], Stores] = {}
        for k, value in stores:
            together.setdefault(outs[k].inputs, []).append((k, value))
        return tuple(
            Part(tuple(k for k, _ in group), tuple(sorted(inputs)), self._program(group))
            for inputs, group in together.items()
        )

    def _leaves(self, op: str, *values: int) -> frozenset[int]:
        reached = (self._graph.values[v] for v in self._graph.reach(values))
        return frozenset(v.index for v in reached if v.op == op)

    def _program(self, stores: Stores) -> Program:
        return schedule(self._graph, stores, self._node.span)
