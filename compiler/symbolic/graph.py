"""Values: expressions as a graph in which equal expressions are one value.

In: operations and arguments. Out: value numbers. Guaranteed: arguments have smaller numbers than what is made of them, so passes are
loops, not recursions; equal operations on equal values are the same number (this eliminates common subexpressions); arithmetic on
literals is done, by the double precision operations that the generated code would use.

A system of equations is three kinds of value: `factor` of a matrix, which is no number; `solve`, all unknowns for one right-hand side; and `element`, one
of them. Everything about one matrix so shares one factorisation, and the unknowns one substitution.

Rewritten are only identities over the reals that keep the user's order of operations: `x*0`, `x/x`, `a + (-b)`, signs moved out of
products. A quotient stays a quotient and a sum keeps its association, so results are those of the plain reading, bit for bit.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntFlag

from hierc.compiler import exact
from hierc.compiler.callees.callee import Callee, Table
from hierc.compiler.symbolic.errors import OutOfRange, TooLarge
from hierc.grammar.problems import ModelError
from hierc.grammar.source import Span

#: Values a model may have; a model above it would not compile in reasonable time.
BUDGET = 2_000_000


class Depends(IntFlag):
    """What a value depends on."""

    NOTHING = 0
    TIME = 1
    STATE = 2
    INPUT = 4
    PARAMETER = 8
    COLUMNS = STATE | INPUT  # what Jacobians differentiate by
    RUN = TIME | STATE | INPUT  # what changes during a run


LEAVES = {
    "number": Depends.NOTHING,
    "time": Depends.TIME,
    "state": Depends.STATE,
    "input": Depends.INPUT,
    "parameter": Depends.PARAMETER,  # of the node
    "value": Depends.PARAMETER,  # of the class: something made of parameters, computed once a run
    "factors": Depends.PARAMETER,  # the same, for the factors of a matrix, which are several values in a row
}

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge, "eq": operator.eq, "ne": operator.ne,
}  # fmt: skip
BOOLEAN = frozenset(COMPARISONS) | {"and", "or", "not"}
COMMUTATIVE = frozenset(
    {"add", "mul", "eq", "ne", "and", "or"}
)  # `max` and `min` are not: which NaN, which zero
_TOTAL = frozenset({"add", "sub", "mul", "neg", "abs", "sign", "min", "max"}) | BOOLEAN
SYSTEMS = frozenset({"factor", "solve", "element", "det"})  # infinite or NaN where the matrix is singular


@dataclass(frozen=True, slots=True)
class Value:
    """An operation on earlier values, or a leaf: literal `number`, or entry `index` of an array; `element`: unknown `index`; `call`: of callee `index`.

    `size`: rows of the matrix, where it is about one.
    """

    op: str
    args: tuple[int, ...] = ()
    index: int = 0
    number: float = 0.0
    size: int = 0

    @property
    def entries(self) -> int:
        """How many doubles it takes, kept in an array: factors are n rows of n + 1, and the determinant."""
        return self.size * (self.size + 1) + 1 if self.op in ("factor", "factors") else 1


@dataclass(frozen=True, slots=True)
class Called:
    """What a `call` calls: a table or external function, or the derivative of a table by argument `by`."""

    callee: Callee
    by: int | None


def _sign(x: float) -> float:
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else x


def _round(x: float) -> float:
    """Half away from zero."""
    whole = math.floor(abs(x))
    return math.copysign(whole + (1.0 if abs(x) - whole >= 0.5 else 0.0), x)


#: What each operation does to literals.
_LITERALS: dict[str, Callable[..., float]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "neg": operator.neg,
    "pow": math.pow, "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "log10": math.log10,
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
    "atan2": math.atan2, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh,
    "abs": math.fabs, "sign": _sign, "floor": math.floor, "ceil": math.ceil, "round": _round,
    "mod": operator.mod, "quotient": lambda x, y: math.floor(x / y), "min": min, "max": max,
    "and": lambda x, y: x != 0.0 and y != 0.0, "or": lambda x, y: x != 0.0 or y != 0.0, "not": lambda x: x == 0.0,
    **COMPARISONS,
}  # fmt: skip


class Graph:
    """All values of a model; grows while a phase works on it."""

    def __init__(self) -> None:
        self.values: list[Value] = []
        self.called: list[Called] = []
        self.depends: list[Depends] = []
        self._spans: list[Span | None] = []
        self._numbers: dict[object, int] = {}
        self._span: Span | None = None
        self._always: dict[int, frozenset[int]] = {}

    # ---- making values ----------------------------------------------------------

    def at(self, span: Span | None) -> None:
        """Values made from now on come from this text of the user."""
        if span is not None:
            self._span = span

    def number(self, value: float) -> int:
        """A literal."""
        return self._intern(("number", value.hex()), Value("number", number=value), Depends.NOTHING)

    def leaf(self, op: str, index: int = 0, size: int = 0) -> int:
        """A state, input, parameter or value by its index, or time; factors by their first entry, with the size of their matrix."""
        return self._intern((op, index, size), Value(op, index=index, size=size), LEAVES[op])

    def apply(self, op: str, *args: int) -> int:
        """The value of an operation, simplified."""
        literals = [self.literal(a) for a in args]
        if None not in literals:
            folded = _fold(op, literals)
            if folded is not None:
                return self.number(folded)
        simple = _RULES[op](self, *args) if op in _RULES else None
        if simple is not None:
            return simple
        key = tuple(sorted(args)) if op in COMMUTATIVE else args
        return self._intern((op, key), Value(op, args), self._joined(args))

    def choose(self, condition: int, then: int, other: int) -> int:
        """A run-time `if`."""
        test = self.values[condition]
        if test.op == "number":
            return then if test.number != 0.0 else other
        if test.op == "not":
            return self.choose(test.args[0], other, then)
        if self._is_choice(then, condition):
            then = self.values[then].args[1]
        if self._is_choice(other, condition):
            other = self.values[other].args[2]
        if then == other:
            return then
        depends = self.depends[condition] | self.depends[then] | self.depends[other]
        args = (condition, then, other)
        return self._intern(("choose", args), Value("choose", args), depends)

    def kept(self, value: int, place: int) -> int:
        """The leaf that stands for a value of parameters that is kept from entry `place` on."""
        v = self.values[value]
        return self.leaf("value", place) if v.op != "factor" else self.leaf("factors", place, v.size)

    def rebuild(self, value: int, args: tuple[int, ...]) -> int:
        """The same operation on other arguments."""
        v = self.values[value]
        if args == v.args:
            return value
        self._span = self._spans[value]
        match v.op:
            case "choose":
                return self.choose(*args)
            case "factor":
                return self.factor(args)
            case "solve" | "element" | "det":
                return self._system(v.op, args, v.index)
            case "call":
                called = self.called[v.index]
                return self.call(called.callee, args, called.by)
            case _:
                return self.apply(v.op, *args)

    # ---- tables and external functions ------------------------------------------

    def call(self, callee: Callee, args: Sequence[int], by: int | None = None) -> int:
        """A table or external function, or a table's derivative by argument `by`. Of literals it is computed once a run."""
        called = Called(callee, by)
        if called not in self.called:
            self.called.append(called)
        index = self.called.index(called)
        depends = self._joined(args) | Depends.PARAMETER
        return self._intern(("call", index, tuple(args)), Value("call", tuple(args), index=index), depends)

    # ---- systems of equations ---------------------------------------------------

    def factor(self, matrix: Sequence[int]) -> int:
        """The factors of a square matrix, given row by row. They are no number: only `unknown` and `determinant` take them."""
        depends = self._joined(matrix)
        numbers = self._literals(matrix)
        if numbers is None or exact.determinant(numbers) != 0.0:  # of literals: to be computed once a run
            depends |= Depends.PARAMETER
        key = ("factor", tuple(matrix))
        return self._intern(key, Value("factor", tuple(matrix), size=math.isqrt(len(matrix))), depends)

    def unknown(self, factors: int, right: Sequence[int], index: int) -> int:
        """x[index] of A x = right, by the factors of A."""
        numbers = self._literals(right)
        if numbers is not None:
            if not any(numbers):
                return self.number(0.0)
            folded = self._folded(factors, lambda matrix: exact.solution(matrix, numbers)[index])
            if folded is not None:
                return self.number(folded)
        return self._system("element", (self._system("solve", (factors, *right)),), index)

    def determinant(self, factors: int) -> int:
        """The determinant of A, by its factors."""
        folded = self._folded(factors, exact.determinant)
        return self.number(folded) if folded is not None else self._system("det", (factors,))

    def _system(self, op: str, args: tuple[int, ...], index: int = 0) -> int:
        return self._intern(
            (op, args, index),
            Value(op, args, index=index, size=self.values[args[0]].size),
            self._joined(args),
        )

    def _folded(self, factors: int, function: Callable[[tuple[float, ...]], float]) -> float | None:
        """A function of a matrix of literals; None if it is none, or has no finite value."""
        numbers = self._literals(self.values[factors].args)
        try:
            return None if numbers is None or not numbers else function(numbers)
        except ArithmeticError:
            return None

    def _literals(self, values: Sequence[int]) -> tuple[float, ...] | None:
        """The numbers that values are, if all are literals."""
        numbers = tuple(self.values[v].number for v in values if self.values[v].op == "number")
        return numbers if len(numbers) == len(values) else None

    def _joined(self, values: Sequence[int]) -> Depends:
        """What several values together depend on."""
        depends = Depends.NOTHING
        for v in values:
            depends |= self.depends[v]
        return depends

    # ---- interning --------------------------------------------------------------

    def known(self, op: str, *args: int) -> int | None:
        """The value of an operation if it was made before."""
        return self._numbers.get((op, args))

    def _is_choice(self, value: int, condition: int) -> bool:
        v = self.values[value]
        return v.op == "choose" and v.args[0] == condition

    def _intern(self, key: object, value: Value, depends: Depends) -> int:
        found = self._numbers.get(key)
        if found is not None:
            return found
        if len(self.values) >= BUDGET:
            raise ModelError([TooLarge(self._require_span(self._span), "symbolic", BUDGET)])
        self._numbers[key] = len(self.values)
        self.values.append(value)
        self.depends.append(depends)
        self._spans.append(self._span)
        return len(self.values) - 1

    # ---- looking at values --------------------------------------------------------

    def literal(self, value: int) -> float | None:
        """The number a value is, if it is a literal."""
        v = self.values[value]
        return v.number if v.op == "number" else None

    def is_leaf(self, value: int) -> bool:
        """Whether a value is made of nothing."""
        return not self.values[value].args

    def is_total(self, value: int) -> bool:
        """Whether the operation (not its arguments) can be evaluated in vain: it has no domain, so it can neither raise nor trap."""
        v = self.values[value]
        if v.op == "div":
            return self.literal(v.args[1]) not in (None, 0.0)
        if v.op == "call":
            return isinstance(self.called[v.index].callee, Table)
        return not v.args or v.op in _TOTAL or v.op in SYSTEMS

    def reach(self, roots: Iterable[int]) -> list[int]:
        """Everything the roots are made of, in both branches of every `if`, arguments first."""
        seen: set[int] = set()
        stack = list(roots)
        while stack:
            v = stack.pop()
            if v not in seen:
                seen.add(v)
                stack.extend(self.values[v].args)
        return sorted(seen)

    def always(self, roots: Iterable[int]) -> set[int]:
        """What is evaluated whichever branches are taken; of an `if`: its condition and what both branches need."""
        waiting = [v for v in self.reach(roots) if self.values[v].op == "choose" and v not in self._always]
        for v in waiting:  # ascending: an inner `if` is known before the outer one asks
            _, then, other = self.values[v].args
            self._always[v] = frozenset(self._walk([then]) & self._walk([other]))
        return self._walk(roots)

    def _walk(self, roots: Iterable[int]) -> set[int]:
        seen: set[int] = set()
        stack = list(roots)
        while stack:
            v = stack.pop()
            if v in seen:
                continue
            seen.add(v)
            value = self.values[v]
            if value.op == "choose":
                stack.append(value.args[0])
                stack.extend(self._always[v] - seen)
            else:
                stack.extend(value.args)
        return seen

    def check(self, roots: Iterable[int]) -> None:
        """Raises ModelError where arithmetic on literals has no finite result."""
        bad = [v for v in self.reach(roots) if self.depends[v] == Depends.NOTHING and not self.is_leaf(v)]
        bad = [v for v in bad if all(self.is_leaf(a) for a in self.values[v].args)]
        if bad:
            operations = {v: self.values[v].op.replace("factor", "solve") for v in bad}
            raise ModelError([OutOfRange(self._require_span(self._spans[v]), operations[v]) for v in bad])

    @staticmethod
    def _require_span(span: Span | None) -> Span:
        if span is None:
            raise ValueError("an expression without a place in the source text")
        return span


