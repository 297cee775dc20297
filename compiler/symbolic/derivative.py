"""Derivatives: exact Jacobians of values by states and inputs.

In: values (the rows). Out: for each row, its nonzero derivatives by column. Guaranteed: a derivative evaluates nothing outside the branch its
value stands in; `max`, `min` and `abs` have the derivative of the branch taken, steps (`sign`, `floor`, comparisons) derivative zero, a root at
zero, which has none, as well.

The unknowns of a system A x = b are differentiated by the columns at once: dx is the solution for db - dA x, with the factors that A has already.

Every value gets the partial derivatives of its own operation; intermediate values are then eliminated from this graph in Markowitz order,
which takes few multiplications whether rows or columns are many (Griewank & Reese, 1991). Nothing is ever substituted, so nothing swells.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Iterable, Sequence

from hierc.compiler.callees.callee import Extern, Table
from hierc.compiler.symbolic.errors import TooLarge
from hierc.compiler.symbolic.graph import BOOLEAN, Called, Depends, Graph, Value
from hierc.grammar.problems import ModelError
from hierc.grammar.source import Span

#: Choices to differentiate in one class; one that stands in several branches counts in each.
CHOICES = 10_000

#: Relative step of central differences: the third root of the spacing of doubles, where truncation and rounding are alike.
STEP = 2.0**-17

#: Derivatives of one value: by which value, and the value of the derivative.
Gradient = dict[int, int]
#: Of each `solve`: the gradients of its unknowns.
Solved = dict[int, list[Gradient]]


def jacobian(graph: Graph, rows: Sequence[int], columns: Sequence[int], span: Span) -> list[Gradient]:
    """The nonzero derivatives of each row by the columns (leaves). `span` is the text to blame when there are too many."""
    return _Differentiation(graph, span).gradients(rows, frozenset(columns))


class _Differentiation:
    """Differentiates values of one class."""

    def __init__(self, graph: Graph, span: Span) -> None:
        self._graph = graph
        self._span = span
        self._visited = 0

    def gradients(
        self, rows: Sequence[int], by: Collection[int], solved: Solved | None = None
    ) -> list[Gradient]:
        """Derivatives of rows by the values `by`, which are held as independent. `solved`: what is known already for these."""
        graph = self._graph
        always = graph.always(rows)
        solved = {} if solved is None else solved
        for v in sorted(
            self._made_of(rows, by, through=True) & always
        ):  # ascending: one system after another
            if graph.values[v].op == "solve" and v not in solved:
                solved[v] = self._unknowns(v, by, solved)
        scope = {v for v in self._made_of(rows, by, through=False) & always if v not in by}
        known = {*by, *scope}
        into: dict[int, Gradient] = {}
        for v in sorted(scope):
            match graph.values[v]:
                case Value(op="choose"):
                    into[v] = self._choice(v, known)
                case Value(op="element", args=(system,), index=index):
                    into[v] = solved[system][index]
                case _:
                    into[v] = _partials(graph, v)
        one = graph.number(1.0)
        for k, row in enumerate(rows):
            into[-1 - k] = {row: one} if row in known else {}
        _eliminate(graph, into, scope)
        return [dict(sorted(into[-1 - k].items())) for k in range(len(rows))]

    def _made_of(self, rows: Iterable[int], by: Collection[int], *, through: bool) -> set[int]:
        """What rows are made of down to `by`, as far as that changes with columns; `through`: also what systems are made of."""
        graph = self._graph
        seen: set[int] = set()
        stack = list(rows)
        while stack:
            v = stack.pop()
            if v in seen or v in by or not graph.depends[v] & Depends.COLUMNS:
                continue
            seen.add(v)
            match graph.values[v]:
                case Value(op="element") if not through:
                    pass
                case Value(op="det", args=(factors,)):
                    stack += graph.values[factors].args
                case Value(args=args):
                    stack += args
        return seen

    def _unknowns(self, system: int, by: Collection[int], solved: Solved) -> list[Gradient]:
        """The gradients of all unknowns x of A x = b: for each column the solution of A dx = -dr, r being what A x - b is where x is held."""
        graph = self._graph
        factors, *right = graph.values[system].args
        matrix, n = graph.values[factors].args, graph.values[factors].size
        unknowns = [graph.unknown(factors, right, k) for k in range(n)]
        rests = [self._rest(matrix[j * n : (j + 1) * n], unknowns, right[j]) for j in range(n)]
        gradients = self.gradients(rests, {*by, *unknowns}, solved)
        found: list[Gradient] = [{} for _ in range(n)]
        for column in sorted({c for gradient in gradients for c in gradient}.difference(unknowns)):
            change = [graph.apply("neg", gradient.get(column, graph.number(0.0))) for gradient in gradients]
            for k, d in enumerate(_solution(graph, factors, change)):
                if graph.literal(d) != 0.0:
                    found[k][column] = d
        return found

    def _rest(self, row: Sequence[int], unknowns: Sequence[int], right: int) -> int:
        """What one equation leaves: its row times the unknowns less its right-hand side."""
        graph = self._graph
        total = graph.number(0.0)
        for a, x in zip(row, unknowns, strict=True):
            total = _plus(graph, total, graph.apply("mul", a, x))
        return graph.apply("sub", total, right)

    def _choice(self, value: int, known: Collection[int]) -> Gradient:
        """A choice between two values has the choice between their derivatives, each evaluated in its branch."""
        graph = self._graph
        self._visited += 1
        if self._visited > CHOICES:
            raise ModelError([TooLarge(self._span, "differentiation", CHOICES)])
        condition, then, other = graph.values[value].args
        yes, no = self.gradients([then], known)[0], self.gradients([other], known)[0]
        zero = graph.number(0.0)
        both = {p: graph.choose(condition, yes.get(p, zero), no.get(p, zero)) for p in sorted({*yes, *no})}
        return {p: d for p, d in both.items() if d != zero}


# ---- elimination ------------------------------------------------------------------------


def _eliminate(graph: Graph, into: dict[int, Gradient], scope: Collection[int]) -> None:
    """Replaces every edge into a value of `scope` by edges into what that value is made of."""
    users: dict[int, set[int]] = {v: set() for v in scope}
    for v, gradient in into.items():
        for p in gradient:
            if p in users:
                users[p].add(v)

    def cost(v: int) -> int:
        return len(users[v]) * len(into[v])

    queue = [(cost(v), -v) for v in scope]
    heapq.heapify(queue)
    while queue:
        price, negative = heapq.heappop(queue)
        v = -negative
        if v not in users or price != cost(v):
            continue  # gone, or listed again at its present price
        own = into[v]
        for user in sorted(users.pop(v)):
            through = into[user].pop(v)
            _accumulate(graph, into[user], through, own)
            for p in own:
                if p in users:
                    (users[p].add if p in into[user] else users[p].discard)(user)
            if user in users:
                heapq.heappush(queue, (cost(user), -user))
        for p in own:
            if p in users:
                users[p].discard(v)
                heapq.heappush(queue, (cost(p), -p))
        del into[v]


def _accumulate(graph: Graph, total: Gradient, factor: int, gradient: Gradient) -> None:
    """Adds factor*gradient to `total`, dropping what cancels."""
    for p, d in gradient.items():
        term = _times(graph, factor, d)
        total[p] = _plus(graph, total[p], term) if p in total else term
        if graph.literal(total[p]) == 0.0:
            del total[p]


def _times(graph: Graph, a: int, b: int) -> int:
    """A product of derivatives; constant factors come first, so that they can be computed once a run."""
    for this, that in ((a, b), (b, a)):
        v = graph.values[this]
        if v.op == "choose" and graph.literal(v.args[1]) is not None and graph.literal(v.args[2]) is not None:
            condition, then, other = v.args  # from `max` or `min`: the other factor belongs into the branch
            return graph.choose(condition, _times(graph, then, that), _times(graph, other, that))
        if v.op == "neg":
            return graph.apply("neg", _times(graph, v.args[0], that))
    if _is_constant(graph, b):
        a, b = b, a
    if not _is_constant(graph, a):
        fixed, rest = _constant_factor(graph, b)
        if fixed is not None:
            return _times(graph, fixed, _times(graph, a, rest))
        fixed, rest = _constant_factor(graph, a)
        if fixed is not None:
            return _times(graph, fixed, _times(graph, rest, b))
    elif not _is_constant(graph, b):
        fixed, rest = _constant_factor(graph, b)
        if fixed is not None:
            return graph.apply("mul", graph.apply("mul", a, fixed), rest)
    return graph.apply("mul", a, b)


def _plus(graph: Graph, a: int, b: int) -> int:
    """A sum of derivatives; two choices on one condition are one."""
    x, y = graph.values[a], graph.values[b]
    if x.op == y.op == "choose" and x.args[0] == y.args[0]:
        then, other = (_plus(graph, x.args[k], y.args[k]) for k in (1, 2))
        return graph.choose(x.args[0], then, other)
    return graph.apply("add", a, b)


def _solution(graph: Graph, factors: int, right: Sequence[int]) -> list[int]:
    """The unknowns for a right-hand side; where that has one entry only, a column of the inverse times it."""
    n = len(right)
    nonzero = [j for j, b in enumerate(right) if graph.literal(b) != 0.0]
    if len(nonzero) != 1:
        return [graph.unknown(factors, right, k) for k in range(n)]
    (j,) = nonzero
    return [_times(graph, right[j], _of_inverse(graph, factors, k, j)) for k in range(n)]


def _of_inverse(graph: Graph, factors: int, row: int, column: int) -> int:
    """An entry of the inverse."""
    unit = [graph.number(float(k == column)) for k in range(graph.values[factors].size)]
    return graph.unknown(factors, unit, row)


def _is_constant(graph: Graph, value: int) -> bool:
    return not graph.depends[value] & Depends.RUN


def _constant_factor(graph: Graph, value: int) -> tuple[int | None, int]:
    """Splits a product into a factor that is constant during a run, and the rest."""
    v = graph.values[value]
    if v.op == "mul":
        for this, that in (v.args, v.args[::-1]):
            if _is_constant(graph, this):
                return this, that
    return None, value


# ---- the operations -------------------------------------------------------------------------

_STEPS = frozenset({"sign", "floor", "ceil", "round", "quotient"}) | BOOLEAN


def _partials(graph: Graph, value: int) -> Gradient:
    """Derivatives of one operation by its arguments."""
    v = graph.values[value]
    if v.op in _STEPS:
        return {}
    if v.op == "det":
        return _of_determinant(graph, value)
    if v.op == "call":
        return _of_call(graph, value)
    total: Gradient = {}
    one = graph.number(1.0)
    for k, argument in enumerate(v.args):
        if graph.depends[argument] & Depends.COLUMNS:
            _accumulate(graph, total, _PARTIALS[v.op](graph, value, *v.args)[k](), {argument: one})
    return total


def _of_determinant(graph: Graph, value: int) -> Gradient:
    """Derivatives of a determinant by the entries of its matrix: its cofactors, the determinant times the transposed inverse."""
    (factors,) = graph.values[value].args
    n = graph.values[factors].size
    total: Gradient = {}
    for place, entry in enumerate(graph.values[factors].args):
        if graph.depends[entry] & Depends.COLUMNS:
            of_inverse = _of_inverse(graph, factors, place % n, place // n)
            _accumulate(graph, total, _times(graph, value, of_inverse), {entry: graph.number(1.0)})
    return total


def _of_call(graph: Graph, value: int) -> Gradient:
    """Derivatives of a table, which it has itself, and of an external function, by central differences."""
    v = graph.values[value]
    called = graph.called[v.index]
    total: Gradient = {}
    for place, argument in enumerate(v.args):
        if not graph.depends[argument] & Depends.COLUMNS:
            continue
        slope = _slope(graph, called, v.args, place)
        _accumulate(graph, total, slope, {argument: graph.number(1.0)})
    return total


def _slope(graph: Graph, called: Called, args: Sequence[int], place: int) -> int:
    """The derivative of a call by one of its arguments."""
    match called:
        case Called(callee=Table(method="hold")):
            return graph.number(0.0)
        case Called(callee=Table() as table, by=None):
            return graph.call(table, args, place)
        case Called(callee=Extern() as extern):
            return _difference(graph, extern, args, place)
        case _:
            raise ValueError("a table was differentiated twice")


def _difference(graph: Graph, extern: Extern, args: Sequence[int], place: int) -> int:
    """(f(x + h) - f(x - h))/2h, h being `STEP` times the argument's size and one of its unit."""
    x = args[place]
    size = graph.apply("add", graph.apply("abs", x), graph.number(extern.scale_of_scalar(place)))
    h = graph.apply("mul", graph.number(STEP), size)
    above, below = (
        graph.call(extern, (*args[:place], graph.apply(op, x, h), *args[place + 1 :]))
        for op in ("add", "sub")
    )
    return graph.apply("div", graph.apply("sub", above, below), graph.apply("mul", graph.number(2.0), h))


