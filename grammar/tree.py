"""The syntax tree of a `.hier` file: frozen nodes, each with the span of its text.

The tree is what the grammar says and no more: names are not resolved, shapes and units not checked. Names of nodes follow the rules of
`hier.lark`. `span` never takes part in comparison, so two texts that differ in layout give equal trees.

It is long because it is a list: one small type for each construct of the grammar, closed unions between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from hierc.grammar.source import SourceFile, Span


@dataclass(frozen=True, slots=True)
class Node:
    """Base of all nodes."""

    span: Span = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Name(Node):
    """An identifier as written."""

    text: str


@dataclass(frozen=True, slots=True)
class Unit(Node):
    """A unit in brackets; `text` is what stands between them, stripped."""

    text: str


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment, kept beside the tree. `text` includes its marks (`//`, `/* */`, `///`)."""

    span: Span
    text: str


# ---- expressions --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Number(Node):
    """A literal. `text` is the user's spelling; `value` its float (range-checked when parsed); `is_int` without `.` or exponent."""

    text: str
    value: float
    is_int: bool
    unit: Unit | None


@dataclass(frozen=True, slots=True)
class Bool(Node):
    value: bool


@dataclass(frozen=True, slots=True)
class Time(Node):
    """The word `time`."""


@dataclass(frozen=True, slots=True)
class Range(Node):
    """`first .. last`, inclusive; only in subscripts and `in` clauses."""

    first: Expr
    last: Expr


@dataclass(frozen=True, slots=True)
class Step(Node):
    """One name of a path with its subscripts: `car[i - 1]`."""

    name: Name
    subs: tuple[Expr | Range, ...]


@dataclass(frozen=True, slots=True)
class Path(Node):
    """`a.b[2].c`."""

    steps: tuple[Step, ...]

    @property
    def text(self) -> str:
        """The names joined by dots, without subscripts."""
        return ".".join(s.name.text for s in self.steps)


@dataclass(frozen=True, slots=True)
class Ref(Node):
    """A variable, parameter, let, constant or index; `prime` for `x'`."""

    path: Path
    prime: bool


@dataclass(frozen=True, slots=True)
class Call(Node):
    function: Path
    args: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Unary(Node):
    op: Literal["+", "-", "not"]
    operand: Expr


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """Arithmetic, comparison or logic; `op_span` is the operator's own place."""

    op: Literal["+", "-", "*", "/", ".*", "./", "^", "==", "!=", "<=", ">=", "<", ">", "and", "or"]
    left: Expr
    right: Expr
    op_span: Span = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Cond(Node):
    """`if condition then then else other`."""

    condition: Expr
    then: Expr
    other: Expr


@dataclass(frozen=True, slots=True)
class ListExpr(Node):
    """`[a, b]`: a vector, or a matrix when the items are lists."""

    items: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Over(Node):
    """`i in 1..N`."""

    index: Name
    range: Range


@dataclass(frozen=True, slots=True)
class Comprehension(Node):
    """`[item for i in 1..N]`."""

    item: Expr
    over: Over


Expr = Number | Bool | Time | Ref | Call | Unary | Binary | Cond | ListExpr | Comprehension


# ---- file-level definitions ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Dotted(Node):
    """`a.b.C`, a name of a module or agent."""

    names: tuple[Name, ...]

    @property
    def text(self) -> str:
        """The names joined by dots."""
        return ".".join(n.text for n in self.names)


@dataclass(frozen=True, slots=True)
class Type(Node):
    """`real`, `real[3]`, `real[n,n]`."""

    scalar: Literal["real", "int", "bool"]
    sizes: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Param(Node):
    """A parameter of an agent or function."""

    type: Type
    name: Name
    unit: Unit | None
    default: Expr | None


@dataclass(frozen=True, slots=True)
class Import(Node):
    module: Dotted
    alias: Name | None


@dataclass(frozen=True, slots=True)
class FromImport(Node):
    module: Dotted
    names: tuple[Name, ...]


@dataclass(frozen=True, slots=True)
class Const(Node):
    type: Type
    name: Name
    unit: Unit | None
    value: Expr


@dataclass(frozen=True, slots=True)
class Func(Node):
    type: Type
    name: Name
    params: tuple[Param, ...]
    body: Expr


@dataclass(frozen=True, slots=True)
class Extern(Node):
    type: Type
    name: Name
    params: tuple[Param, ...]
    unit: Unit | None
    target: str


@dataclass(frozen=True, slots=True)
class Table(Node):
    name: Name
    params: tuple[Param, ...]
    unit: Unit | None
    file: str
    method: Name


# ---- agents -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Declarator(Node):
    name: Name
    unit: Unit | None
    initial: Expr | None
    nominal: Expr | None


@dataclass(frozen=True, slots=True)
class Decl(Node):
    """`write real x [m] = 0, y [m];`. `kind` is None where it is left out (analog). `doc` is the text of `///` lines before it."""

    access: Literal["read", "write", "private"]
    kind: Literal["analog", "discrete"] | None
    type: Type
    declarators: tuple[Declarator, ...]
    doc: str