def _fold(op: str, literals: list[float | None]) -> float | None:
    """The operation done on literals; None if there is no finite result."""
    try:
        result = float(_LITERALS[op](*literals))
    except (ArithmeticError, ValueError):
        return None
    return result if math.isfinite(result) else None


# ---- identities ---------------------------------------------------------------------
# Each rule gives the simpler value or None. `_negated` looks through a minus sign; `_reversed` at a difference the other way round.


def _negated(graph: Graph, value: int) -> int | None:
    v = graph.values[value]
    return v.args[0] if v.op == "neg" else None


def _add(graph: Graph, a: int, b: int) -> int | None:
    if graph.literal(a) == 0.0:
        return b
    if graph.literal(b) == 0.0:
        return a
    if (minus := _negated(graph, b)) is not None:
        return graph.apply("sub", a, minus)
    if (minus := _negated(graph, a)) is not None:
        return graph.apply("sub", b, minus)
    return None


def _sub(graph: Graph, a: int, b: int) -> int | None:
    if graph.literal(b) == 0.0:
        return a
    if graph.literal(a) == 0.0:
        return graph.apply("neg", b)
    if a == b:
        return graph.number(0.0)
    if (minus := _negated(graph, b)) is not None:
        return graph.apply("add", a, minus)
    if (minus := _negated(graph, a)) is not None:
        return graph.apply("neg", graph.apply("add", minus, b))
    return None