#: By argument: makes the derivative by it.
Partials = tuple[Callable[[], int], ...]


def _linear(*signs: float) -> Callable[..., Partials]:
    def partials(graph: Graph, value: int, *args: int) -> Partials:
        return tuple((lambda s=s: graph.number(s)) for s in signs)

    return partials


def _mul(g: Graph, value: int, a: int, b: int) -> Partials:
    return (lambda: b), (lambda: a)


def _div(g: Graph, value: int, a: int, b: int) -> Partials:
    return (lambda: _inverse(g, b)), (lambda: g.apply("neg", g.apply("mul", value, _inverse(g, b))))


def _pow(g: Graph, value: int, a: int, b: int) -> Partials:
    def by_base() -> int:
        return g.apply("mul", b, g.apply("pow", a, g.apply("sub", b, g.number(1.0))))

    def by_exponent() -> int:  # at a base of zero the power does not depend on a positive exponent
        positive = g.apply("gt", a, g.number(0.0))
        return g.choose(positive, g.apply("mul", value, g.apply("log", a)), g.number(0.0))

    return by_base, by_exponent


def _sqrt(g: Graph, value: int, a: int) -> Partials:
    def by() -> (
        int
    ):  # at zero none exists, but the length of a vector has the slope zero between those on all sides
        positive = g.apply("gt", value, g.number(0.0))
        return g.choose(positive, g.apply("div", g.number(0.5), value), g.number(0.0))

    return (by,)


