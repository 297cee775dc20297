"""Files, agents and experiments as documents.

In: the tree of a file and its text. Out: one document that holds every token in order, but the word `analog`, and every comment.
A block stays on one line if the writer put it there and it fits. At most one blank line stays between statements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import assert_never

from hierc.grammar import tree
from hierc.grammar.formatting.expressions import ExpressionPrinter, T
from hierc.grammar.formatting.layout import Break, Doc, Group, Indent, Line, concat, spaced


class Printer(ExpressionPrinter):
    """Makes documents of statements. Each method takes its tokens from `tokens`, in the order of the text."""

    def file(self, file: tree.File) -> Doc:
        """The whole file, with the comments at its end."""
        parts: list[Doc] = []
        for item in file.items:
            parts += [Break(blank=self.tokens.blank_ahead), self.item(item)]
        parts += [Break(blank=self.tokens.blank_ahead), self.tokens.lead(closing=True)]
        return concat(*parts)

    # ---- definitions of a file ------------------------------------------------------------------

    def item(self, item: tree.Item) -> Doc:
        """One definition of a file."""
        take = self.tokens.take
        match item:
            case tree.Import(module=module, alias=alias):
                head = spaced(take("import"), self.dotted(module))
                if alias is not None:
                    head = spaced(head, take("as"), self.name(alias))
                return concat(head, take(";"))
            case tree.FromImport(module=module, names=names):
                return self.row(spaced(take("from"), self.dotted(module), take("import")), names, self.name)
            case tree.Const():
                return self.const(item)
            case tree.Func():
                return self.func(item)
            case tree.Extern():
                head = spaced(
                    take("extern"), self.type(item.type), self.signature(item), self.unit(item.unit)
                )
                return concat(spaced(head, take("="), self.tokens.take_string()), take(";"))
            case tree.Table():
                head = spaced(take("table"), self.signature(item), self.unit(item.unit), take("="))
                head = concat(spaced(head, self.tokens.take_string()), take(","))
                return concat(spaced(head, self.name(item.method)), take(";"))
            case tree.Agent():
                head = spaced(take("agent"), self.signature(item))
                return spaced(head, self.block(item, item.items, self.agent_item))
            case tree.Experiment():
                return self.experiment(item)
            case _:
                assert_never(item)

    def signature(self, item: tree.Agent | tree.Func | tree.Extern | tree.Table) -> Doc:
        """The name and the parameters."""
        return concat(self.name(item.name), self.bracketed("(", item.params, self.param, ")"))

    def param(self, param: tree.Param) -> Doc:
        head = spaced(self.type(param.type), self.name(param.name), self.unit(param.unit))
        return head if param.default is None else self.defined(head, "=", param.default)

    def type(self, type_: tree.Type) -> Doc:
        return concat(self.tokens.take(type_.scalar), self.subscripts(type_.sizes))

    def const(self, const: tree.Const) -> Doc:
        head = spaced(
            self.tokens.take("const"), self.type(const.type), self.name(const.name), self.unit(const.unit)
        )
        return self.ended(self.defined(head, "=", const.value))

    def func(self, func: tree.Func) -> Doc:
        """A body that is a matrix begins behind the `=`, any other on the next line if it does not fit."""
        head = spaced(self.tokens.take("func"), self.type(func.type), self.signature(func))
        if isinstance(func.body, tree.ListExpr) and isinstance(func.body.items[0], tree.ListExpr):
            return self.ended(self.defined(head, "=", func.body))
        head = spaced(head, self.tokens.take("="))
        return self.ended(concat(head, Group(Indent(concat(Line(), self.expr(func.body))))))

    def experiment(self, item: tree.Experiment) -> Doc:
        take = self.tokens.take
        head = spaced(take("experiment"), self.name(item.name), take("of"), self.dotted(item.agent))
        head = concat(head, self.bracketed("(", item.args, self.exp_arg, ")"))
        if item.bindings:
            head = spaced(head, self.bracketed("[", item.bindings, self.bind, "]"))
        return spaced(head, self.block(item, item.items, self.exp_item))

    # ---- statements of an agent -----------------------------------------------------------------

    def agent_item(self, item: tree.AgentItem) -> Doc:
        """One statement of an agent, a level or a mode."""
        take = self.tokens.take
        match item:
            case tree.Decl():
                return self.decl(item)
            case tree.Const():
                return self.const(item)
            case tree.Let():
                head = spaced(take("let"), self.name(item.name), self.unit(item.unit))
                return self.ended(self.defined(head, "=", item.value))
            case tree.Diff():
                return spaced(take("diff"), self.block(item, item.equations, self.diff_equation))
            case tree.Alge():
                return spaced(take("alge"), self.block(item, item.equations, self.alge_equation))
            case tree.Inv():
                return spaced(take("inv"), self.block(item, item.invariants, self.invariant))
            case tree.Mode():
                init = take("init") if item.init else None
                head = spaced(init, take("mode"), self.name(item.name))
                return spaced(head, self.block(item, item.items, self.agent_item))
            case tree.Trans():
                return self.trans(item)
            case tree.Sample():
                return self.sample(item)
            case tree.Instance():
                return self.instance(item)
            case tree.Level():
                head = spaced(take("level"), self.name(item.name))
                return spaced(head, self.block(item, item.items, self.agent_item))
            case tree.Group():
                head = spaced(take("group"), self.name(item.name), take("="))
                return self.row(head, item.members, self.pattern)
            case tree.GroupEach():
                return self.ended(spaced(take("group"), take("each"), self.name(item.name)))
            case _:
                assert_never(item)

    def decl(self, decl: tree.Decl) -> Doc:
        access = self.tokens.take(decl.access)
        if decl.kind == "analog":  # what is not said otherwise is analog
            access = concat(access, self.tokens.drop("analog"))
        elif decl.kind is not None:
            access = spaced(access, self.tokens.take(decl.kind))
        return self.row(spaced(access, self.type(decl.type)), decl.declarators, self.declarator)

    def declarator(self, item: tree.Declarator) -> Doc:
        doc = spaced(self.name(item.name), self.unit(item.unit))
        if item.initial is not None:
            doc = self.defined(doc, "=", item.initial)
        if item.nominal is not None:
            doc = spaced(doc, self.tokens.take("nominal"), self.expr(item.nominal))
        return doc

    def diff_equation(self, item: tree.Equation | tree.ForBlock) -> Doc:
        if isinstance(item, tree.ForBlock):
            return self.for_block(item, self.diff_equation)
        head = concat(self.target(item.target), self.tokens.take("'"))
        return self.ended(self.defined(head, "=", item.value))

    def alge_equation(self, item: tree.Equation | tree.ForBlock) -> Doc:
        if isinstance(item, tree.ForBlock):
            return self.for_block(item, self.alge_equation)
        return self.ended(self.defined(self.target(item.target), "=", item.value))

    def for_block(self, item: tree.ForBlock, show: Callable[[tree.Equation], Doc]) -> Doc:
        head = spaced(self.tokens.take("for"), self.over(item.over))
        return spaced(head, self.block(item, item.equations, show))

    def invariant(self, item: tree.Invariant) -> Doc:
        condition = self.expr(item.condition)
        if item.message is None:
            return self.ended(condition)
        message = spaced(self.tokens.take(":"), self.tokens.take_string())
        return self.ended(Group(concat(condition, Indent(concat(Line(), message)))))

    def target(self, target: tree.Target) -> Doc:
        return concat(self.name(target.name), self.subscripts(target.subs))

    def assign(self, item: tree.Assign) -> Doc:
        return self.ended(self.defined(self.target(item.target), ":=", item.value))

    def trans(self, item: tree.Trans) -> Doc:
        take = self.tokens.take
        head = take("trans")
        if item.source is not None and item.target is not None:
            head = spaced(head, take("from"), self.dotted(item.source), take("to"))
            head = spaced(head, take("history") if item.history else None, self.dotted(item.target))
        guard = spaced(take("when"), self.expr(item.guard))
        head = Group(concat(head, Indent(concat(Line(), guard))))
        if self.tokens.sees(";"):
            return self.ended(head)
        return spaced(head, take("do"), self.block(item, item.assigns, self.assign))

    def sample(self, item: tree.Sample) -> Doc:
        take = self.tokens.take
        head = spaced(take("sample"), take(item.rate), self.expr(item.period))
        if item.offset is not None:
            head = spaced(head, take("offset"), self.expr(item.offset))
        return spaced(head, self.block(item, item.assigns, self.assign))

    def instance(self, item: tree.Instance) -> Doc:
        take = self.tokens.take
        head = spaced(take("agent"), self.name(item.name))
        if item.index is not None:
            head = concat(head, take("["), self.over(item.index), take("]"))
        head = spaced(head, take("="), self.dotted(item.agent))
        head = concat(head, self.bracketed("(", item.args, self.arg, ")"))
        if item.bindings:
            head = spaced(head, self.bracketed("[", item.bindings, self.bind, "]"))
        return self.ended(head)

    def arg(self, item: tree.Arg) -> Doc:
        return self.defined(self.name(item.name), "=", item.value)

    def bind(self, item: tree.Bind) -> Doc:
        return self.defined(self.name(item.name), ":=", item.value)

    def pattern(self, item: tree.Pattern) -> Doc:
        return concat(self.path(item.path), self.tokens.take(".*") if item.star else "")

    # ---- statements of an experiment ------------------------------------------------------------

    def exp_item(self, item: tree.ExpItem) -> Doc:
        """One statement of an experiment."""
        take = self.tokens.take
        match item:
            case tree.Setting():
                return self.setting(item)
            case tree.Record():
                return self.row(take("record"), item.patterns, self.pattern)
            case tree.Save():
                return self.row(take("save"), item.files, lambda _: self.tokens.take_string())
            case tree.InitBlock():
                return spaced(take("init"), self.block(item, item.values, self.initial))
            case tree.GroupSettings():
                head = spaced(take("group"), self.path(item.path))
                return spaced(head, self.block(item, item.settings, self.setting))
            case _:
                assert_never(item)

    def exp_arg(self, item: tree.ExpArg) -> Doc:
        return self.defined(self.path(item.path), "=", item.value)

    def setting(self, item: tree.Setting) -> Doc:
        return self.ended(self.defined(self.name(item.name), "=", item.value))

    def initial(self, item: tree.Initial) -> Doc:
        return self.ended(self.defined(self.path(item.path), "=", item.value))

    # ---- shapes of statements -------------------------------------------------------------------

    def ended(self, doc: Doc) -> Doc:
        """A statement with its `;`."""
        return concat(doc, self.tokens.take(";"))

    def row(self, head: Doc, items: Sequence[T], show: Callable[[T], Doc]) -> Doc:
        """A statement that lists items: `write real x, y;`."""
        return self.ended(concat(head, " ", Indent(Group(concat(*self.listed(items, show))))))

    def block(self, node: tree.Node, items: Sequence[T], show: Callable[[T], Doc]) -> Doc:
        """Statements in braces, up to the end of `node`."""
        start = self.tokens.next
        left = self.tokens.piece("{")
        inner: list[Doc] = []
        for i, item in enumerate(items):
            inner += [Line(blank=i > 0 and self.tokens.blank_ahead), self.tokens.lead(), show(item)]
        blank = bool(items) and self.tokens.blank_ahead
        right = self.tokens.piece("}")
        if right.lead != "":
            inner += [Line(blank=blank), right.lead]
        if not inner:
            return concat(*left, *right)
        on_lines = "\n" in self.tokens.text[start : node.span.stop]
        group = Group(concat(left.text, left.trail, Indent(concat(*inner)), Line(), right.text), on_lines)
        return concat(left.lead, group, right.trail)