def _mul(graph: Graph, a: int, b: int) -> int | None:
    for this, that in ((a, b), (b, a)):
        match graph.literal(this):
            case 0.0:
                return graph.number(0.0)
            case 1.0:
                return that
            case -1.0:
                return graph.apply("neg", that)
        if (minus := _negated(graph, this)) is not None:
            return graph.apply("neg", graph.apply("mul", *((minus, b) if this == a else (a, minus))))
    return None


def _div(graph: Graph, a: int, b: int) -> int | None:
    match graph.literal(b):
        case 0.0:
            return None
        case 1.0:
            return a
        case -1.0:
            return graph.apply("neg", a)
    if graph.literal(a) == 0.0:
        return graph.number(0.0)
    if a == b:
        return graph.number(1.0)
    if (minus := _negated(graph, a)) is not None:
        return graph.apply("neg", graph.apply("div", minus, b))
    if (minus := _negated(graph, b)) is not None:
        return graph.apply("neg", graph.apply("div", a, minus))
    return None


def _neg(graph: Graph, a: int) -> int | None:
    v = graph.values[a]
    match v.op:
        case "neg":
            return v.args[0]
        case "sub":
            return graph.apply("sub", v.args[1], v.args[0])
    return None


def _pow(graph: Graph, a: int, b: int) -> int | None:
    match graph.literal(b):
        case 0.0:
            return graph.number(1.0)
        case 1.0:
            return a
        case 0.5:
            return graph.apply("sqrt", a)
    return None