def _exp(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: value),)


def _log(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: _inverse(g, a)),)


def _log10(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("div", g.number(1.0 / math.log(10.0)), a)),)


def _sin(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("cos", a)),)


def _cos(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("neg", g.apply("sin", a))),)


def _tan(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("add", g.number(1.0), _square(g, value))),)


def _asin(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: _inverse(g, g.apply("sqrt", g.apply("sub", g.number(1.0), _square(g, a))))),)


def _acos(g: Graph, value: int, a: int) -> Partials:
    (by,) = _asin(g, value, a)
    return ((lambda: g.apply("neg", by())),)


def _atan(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: _inverse(g, g.apply("add", g.number(1.0), _square(g, a)))),)


def _atan2(g: Graph, value: int, y: int, x: int) -> Partials:
    def square() -> int:
        return g.apply("add", _square(g, x), _square(g, y))

    return (lambda: g.apply("div", x, square())), (lambda: g.apply("neg", g.apply("div", y, square())))


def _sinh(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("cosh", a)),)


def _cosh(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("sinh", a)),)


def _tanh(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("sub", g.number(1.0), _square(g, value))),)


def _abs(g: Graph, value: int, a: int) -> Partials:
    return ((lambda: g.apply("sign", a)),)


def _extreme(comparison: str) -> Callable[[Graph, int, int, int], Partials]:
    def partials(g: Graph, value: int, a: int, b: int) -> Partials:
        first = g.apply(comparison, a, b)
        zero, one = g.number(0.0), g.number(1.0)
        return (lambda: g.choose(first, one, zero)), (lambda: g.choose(first, zero, one))

    return partials


def _mod(g: Graph, value: int, a: int, b: int) -> Partials:
    return (lambda: g.number(1.0)), (lambda: g.apply("neg", g.apply("quotient", a, b)))


def _square(g: Graph, a: int) -> int:
    return g.apply("mul", a, a)


def _inverse(g: Graph, a: int) -> int:
    return g.apply("div", g.number(1.0), a)


_PARTIALS: dict[str, Callable[..., Partials]] = {
    "add": _linear(1.0, 1.0), "sub": _linear(1.0, -1.0), "neg": _linear(-1.0), "mul": _mul, "div": _div, "pow": _pow,
    "sqrt": _sqrt, "exp": _exp, "log": _log, "log10": _log10, "sin": _sin, "cos": _cos, "tan": _tan, "asin": _asin,
    "acos": _acos, "atan": _atan, "atan2": _atan2, "sinh": _sinh, "cosh": _cosh, "tanh": _tanh, "abs": _abs,
    "max": _extreme("gt"), "min": _extreme("lt"), "mod": _mod,
}  # fmt: skip
