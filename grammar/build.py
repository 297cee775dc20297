"""From lark's parse tree to the frozen tree of `tree.py`.

In: a complete parse tree with positions. Out: the same as nodes, each with the exact span of its text and every doc
comment at its item. Works bottom-up without recursion, so a sum of thousands of terms is no danger. Nothing can be wrong
here: literals were checked when they were read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lark import Token, Transformer_NonRecursive, Tree, v_args
from lark.tree import Meta

from hierc.grammar import tree
from hierc.grammar.situation import span_of
from hierc.grammar.source import SourceFile, Span


@v_args(inline=True, meta=True)
class TreeBuilder(Transformer_NonRecursive[Token, Any]):
    """One method per rule of `hier.lark`; each takes the finished children in the order of the rule."""

    def __init__(self, source: SourceFile, docs: Mapping[int, str]) -> None:
        super().__init__(visit_tokens=False)
        self.source = source
        self.docs = docs

    # ---- helpers --------------------------------------------------------------------------------

    def _span(self, meta: Meta) -> Span:
        return Span(self.source, meta.start_pos, meta.end_pos)

    def _name(self, token: Token) -> tree.Name:
        return tree.Name(span_of(self.source, token), str(token))

    def _unit(self, token: Token | None) -> tree.Unit | None:
        return None if token is None else tree.Unit(span_of(self.source, token), token[1:-1].strip())

    def _doc(self, meta: Meta) -> str:
        return self.docs.get(meta.start_pos, "")

    # ---- files and modules ----------------------------------------------------------------------

    def start(self, meta: Meta, *items: tree.Item) -> tuple[tree.Item, ...]:
        return items

    def import_(self, meta: Meta, module: tree.Dotted, alias: Token | None) -> tree.Import:
        return tree.Import(self._span(meta), module, None if alias is None else self._name(alias))

    def from_import(self, meta: Meta, module: tree.Dotted, *names: Token) -> tree.FromImport:
        return tree.FromImport(self._span(meta), module, tuple(map(self._name, names)))

    def dotted(self, meta: Meta, *names: Token) -> tree.Dotted:
        return tree.Dotted(self._span(meta), tuple(map(self._name, names)))

    # ---- file-level definitions -----------------------------------------------------------------

    def const_(
        self, meta: Meta, type_: tree.Type, name: Token, unit: Token | None, value: tree.Expr
    ) -> tree.Const:
        return tree.Const(self._span(meta), type_, self._name(name), self._unit(unit), value)

    def func_(
        self,
        meta: Meta,
        type_: tree.Type,
        name: Token,
        params: tuple[tree.Param, ...] | None,
        body: tree.Expr,
    ) -> tree.Func:
        return tree.Func(self._span(meta), type_, self._name(name), params or (), body)

    def extern_(
        self,
        meta: Meta,
        type_: tree.Type,
        name: Token,
        params: tuple[tree.Param, ...] | None,
        unit: Token | None,
        target: Token,
    ) -> tree.Extern:
        return tree.Extern(
            self._span(meta), type_, self._name(name), params or (), self._unit(unit), unquoted(target)
        )

    def table_(
        self,
        meta: Meta,
        name: Token,
        params: tuple[tree.Param, ...] | None,
        unit: Token | None,
        file: Token,
        method: Token,
    ) -> tree.Table:
        return tree.Table(
            self._span(meta),
            self._name(name),
            params or (),
            self._unit(unit),
            unquoted(file),
            self._name(method),
        )

    def params(self, meta: Meta, *params: tree.Param) -> tuple[tree.Param, ...]:
        return params

    def param(
        self, meta: Meta, type_: tree.Type, name: Token, unit: Token | None, default: tree.Expr | None
    ) -> tree.Param:
        return tree.Param(self._span(meta), type_, self._name(name), self._unit(unit), default)

    def type_(self, meta: Meta, scalar: Token, *sizes: tree.Expr | None) -> tree.Type:
        return tree.Type(self._span(meta), _word(scalar), _present(sizes))

    # ---- agents ---------------------------------------------------------------------------------

    def agent_def(
        self, meta: Meta, name: Token, params: tuple[tree.Param, ...] | None, *items: tree.AgentItem
    ) -> tree.Agent:
        return tree.Agent(self._span(meta), self._name(name), params or (), items, self._doc(meta))

    def decl(
        self, meta: Meta, access: Token, kind: Token | None, type_: tree.Type, *declarators: tree.Declarator
    ) -> tree.Decl:
        doc = self._doc(meta)
        return tree.Decl(
            self._span(meta), _word(access), None if kind is None else _word(kind), type_, declarators, doc
        )

    def declarator(
        self,
        meta: Meta,
        name: Token,
        unit: Token | None,
        initial: tree.Expr | None,
        nominal: tree.Expr | None,
    ) -> tree.Declarator:
        return tree.Declarator(self._span(meta), self._name(name), self._unit(unit), initial, nominal)

    def let_(self, meta: Meta, name: Token, unit: Token | None, value: tree.Expr) -> tree.Let:
        return tree.Let(self._span(meta), self._name(name), self._unit(unit), value)

    def diff_(self, meta: Meta, *equations: tree.Equation | tree.ForBlock) -> tree.Diff:
        return tree.Diff(self._span(meta), equations)

    def alge_(self, meta: Meta, *equations: tree.Equation | tree.ForBlock) -> tree.Alge:
        return tree.Alge(self._span(meta), equations)

    def diff_eq(self, meta: Meta, target: tree.Target, prime: Token, value: tree.Expr) -> tree.Equation:
        return tree.Equation(self._span(meta), target, value)

    def alge_eq(self, meta: Meta, target: tree.Target, value: tree.Expr) -> tree.Equation:
        return tree.Equation(self._span(meta), target, value)

    def diff_for(self, meta: Meta, over: tree.Over, *equations: tree.Equation) -> tree.ForBlock:
        return tree.ForBlock(self._span(meta), over, equations)

    alge_for = diff_for

    def inv_(self, meta: Meta, *invariants: tree.Invariant) -> tree.Inv:
        return tree.Inv(self._span(meta), invariants)

    def invariant(self, meta: Meta, condition: tree.Expr, message: Token | None) -> tree.Invariant:
        return tree.Invariant(self._span(meta), condition, None if message is None else unquoted(message))

    def target(self, meta: Meta, name: Token, subs: tuple[tree.Expr | tree.Range, ...] | None) -> tree.Target:
        return tree.Target(self._span(meta), self._name(name), subs or ())

    # ---- hybrid and sampled behaviour -----------------------------------------------------------

    def mode_(self, meta: Meta, init: Token | None, name: Token, *items: tree.ModeItem) -> tree.Mode:
        return tree.Mode(self._span(meta), init is not None, self._name(name), items)

    def trans_(
        self,
        meta: Meta,
        from_to: tuple[tree.Dotted, bool, tree.Dotted] | None,
        guard: tree.Expr,
        effect: tuple[tree.Assign, ...],
    ) -> tree.Trans:
        source, history, target = from_to or (None, False, None)
        return tree.Trans(self._span(meta), source, target, history, guard, effect)

    def from_to(
        self, meta: Meta, source: tree.Dotted, history: Token | None, target: tree.Dotted
    ) -> tuple[tree.Dotted, bool, tree.Dotted]:
        return source, history is not None, target

    def effect(self, meta: Meta, *assigns: tree.Assign) -> tuple[tree.Assign, ...]:
        return assigns

    def assign(self, meta: Meta, target: tree.Target, value: tree.Expr) -> tree.Assign:
        return tree.Assign(self._span(meta), target, value)

    def sample_(
        self, meta: Meta, rate: Token, period: tree.Expr, offset: tree.Expr | None, *assigns: tree.Assign
    ) -> tree.Sample:
        return tree.Sample(self._span(meta), _word(rate), period, offset, assigns)

    # ---- composition ----------------------------------------------------------------------------

    def level_(self, meta: Meta, name: Token, *items: tree.AgentItem) -> tree.Level:
        return tree.Level(self._span(meta), self._name(name), items, self._doc(meta))

    def instance(
        self,
        meta: Meta,
        name: Token,
        index: tree.Over | None,
        agent: tree.Dotted,
        args: tuple[tree.Arg, ...] | None,
        coupling: tuple[tree.Bind, ...] | None,
    ) -> tree.Instance:
        doc = self._doc(meta)
        return tree.Instance(
            self._span(meta), self._name(name), index, agent, args or (), coupling or (), doc
        )

    def index(self, meta: Meta, over: tree.Over) -> tree.Over:
        return over

    def over(self, meta: Meta, index: Token, range_: tree.Range) -> tree.Over:
        return tree.Over(self._span(meta), self._name(index), range_)

    def coupling(self, meta: Meta, *binds: tree.Bind) -> tuple[tree.Bind, ...]:
        return binds

    def bind(self, meta: Meta, name: Token, value: tree.Expr) -> tree.Bind:
        return tree.Bind(self._span(meta), self._name(name), value)

    def group_(self, meta: Meta, name: Token, *members: tree.Pattern) -> tree.Group:
        return tree.Group(self._span(meta), self._name(name), members)

    def group_each(self, meta: Meta, name: Token) -> tree.GroupEach:
        return tree.GroupEach(self._span(meta), self._name(name))

    def pattern(self, meta: Meta, path: tree.Path, star: Token | None) -> tree.Pattern:
        return tree.Pattern(self._span(meta), path, star is not None)

    def args(self, meta: Meta, *args: tree.Arg) -> tuple[tree.Arg, ...]:
        return args

    def arg(self, meta: Meta, name: Token, value: tree.Expr) -> tree.Arg:
        return tree.Arg(self._span(meta), self._name(name), value)

    # ---- experiments ----------------------------------------------------------------------------

    def experiment_(
        self,
        meta: Meta,
        name: Token,
        agent: tree.Dotted,
        args: tuple[tree.ExpArg, ...] | None,
        coupling: tuple[tree.Bind, ...] | None,
        *items: tree.ExpItem,
    ) -> tree.Experiment:
        doc = self._doc(meta)
        return tree.Experiment(
            self._span(meta), self._name(name), agent, args or (), coupling or (), items, doc
        )

    def exp_args(self, meta: Meta, *args: tree.ExpArg) -> tuple[tree.ExpArg, ...]:
        return args

    def exp_arg(self, meta: Meta, path: tree.Path, value: tree.Expr) -> tree.ExpArg:
        return tree.ExpArg(self._span(meta), path, value)

    def setting(self, meta: Meta, name: Token, value: tree.Expr) -> tree.Setting:
        return tree.Setting(self._span(meta), self._name(name), value)

    def record_(self, meta: Meta, *patterns: tree.Pattern) -> tree.Record:
        return tree.Record(self._span(meta), patterns)

    def save_(self, meta: Meta, *files: Token) -> tree.Save:
        return tree.Save(self._span(meta), tuple(map(unquoted, files)))

    def exp_init(self, meta: Meta, init: Token, *values: tree.Initial) -> tree.InitBlock:
        return tree.InitBlock(self._span(meta), values)

    def initial(self, meta: Meta, path: tree.Path, value: tree.Expr) -> tree.Initial:
        return tree.Initial(self._span(meta), path, value)

    def exp_group(self, meta: Meta, path: tree.Path, *settings: tree.Setting) -> tree.GroupSettings:
        return tree.GroupSettings(self._span(meta), path, settings)

    # ---- expressions ----------------------------------------------------------------------------

    def cond(self, meta: Meta, condition: tree.Expr, then: tree.Expr, other: tree.Expr) -> tree.Cond:
        return tree.Cond(self._span(meta), condition, then, other)

    def binary(self, meta: Meta, left: tree.Expr, op: Token, right: tree.Expr) -> tree.Binary:
        return tree.Binary(self._span(meta), _word(op), left, right, span_of(self.source, op))

    def unary(self, meta: Meta, op: Token, operand: tree.Expr) -> tree.Unary:
        return tree.Unary(self._span(meta), _word(op), operand)

    def number(self, meta: Meta, token: Token, unit: Token | None) -> tree.Number:
        value, is_int = float(token), token.isdigit()  # in range, see `repairs.literal_problems`
        return tree.Number(self._span(meta), str(token), value, is_int, self._unit(unit))

    def boolean(self, meta: Meta, token: Token) -> tree.Bool:
        return tree.Bool(self._span(meta), token == "true")

    def time_(self, meta: Meta) -> tree.Time:
        return tree.Time(self._span(meta))

    def ref(self, meta: Meta, path: tree.Path, prime: Token | None) -> tree.Ref:
        return tree.Ref(self._span(meta), path, prime is not None)

    def call(self, meta: Meta, function: tree.Path, *args: tree.Expr | None) -> tree.Call:
        return tree.Call(self._span(meta), function, _present(args))

    def path(self, meta: Meta, *steps: tree.Step) -> tree.Path:
        return tree.Path(self._span(meta), steps)

    def step(self, meta: Meta, name: Token, subs: tuple[tree.Expr | tree.Range, ...] | None) -> tree.Step:
        return tree.Step(self._span(meta), self._name(name), subs or ())

    def subs(self, meta: Meta, *subs: tree.Expr | tree.Range) -> tuple[tree.Expr | tree.Range, ...]:
        return subs

    def range_(self, meta: Meta, first: tree.Expr, last: tree.Expr) -> tree.Range:
        return tree.Range(self._span(meta), first, last)

    def list_(self, meta: Meta, *items: tree.Expr) -> tree.ListExpr:
        return tree.ListExpr(self._span(meta), items)

    def comprehension(self, meta: Meta, item: tree.Expr, over: tree.Over) -> tree.Comprehension:
        return tree.Comprehension(self._span(meta), item, over)


def build_items(parsed: Tree[Token], source: SourceFile, docs: Mapping[int, str]) -> tuple[tree.Item, ...]:
    """The items of a file. `docs` maps the offset of an item to its doc text."""
    items: tuple[tree.Item, ...] = TreeBuilder(source, docs).transform(parsed)
    return items


def unquoted(token: Token) -> str:
    """The value of a string literal: a backslash makes the next character plain."""
    characters = iter(token[1:-1])
    return "".join(next(characters) if c == "\\" else c for c in characters)


def _word(token: Token) -> Any:
    """The text of a token whose terminal allows only the words of the node's `Literal`."""
    return str(token)


def _present(nodes: tuple[tree.Expr | None, ...]) -> tuple[tree.Expr, ...]:
    """Without the None that stands for an omitted list."""
    return tuple(node for node in nodes if node is not None)