def _reversed(graph: Graph, op: str, value: int) -> int | None:
    """The operation on b - a, where that was made before and `value` is a - b: the one is exactly minus the other."""
    v = graph.values[value]
    other = graph.known("sub", *v.args[::-1]) if v.op == "sub" else None
    return None if other is None else graph.known(op, other)


def _odd(op: str) -> Callable[[Graph, int], int | None]:
    def rule(graph: Graph, a: int) -> int | None:
        if (other := _reversed(graph, op, a)) is not None:
            return graph.apply("neg", other)
        minus = _negated(graph, a)
        return None if minus is None else graph.apply("neg", graph.apply(op, minus))

    return rule


def _even(op: str) -> Callable[[Graph, int], int | None]:
    def rule(graph: Graph, a: int) -> int | None:
        if (other := _reversed(graph, op, a)) is not None:
            return other
        minus = _negated(graph, a)
        return None if minus is None else graph.apply(op, minus)

    return rule


def _extreme(graph: Graph, a: int, b: int) -> int | None:
    return a if a == b else None


def _logic(neutral: float) -> Callable[[Graph, int, int], int | None]:
    def rule(graph: Graph, a: int, b: int) -> int | None:
        for this, that in ((a, b), (b, a)):
            literal = graph.literal(this)
            if literal is not None:
                return that if (literal != 0.0) == (neutral != 0.0) else graph.number(1.0 - neutral)
        return a if a == b else None

    return rule


_RULES: dict[str, Callable[..., int | None]] = {
    "add": _add, "sub": _sub, "mul": _mul, "div": _div, "neg": _neg, "pow": _pow,
    "sin": _odd("sin"), "cos": _even("cos"), "abs": _even("abs"),
    "min": _extreme, "max": _extreme, "and": _logic(1.0), "or": _logic(0.0),
}  # fmt: skip