@dataclass(frozen=True, slots=True)
class Let(Node):
    name: Name
    unit: Unit | None
    value: Expr


@dataclass(frozen=True, slots=True)
class Target(Node):
    name: Name
    subs: tuple[Expr | Range, ...]


@dataclass(frozen=True, slots=True)
class Equation(Node):
    """`target' = value;` in `diff`, `target = value;` in `alge`."""

    target: Target
    value: Expr


@dataclass(frozen=True, slots=True)
class ForBlock(Node):
    """`for i in 1..N { … }` inside `diff` or `alge`."""

    over: Over
    equations: tuple[Equation, ...]


@dataclass(frozen=True, slots=True)
class Diff(Node):
    equations: tuple[Equation | ForBlock, ...]


@dataclass(frozen=True, slots=True)
class Alge(Node):
    equations: tuple[Equation | ForBlock, ...]


@dataclass(frozen=True, slots=True)
class Invariant(Node):
    """One condition of an `inv` block with its message."""

    condition: Expr
    message: str | None


@dataclass(frozen=True, slots=True)
class Inv(Node):
    invariants: tuple[Invariant, ...]


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """`target := value;`."""

    target: Target
    value: Expr


@dataclass(frozen=True, slots=True)
class Mode(Node):
    init: bool
    name: Name
    items: tuple[ModeItem, ...]


@dataclass(frozen=True, slots=True)
class Trans(Node):
    source: Dotted | None
    target: Dotted | None
    history: bool
    guard: Expr
    assigns: tuple[Assign, ...]


@dataclass(frozen=True, slots=True)
class Sample(Node):
    rate: Literal["every", "at"]
    period: Expr
    offset: Expr | None
    assigns: tuple[Assign, ...]


ModeItem = Let | Diff | Alge | Inv | Mode | Trans


@dataclass(frozen=True, slots=True)
class Arg(Node):
    """`name = value` of an instance."""

    name: Name
    value: Expr


@dataclass(frozen=True, slots=True)
class Bind(Node):
    """`read := value` of a coupling."""

    name: Name
    value: Expr


@dataclass(frozen=True, slots=True)
class Instance(Node):
    """`agent name[i in 1..N] = Agent(args) [couplings];`."""

    name: Name
    index: Over | None
    agent: Dotted
    args: tuple[Arg, ...]
    bindings: tuple[Bind, ...]
    doc: str


@dataclass(frozen=True, slots=True)
class Pattern(Node):
    """A path, or `path.*` where `star`."""

    path: Path
    star: bool


@dataclass(frozen=True, slots=True)
class Group(Node):
    """`group name = a, b.*;`."""

    name: Name
    members: tuple[Pattern, ...]


@dataclass(frozen=True, slots=True)
class GroupEach(Node):
    """`group each name;`."""

    name: Name


@dataclass(frozen=True, slots=True)
class Level(Node):
    name: Name
    items: tuple[AgentItem, ...]
    doc: str


@dataclass(frozen=True, slots=True)
class Agent(Node):
    """An agent definition; `doc` is the text of the `///` lines before it."""

    name: Name
    params: tuple[Param, ...]
    items: tuple[AgentItem, ...]
    doc: str


AgentItem = (
    Decl | Const | Let | Diff | Alge | Inv | Mode | Trans | Sample | Instance | Level | Group | GroupEach
)


# ---- experiments --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ExpArg(Node):
    """`cart.kv = 60` between the parentheses of an experiment."""

    path: Path
    value: Expr


@dataclass(frozen=True, slots=True)
class Setting(Node):
    name: Name
    value: Expr


@dataclass(frozen=True, slots=True)
class Record(Node):
    patterns: tuple[Pattern, ...]


@dataclass(frozen=True, slots=True)
class Save(Node):
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Initial(Node):
    """One `path = value;` of an experiment's `init` block."""

    path: Path
    value: Expr


@dataclass(frozen=True, slots=True)
class InitBlock(Node):
    values: tuple[Initial, ...]


@dataclass(frozen=True, slots=True)
class GroupSettings(Node):
    """`group path { rtol = 1e-4; }`."""

    path: Path
    settings: tuple[Setting, ...]


@dataclass(frozen=True, slots=True)
class Experiment(Node):
    name: Name
    agent: Dotted
    args: tuple[ExpArg, ...]
    bindings: tuple[Bind, ...]
    items: tuple[ExpItem, ...]
    doc: str


ExpItem = Setting | Record | Save | InitBlock | GroupSettings

Item = Import | FromImport | Const | Func | Extern | Table | Agent | Experiment


@dataclass(frozen=True, slots=True)
class File(Node):
    """A whole file. `comments` are all comments in source order."""

    source: SourceFile = field(compare=False, repr=False)
    items: tuple[Item, ...]
    comments: tuple[Comment, ...]
