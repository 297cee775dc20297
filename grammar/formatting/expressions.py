"""Expressions as documents.

In: an expression of the tree and the tokens of its text, of which it takes exactly its own. Parentheses are the writer's:
the tree has none, and which ones make a formula easier to read is not for a formatter to say. Where a formula is too long for a
line it continues before an operator, and its brackets open onto lines of their own. Lines that the writer ended are kept then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar, assert_never

from hierc.grammar import tree
from hierc.grammar.formatting.layout import Doc, Group, Indent, Line, Wrap, concat, is_forced, spaced
from hierc.grammar.formatting.trivia import Piece, Tokens

T = TypeVar("T")

_LEVELS = (("or",), ("and",), ("==", "!=", "<=", ">=", "<", ">"), ("+", "-"), ("*", "/", ".*", "./"), ("^",))
_LEVEL = {op: level for level, ops in enumerate(_LEVELS) for op in ops}
_TIGHT = frozenset({"*", "/", "^"})
_SUM, _POWER = _LEVEL["+"], _LEVEL["^"]


class ExpressionPrinter:
    """Makes documents of expressions. Each method takes its tokens from `tokens`, in the order of the text."""

    def __init__(self, text: str) -> None:
        self.tokens = Tokens(text)

    # ---- names and literals ---------------------------------------------------------------------

    def name(self, name: tree.Name) -> Doc:
        return self.tokens.take(name.text)

    def unit(self, unit: tree.Unit | None) -> Doc | None:
        return None if unit is None else concat(*self.tokens.piece(unit.span.text, f"[{unit.text}]"))

    def dotted(self, dotted: tree.Dotted) -> Doc:
        parts = [self.name(dotted.names[0])]
        for name in dotted.names[1:]:
            parts += [self.tokens.take("."), self.name(name)]
        return concat(*parts)

    def path(self, path: tree.Path) -> Doc:
        parts = []
        for i, step in enumerate(path.steps):
            dot = self.tokens.take(".") if i else ""
            parts += [dot, self.name(step.name), self.subscripts(step.subs)]
        return concat(*parts)

    def subscripts(self, subs: Sequence[tree.Expr | tree.Range]) -> Doc:
        """`[1,2]`, with spaces where an index has spaces: `[i - 1, j]`."""
        if not subs:
            return ""
        ends = [e for sub in subs for e in ((sub.first, sub.last) if isinstance(sub, tree.Range) else (sub,))]
        gap = " " if any(isinstance(end, tree.Binary | tree.Cond) for end in ends) else ""
        parts = [self.tokens.take("[")]
        for i, sub in enumerate(subs):
            comma = concat(self.tokens.take(","), gap) if i else ""
            parts += [comma, self.range(sub) if isinstance(sub, tree.Range) else self.expr(sub)]
        return concat(*parts, self.tokens.take("]"))

    def range(self, range_: tree.Range) -> Doc:
        first = self.expr(range_.first, tight=True)
        return concat(first, self.tokens.take(".."), self.expr(range_.last, tight=True))

    def over(self, over: tree.Over) -> Doc:
        return spaced(self.name(over.index), self.tokens.take("in"), self.range(over.range))

    # ---- expressions ----------------------------------------------------------------------------

    def expr(self, expr: tree.Expr, *, tight: bool = False) -> Doc:
        """An expression with the parentheses around it; `tight` sums have no spaces."""
        opening: list[Doc] = []
        while self.in_parentheses(expr):
            opening.append(self.tokens.take("("))
        if not opening:
            return self._bare(expr, tight)
        inner = self._bare(expr, False)
        inner = Indent(inner) if isinstance(expr, tree.Cond) else inner
        return concat(*opening, inner, *[self.tokens.take(")") for _ in opening])

    def in_parentheses(self, expr: tree.Expr) -> bool:
        """Whether what comes next is a parenthesis around an expression."""
        return self.tokens.next < expr.span.start

    def _bare(self, expr: tree.Expr, tight: bool) -> Doc:
        tokens = self.tokens
        match expr:
            case tree.Number():
                return spaced(tokens.take(expr.text), self.unit(expr.unit))
            case tree.Bool() | tree.Time():
                return tokens.take(expr.span.text)
            case tree.Ref():
                return concat(self.path(expr.path), tokens.take("'") if expr.prime else "")
            case tree.Call():
                return concat(self.path(expr.function), self.bracketed("(", expr.args, self.expr, ")"))
            case tree.Unary():
                sign = concat(tokens.take(expr.op), " " if expr.op == "not" else "")
                return concat(sign, self.expr(expr.operand))
            case tree.Binary():
                return self._chain(expr, tight)
            case tree.Cond():
                return self._cond(expr)
            case tree.ListExpr():
                return self.bracketed("[", expr.items, self.expr, "]")
            case tree.Comprehension():
                return self._comprehension(expr)
            case _:
                assert_never(expr)

    def _chain(self, expr: tree.Binary, tight: bool) -> Doc:
        """Operands of equal precedence side by side: `a + b - c`, without recursion."""
        level = _LEVEL[expr.op]
        if level == _POWER:
            return concat(self.expr(expr.left), self.tokens.take("^"), self.expr(expr.right))
        chain = [expr]
        while isinstance(left := chain[-1].left, tree.Binary) and _LEVEL[left.op] == level:
            if left.span.start != chain[-1].span.start:  # in parentheses
                break
            chain.append(left)
        chain.reverse()
        first = self.expr(chain[0].left)
        others = [self._operation(link, tight and level == _SUM) for link in chain]
        if isinstance(expr.right, tree.ListExpr) and expr.op in _TIGHT:
            # `w*[a, b]`: the list opens, its factors stay in front of it
            last = others.pop()
            return concat(Group(concat(first, Indent(concat(*others)))), last.flat, last.item)
        return Group(concat(first, Indent(concat(*others))))

    def _operation(self, link: tree.Binary, tight: bool) -> Wrap:
        """An operator and its right operand, as what follows in a chain."""
        gap = "" if tight or link.op in _TIGHT else " "
        kept = self.tokens.break_ahead
        op = self.tokens.take(link.op)
        kept = kept or self.tokens.break_ahead
        return Wrap(gap, concat(op, gap, self.expr(link.right)), kept)

    def _cond(self, expr: tree.Cond) -> Doc:
        """`if a then b else if c then d else e`, each choice a line of its own if need be."""
        choices: list[Doc] = []
        word: Doc = ""
        last: tree.Expr = expr
        while isinstance(last, tree.Cond) and not self.in_parentheses(last):
            choices.append(concat(word, self._choice(last)))
            word = concat(Line(), self.tokens.take("else"), " ")
            last = last.other
        return Group(concat(*choices, word, self.expr(last)))

    def _choice(self, expr: tree.Cond) -> Doc:
        condition = spaced(self.tokens.take("if"), self.expr(expr.condition))
        return Group(
            concat(condition, Indent(concat(Line(), self.tokens.take("then"), " ", self.expr(expr.then))))
        )

    def _comprehension(self, expr: tree.Comprehension) -> Doc:
        opening = self.tokens.piece("[")
        item = concat(self.tokens.lead(), self.expr(expr.item))
        over = spaced(self.tokens.take("for"), self.over(expr.over))
        return _bracketed(opening, concat(item, Line(), over), self.tokens.piece("]"))

    # ---- rows -----------------------------------------------------------------------------------

    def defined(self, head: Doc, sign: str, value: tree.Expr) -> Doc:
        """`head = value`; a value of several choices begins on a line of its own."""
        equals = self.tokens.take(sign)
        if isinstance(value, tree.Cond) and not self.in_parentheses(value):
            return concat(head, " ", equals, Group(Indent(concat(Line(), self.expr(value)))))
        lead = self.tokens.lead()
        shown = concat(lead, self.expr(value))
        on_next_line = is_forced(equals) or is_forced(lead)
        return concat(head, " ", equals, " ", Indent(shown) if on_next_line else shown)

    def bracketed(self, opening: str, items: Sequence[T], show: Callable[[T], Doc], closing: str) -> Doc:
        """Items between brackets, on their own lines if need be. The rows of a matrix stay rows."""
        left = self.tokens.piece(opening)
        parts = self.listed(items, show)
        broken = False
        if all(isinstance(item, tree.ListExpr) for item in items):
            broken = any(isinstance(part, Wrap) and part.kept for part in parts)
            parts = [concat(Line(), part.item) if isinstance(part, Wrap) else part for part in parts]
        return _bracketed(left, concat(*parts), self.tokens.piece(closing), broken=broken)

    def listed(self, items: Sequence[T], show: Callable[[T], Doc]) -> list[Doc]:
        """Items with commas between them. The comments before an item do not break it."""
        parts: list[Doc] = []
        for i, item in enumerate(items):
            kept = self.tokens.break_ahead
            shown = concat(self.tokens.lead(), show(item))
            comma = self.tokens.take(",") if i + 1 < len(items) else ""
            whole = concat(shown, comma)
            parts.append(Wrap(" ", whole, kept) if i else whole)
        return parts


def _bracketed(left: Piece, inner: Doc, right: Piece, *, broken: bool = False) -> Doc:
    """What stands between brackets. Comments before the first and behind the second bracket do not break it."""
    if inner == "" and right.lead == "":
        return concat(*left, *right)
    inside = Indent(concat(Line(""), inner, right.lead))
    group = Group(concat(left.text, left.trail, inside, Line(""), right.text), broken)
    return concat(left.lead, group, right.trail)
