"""The structured model: what the front half of the compiler hands to the back half.

In: syntax trees. Out: `Model`. Guaranteed: every name resolved, every shape agreed and every vector split into scalars, every variable
defined exactly once, every read bound, inputs substituted down to the variables that are really read, nodes and groups acyclic and in
execution order (`cascade.py` proved it).

A *node* is the unit of grouping: an agent (all of it that is not in its levels or sub-agents), or a level with declarations of its own. Arrays of
agents are never expanded: a node stands for a *block* of `count` elements that say the same thing, which differ only in what they read and in their
parameters. Those are columns, one integer an element (see `arrays/columns.py`). Elements of all blocks are numbered through: element k of a block
has number `first + k`. Most blocks have one element.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hierc.compiler.arrays.columns import Column, Index
from hierc.compiler.expression import Expr
from hierc.grammar.problems import Problem
from hierc.grammar.source import SourceFile, Span


@dataclass(frozen=True, slots=True)
class Source:
    """Where the elements of a block find a scalar: in the elements numbered `node` (of any block).

    `state`: state `index` of it; `rate`: its derivative; `local`: its definition `index` (an algebraic variable).
    """

    node: Index
    kind: Literal["state", "rate", "local"]
    index: Index


@dataclass(frozen=True, slots=True)
class Definition:
    """A `let` or algebraic variable of a node, one scalar of it: computed once, used by `Local`."""

    name: str  # as the user writes it: `vc`, `tau[1]`
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class StateEquation:
    """One scalar state: its derivative, initial value and error scale."""

    name: str  # within the node: `x`, `p[2]`
    rate: Expr
    initial: (
        Expr  # may use Parameter, Time (the start), Input and State (their initial values), Local of such
    )
    nominal: Expr  # Number or made of Parameter; 1.0 where not given
    span: Span  # of the state's declaration
    rate_span: Span  # of its differential equation


@dataclass(frozen=True, slots=True)
class Node:
    """A block of agents or levels with equations. `definitions` are in dependency order: each uses only earlier ones, states, inputs and rates."""

    id: int  # its index in Model.nodes, which are in execution order
    path: str  # `kin`; `robot.arm`; the level's name for levels in one agent; "" for the top agent itself; `car[].engine` in an array
    template: str  # the agent's name, or `Agent.level`: names the generated class
    states: tuple[StateEquation, ...]
    definitions: tuple[Definition, ...]
    inputs: tuple[Source, ...]  # in order of first use
    input_spans: tuple[Span, ...]  # the user's text that reads each input
    parameters: tuple[Index, ...]  # indices of scalars in the model's parameter vector
    span: Span
    first: int  # number of its first element
    count: int = 1
    indices: tuple[Index, ...] = ()  # for each `[]` in the path, the elements' indices
    levels: tuple[
        str, ...
    ] = ()  # the levels around it, of all agents around it, from the outside: `body`, `robot.fast`


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a block of agents, by its path (`cart.kv`, `car[].tau`).

    Its scalars stand from `first` on in the parameter vector: element by element, each row by row. `values` are one for each scalar of an element. They
    use entries before it, and in a block earlier parameters of the same element: those that differ from element to element as expression.Gather of kind
    "parameter", a column of entries; those of single agents as expression.Parameter.
    """

    path: str
    scalar: Literal["real", "int", "bool"]
    shape: tuple[int, ...]
    unit: str | None  # as declared
    doc: str
    first: int
    values: tuple[
        Expr, ...
    ]  # one a scalar, over expression.Parameter(index into the whole parameter vector), earlier ones only
    structural: bool  # its value is built into the code: another one recompiles
    span: Span
    scale: float = (
        1.0  # one of the declared unit in SI; `values` are in SI, those given by path in the declared unit
    )
    count: int = 1
    indices: tuple[Index, ...] = ()  # for each `[]` in the path, the elements' indices


@dataclass(frozen=True, slots=True)
class Constants:
    """Numbers that differ from element to element, such as indices: entries `first`, `first + 1`, … of the parameter vector."""

    first: int
    values: Column | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable users may name in results, with the scalars that one of its elements is made of, row by row."""

    path: str  # `cart.x`, `plan.p` (the vector), `car[].x` (of all cars)
    shape: tuple[int, ...]
    unit: str | None
    doc: str
    access: Literal["write", "private", "read"]
    elements: tuple[
        Source, ...
    ]  # kind `state` or `local`; a `read` is what it is bound to, listed only when that is a single variable
    span: Span
    scale: float = 1.0  # one of the declared unit in SI: results are in the declared unit
    count: int = 1
    indices: tuple[Index, ...] = ()  # for each `[]` in the path, the elements' indices


@dataclass(frozen=True, slots=True)
class Group:
    """`count` subsystems of equal form, each with a step size of its own: elements in execution order.

    `nodes` holds columns of element numbers, each `count` times as many as it gives one group, group by group; so one group that holds a whole
    array has a column of all its elements, and `group each car;` makes `count` groups of one element each. What a group reads comes from its own
    elements in all of the groups or in none. Nodes without states belong to no group, they are evaluated by whoever reads them; but for those that several
    groups share: these are in a group that publishes what they compute, which may be without states as a whole.
    """

    name: str  # the level's name, the agent's path, or what the user wrote after `group`; `car[]` for groups of an array
    nodes: tuple[Index, ...]
    count: int = 1
    indices: tuple[Index, ...] = ()  # for each `[]` in the name, the groups' indices


@dataclass(frozen=True, slots=True)
class Settings:
    """Numerical settings; None where the user said nothing. SI."""

    stop: float | None = None
    start: float | None = None
    rtol: float | None = None
    atol: float | None = None
    interval: float | None = None
    max_step: float | None = None
    min_step: float | None = None
    method: str | None = None


@dataclass(frozen=True, slots=True)
class Experiment:
    """What the chosen experiment says. Its arguments and `init` values are already in the model (as parameter and initial values)."""

    name: str | None  # None: no experiment, the model itself
    settings: Settings
    groups: tuple[tuple[str, Settings], ...]  # by group name
    record: tuple[str, ...]  # paths of variables; empty: all `write` variables
    save: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Model:
    """A whole model, ready for code generation."""

    name: str  # of the top agent
    doc: str
    sources: tuple[SourceFile, ...]  # the files that it is made of, the main one first
    parameters: tuple[Parameter, ...]  # in dependency order of their values, those of single agents first
    parameter_count: int  # scalars in the parameter vector
    nodes: tuple[Node, ...]  # in execution order
    groups: tuple[Group, ...]  # in cascade order of their first ones
    variables: tuple[Variable, ...]  # in text order
    experiment: Experiment
    warnings: tuple[Problem, ...]

    @property
    def file(self) -> str:
        """The main file's name."""
        return self.sources[0].name

    constants: tuple[Constants, ...] = ()
    order: Column | None = (
        None  # of all single groups, numbered through `groups`, the cascade order; None: as they are numbered
    )
