"""Inference: the unit of every expression.

In: an expression whose names are right, and a `Scope` that knows their units. Out: a `Quantity`; what does not fit is reported where it stands, and
its unit is unknown from there on. An expression is visited once, without recursion; the body of a function of the user's is inferred again for
each set of argument units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, assert_never

from hierc.compiler.resolve.declarations import Library
from hierc.compiler.resolve.names import size_names
from hierc.compiler.units import functions
from hierc.compiler.units.agreement import Operand, Rules, named, operand
from hierc.compiler.units.errors import ArgumentUnit, Side, UnitsDiffer
from hierc.compiler.units.exponents import rational
from hierc.compiler.units.quantity import (
    PURE,
    TIME,
    UNKNOWN,
    Listed,
    Measured,
    Plain,
    Quantity,
    Unknown,
    declared,
    elementwise,
    in_unit,
    power,
    product,
    quotient,
    rate,
    uniform,
    whole,
)
from hierc.compiler.walk import visit
from hierc.grammar import tree
from hierc.grammar.problems import Problem
from hierc.grammar.source import Span

#: Expressions that calls of functions may visit again; units beyond that are unknown.
MAX_VISITS = 100_000
#: Functions that call functions are followed so deep.
MAX_CALLS = 40


class Scope(Protocol):
    """What names stand for."""

    def quantity(self, name: str, ref: tree.Ref) -> Quantity:
        """What the variable, constant or parameter is in, before any subscript or prime."""
        ...

    def constant(self, name: str) -> tree.Const | None:
        """The constant of this name, if it is one."""
        ...


@dataclass(slots=True)
class Shared:
    """What all inferences of a file share: functions, the rules, and the results of calls so far."""

    library: Library
    rules: Rules
    calls: dict[tuple[object, ...], Quantity] = field(default_factory=dict)
    visits: int = 0


@dataclass(frozen=True, slots=True)
class FileScope:
    """Constants of the file, and `pi`; `names`, with their units, come first."""

    library: Library
    names: Mapping[str, Quantity]

    def quantity(self, name: str, ref: tree.Ref) -> Quantity:
        """See `Scope`."""
        if name in self.names and len(ref.path.steps) == 1:
            return self.names[name]
        const = self.constant(name)
        if const is not None:
            return declared(const.unit, const.type.scalar)
        return Plain() if name == "pi" else UNKNOWN

    def constant(self, name: str) -> tree.Const | None:
        """See `Scope`."""
        return None if name in self.names else self.library.consts.get(name)


@dataclass(frozen=True, slots=True)
class Inference:
    """Infers expressions of one scope. `inside` is the call, in an agent, of the function that the scope is in; `depth` counts calls."""

    shared: Shared
    scope: Scope
    inside: Span | None = None
    depth: int = 0

    def quantity(self, expr: tree.Expr, bound: frozenset[str] = frozenset()) -> Quantity:
        """The unit of `expr`, in which the names `bound` are indices."""
        found: dict[int, Quantity] = {}
        # Parents come first in a visit, so that backwards all parts of a node are known before it.
        for here in reversed(list(visit(expr, bound))):
            if self.depth:
                self.shared.visits += 1
            found[id(here.node)] = self._node(here.node, here.bound, found)
        return found[id(expr)]

    def _node(self, node: tree.Expr, bound: frozenset[str], found: Mapping[int, Quantity]) -> Quantity:
        def part(inner: tree.Expr) -> Operand:
            return operand(inner, found[id(inner)])

        match node:
            case tree.Number(unit=None, value=value):
                return Plain(value == 0)
            case tree.Number(unit=unit) if unit is not None:
                return in_unit(unit)
            case tree.Time():
                return TIME
            case tree.Ref():
                return self._reference(node, bound)
            case tree.Call(args=args):
                return self._call(node, tuple(part(arg) for arg in args))
            case tree.Unary(operand=inner):
                return found[id(inner)]
            case tree.Binary(left=left, right=right):
                return self._binary(node, part(left), part(right), bound)
            case tree.Cond(then=then, other=other):
                return self.shared.rules.agreed(part(then), part(other), self._differ(node))
            case tree.ListExpr(items=items):
                return self._list(node, [part(item) for item in items])
            case tree.Comprehension(item=item):
                return whole(found[id(item)])
            case tree.Bool() | tree.Number():
                return UNKNOWN
            case _ as never:
                assert_never(never)

    def _differ(self, node: tree.Expr) -> Callable[[Side, Side], Problem]:
        """The problem that two parts of `node` are in different units."""
        match node:
            case tree.Binary(op_span=span) | tree.Cond(other=tree.Node(span=span)):
                pass
            case _:
                span = node.span

        def problem(left: Side, right: Side) -> Problem:
            return UnitsDiffer(span, text=node.span.text, left=left, right=right, call=self.inside)

        return problem

    # ---- operators ------------------------------------------------------------------------------------------------------------------

    def _binary(self, node: tree.Binary, left: Operand, right: Operand, bound: frozenset[str]) -> Quantity:
        match node.op:
            case "+" | "-":
                return self.shared.rules.agreed(left, right, self._differ(node))
            case "*":
                return product(left.quantity, right.quantity)
            case "/":
                return quotient(left.quantity, right.quantity)
            case ".*" | "./":
                return elementwise(left.quantity, right.quantity, divide=node.op == "./")
            case "^":
                return self._power(left, right, bound)
            case "==" | "!=" | "<=" | ">=" | "<" | ">":
                self.shared.rules.agreed(left, right, self._differ(node))
                return UNKNOWN
            case "and" | "or":
                return UNKNOWN
            case _ as never:
                assert_never(never)

    def _power(self, base: Operand, exponent: Operand, bound: frozenset[str]) -> Quantity:
        raised = functions.needed(
            exponent, "the exponent of `^`", functions.ANY_NUMBER, self.shared.rules, self.inside
        )
        unit = whole(base.quantity)
        if isinstance(unit, Unknown) or isinstance(raised, Unknown):
            return UNKNOWN
        if isinstance(unit, Plain):
            return Plain() if isinstance(raised, Plain) else PURE
        if unit.pure:
            return PURE
        known = rational(exponent.node, self.scope, bound) if exponent.node is not None else None
        return UNKNOWN if known is None else power(unit, known)

    def _list(self, node: tree.ListExpr, items: Sequence[Operand]) -> Quantity:
        """A list keeps its items apart; a plain number beside a unit that is not SI's own is reported here, where it stands."""
        quantity = Listed(tuple(item.quantity for item in items))
        common = uniform(quantity)
        if isinstance(common, Measured) and not common.coherent:
            neighbour = next(item for item in items if isinstance(whole(item.quantity), Measured))
            for item in items:
                if isinstance(whole(item.quantity), Plain):
                    self.shared.rules.agreed(neighbour, item, self._differ(node))
        return quantity

    # ---- names ----------------------------------------------------------------------------------------------------------------------

    def _reference(self, ref: tree.Ref, bound: frozenset[str]) -> Quantity:
        name = ref.path.steps[0].name.text
        if name in bound and len(ref.path.steps) == 1:
            return Plain()
        quantity = self.scope.quantity(name, ref)
        if ref.prime:
            quantity = rate(quantity)
        return self._chosen(quantity, ref.path.steps[-1].subs, bound)

    def _chosen(
        self, quantity: Quantity, subs: tuple[tree.Expr | tree.Range, ...], bound: frozenset[str]
    ) -> Quantity:
        """The items that subscripts choose, where both are known; else what all items have in common."""
        if not subs or not isinstance(quantity, Listed):
            return quantity
        sub = subs[0]
        ends = (sub.first, sub.last) if isinstance(sub, tree.Range) else (sub, sub)
        low, high = (rational(end, self.scope, bound) for end in ends)
        if low is None or high is None or not 1 <= low <= high <= len(quantity.items):
            return whole(quantity)
        if low.denominator != 1 or high.denominator != 1:
            return whole(quantity)
        rows = quantity.items[low.numerator - 1 : high.numerator]
        chosen = tuple(self._chosen(row, subs[1:], bound) for row in rows)
        return Listed(chosen) if isinstance(sub, tree.Range) else chosen[0]

    # ---- calls ----------------------------------------------------------------------------------------------------------------------

    def _call(self, call: tree.Call, args: tuple[Operand, ...]) -> Quantity:
        outside = self.shared.library.signature(call.function.text)
        if outside is not None:
            for param, argument in zip(outside.params, args, strict=False):
                self._argument(outside, param, argument)
            return declared(outside.unit, "real")
        func = self.shared.library.funcs.get(call.function.text)
        if func is None:
            return functions.value_of(functions.Call(call, args, self.shared.rules, self.inside))
        if len(args) != len(func.params) or self.depth >= MAX_CALLS or self.shared.visits > MAX_VISITS:
            return UNKNOWN
        given = {p.name.text: self._argument(func, p, a) for p, a in zip(func.params, args, strict=True)}
        key = (func.name.text, *given.values())
        if key not in self.shared.calls:
            inner = function_inference(self.shared, func, given)
            inner = replace(inner, inside=self.inside or call.span, depth=self.depth + 1)
            self.shared.calls[key] = inner.quantity(func.body)
        return self.shared.calls[key]

    def _argument(
        self, func: tree.Func | tree.Table | tree.Extern, param: tree.Param, given: Operand
    ) -> Quantity:
        """What a parameter is in for this call; reports an argument that is not in the declared unit."""
        wanted = declared(param.unit, param.type.scalar)
        if param.unit is None:
            return given.quantity if param.type.scalar == "real" else wanted

        def differ(left: Side, right: Side) -> Problem:
            text = f"`{left.text}` in {left.unit}"
            return ArgumentUnit(
                right.span, function=f"`{func.name.text}`", wanted=text, given=right, declared=left.span, call=self.inside
            )  # fmt: skip

        name = named(param.name, wanted)
        self.shared.rules.agreed(name, given, differ)
        return wanted


def function_inference(shared: Shared, func: tree.Func, given: Mapping[str, Quantity]) -> Inference:
    """The inference of a function's body, its parameters being as `given`."""
    sizes = dict.fromkeys(size_names(func, shared.library.consts), Plain())
    return Inference(shared, FileScope(shared.library, {**sizes, **given}))
