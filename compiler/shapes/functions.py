"""Built-in functions on shaped values: the argument rule and the scalars of each function stand together.

In: shaped arguments. Out: a shaped value, or `Rejected` with E306 (wrong arguments) or E312 (too large a matrix).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hierc.compiler.callees.callee import Callee
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Apply, Expr, Number, Operator
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes import matrices
from hierc.compiler.shapes.advice import of_function
from hierc.compiler.shapes.errors import MatrixTooLarge, NotAKnownInteger, WrongArguments
from hierc.compiler.shapes.folding import constant
from hierc.compiler.shapes.operations import Reduction, Sharing, chained, products, reduction
from hierc.compiler.shapes.values import Value, apply, joined, number, scalar_of, type_text
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Functions of the language that belong to sampled and switching behaviour.
LATER_FUNCTIONS = frozenset({"pre", "active"})

#: Most elements of `eye`, `zeros` and other values.
MAX_ELEMENTS = 100_000


@dataclass(frozen=True, slots=True)
class Arguments:
    """One call: the values, and what is needed to report and share."""

    call: tree.Call
    values: tuple[Value, ...]
    sharing: Sharing

    @property
    def span(self) -> Span:
        return self.call.span

    def wrong(self, wanted: str, advice: str | None = None) -> Rejected:
        """The problem that the arguments are not what is `wanted`."""
        name, given = self.call.function.text, tuple(v.type for v in self.values)
        return Rejected(WrongArguments(self.span, function=name, wanted=wanted, given=given, advice=advice))

    def numbers(self, count: int) -> tuple[Value, ...]:
        """The arguments, if they are `count` scalar numbers."""
        if len(self.values) != count or any(v.shape != () or v.scalar == "bool" for v in self.values):
            name, fit = self.call.function.text, len(self.values) == count
            advice = of_function(name, list(zip(self.call.args, self.values, strict=True))) if fit else None
            raise self.wrong("1 number" if count == 1 else f"{count} numbers", advice)
        return self.values

    def shared(self) -> tuple[Value, ...]:
        """The arguments with a leaf for each element."""
        name = self.call.function.text
        return tuple(self.sharing.value(v, f"argument of {name}") for v in self.values)


def call_built_in(call: tree.Call, values: tuple[Value, ...], sharing: Sharing) -> Value:
    """The value of a built-in function."""
    return BUILT_IN_FUNCTIONS[call.function.text](Arguments(call, values, sharing))


def call_callee(call: tree.Call, callee: Callee, values: tuple[Value, ...]) -> Value:
    """The value of a table or an external function: one number."""
    if tuple(v.shape for v in values) != callee.shapes or any(v.scalar == "bool" for v in values):
        wanted = f"({', '.join(type_text('real', shape) for shape in callee.shapes)})"
        given = tuple(v.type for v in values)
        raise Rejected(WrongArguments(call.span, function=call.function.text, wanted=wanted, given=given))
    scalars = tuple(e for v in values for e in v.elements)
    return scalar_of("real", Apply(call.span, "call", scalars, callee))


# ---- scalars ------------------------------------------------------------------------------------------------------------------------


def _real(op: Operator) -> Callable[[Arguments], Value]:
    def function(args: Arguments) -> Value:
        (x,) = args.numbers(1)
        return scalar_of("real", apply(op, x.single, span=args.span))

    return function


def _same_type(op: Operator, count: int) -> Callable[[Arguments], Value]:
    def function(args: Arguments) -> Value:
        values = args.numbers(count)
        return scalar_of(
            joined([v.scalar for v in values]), apply(op, *(v.single for v in values), span=args.span)
        )

    return function


def _whole(op: Operator) -> Callable[[Arguments], Value]:
    def function(args: Arguments) -> Value:
        (x,) = args.numbers(1)
        return scalar_of("int", apply(op, x.single, span=args.span))

    return function


def _atan2(args: Arguments) -> Value:
    y, x = args.numbers(2)
    return scalar_of("real", apply("atan2", y.single, x.single, span=args.span))


def _div(args: Arguments) -> Value:
    values = args.numbers(2)
    if any(v.scalar != "int" for v in values):
        raise args.wrong("2 integers")
    return scalar_of("int", apply("quotient", values[0].single, values[1].single, span=args.span))


def _extreme(op: Reduction) -> Callable[[Arguments], Value]:
    """`min` and `max`: of a vector or matrix, or of two numbers or more."""

    def function(args: Arguments) -> Value:
        values = args.values
        if len(values) == 1 and values[0].shape and values[0].elements and values[0].scalar != "bool":
            return scalar_of(values[0].scalar, reduction(op, values[0].elements, args.span, args.sharing))
        if len(values) < 2 or any(v.shape != () or v.scalar == "bool" for v in values):
            raise args.wrong("a vector or matrix, or at least 2 numbers")
        elements = [v.single for v in values]
        return scalar_of(joined([v.scalar for v in values]), chained(op, elements, args.span))

    return function


def _clamp(args: Arguments) -> Value:
    values = args.numbers(3)
    x, low, high = (v.single for v in values)
    scalar = joined([v.scalar for v in values])
    return scalar_of(scalar, apply("min", apply("max", x, low, span=args.span), high, span=args.span))


def _smooth(args: Arguments) -> Value:
    """`smooth(e)` is `e`: it says that no relation in it needs to be located."""
    if len(args.values) != 1:
        raise args.wrong("1 expression")
    return args.values[0]


# ---- vectors and matrices -----------------------------------------------------------------------------------------------------------


def _vectors(args: Arguments, count: int, wanted: str, length: int | None = None) -> tuple[Value, ...]:
    values = args.values
    shapes = {v.shape for v in values}
    fit = len(values) == count and len(shapes) == 1 and all(len(s) == 1 and s[0] > 0 for s in shapes)
    if not fit or any(v.scalar == "bool" for v in values) or (length is not None and shapes != {(length,)}):
        raise args.wrong(wanted)
    return values


def _matrix(args: Arguments, wanted: str = "1 square matrix", *, square: bool = True) -> Value:
    values = args.values
    if len(values) != 1 or len(values[0].shape) != 2 or values[0].scalar == "bool" or not values[0].elements:
        raise args.wrong(wanted)
    if square and values[0].shape[0] != values[0].shape[1]:
        raise args.wrong(wanted)
    return values[0]


def _small(args: Arguments, size: int) -> None:
    if size > matrices.MAX_SIZE:
        name = args.call.function.text
        raise Rejected(MatrixTooLarge(args.span, function=name, size=size, limit=matrices.MAX_SIZE))


def _dot(args: Arguments) -> Value:
    a, b = _vectors(args, 2, "2 vectors of equal length")
    terms = products(a.elements, b.elements, args.span)
    return scalar_of(joined((a.scalar, b.scalar)), reduction("add", terms, args.span, args.sharing))


def _cross(args: Arguments) -> Value:
    _vectors(args, 2, "2 vectors of length 3", 3)
    a, b = (v.elements for v in args.shared())
    span = args.span

    def component(i: int, j: int) -> Expr:
        return apply(
            "sub", apply("mul", a[i], b[j], span=span), apply("mul", a[j], b[i], span=span), span=span
        )

    return Value(
        joined([v.scalar for v in args.values]), (3,), (component(1, 2), component(2, 0), component(0, 1))
    )


def _norm(args: Arguments) -> Value:
    _vectors(args, 1, "1 vector")
    (x,) = args.shared()
    squares = products(x.elements, x.elements, args.span)
    return scalar_of(
        "real", apply("sqrt", reduction("add", squares, args.span, args.sharing), span=args.span)
    )


def _transpose(args: Arguments) -> Value:
    m = _matrix(args, "1 matrix", square=False)
    rows, columns = m.shape
    return Value(m.scalar, (columns, rows), tuple(e for j in range(columns) for e in m.column(j)))


def _trace(args: Arguments) -> Value:
    m = _matrix(args)
    diagonal = [m.row(i)[i] for i in range(m.shape[0])]
    return scalar_of(m.scalar, chained("add", diagonal, args.span))


def _det(args: Arguments) -> Value:
    m = _matrix(args)
    _small(args, m.shape[0])
    return scalar_of("real", matrices.determinant(args.shared()[0], args.span))


def _inverse(args: Arguments) -> Value:
    m = _matrix(args)
    _small(args, m.shape[0])
    return matrices.inverse(args.shared()[0], args.span, args.sharing)


def _solve(args: Arguments) -> Value:
    wanted = "a square matrix and a vector (or matrix) of as many rows"
    if len(args.values) != 2 or any(v.scalar == "bool" for v in args.values):
        raise args.wrong(wanted)
    a, b = args.values
    if (
        len(a.shape) != 2
        or a.shape[0] != a.shape[1]
        or not b.shape
        or b.shape[0] != a.shape[0]
        or not a.elements
    ):
        raise args.wrong(wanted)
    _small(args, a.shape[0])
    shared_a, shared_b = args.shared()
    return matrices.solve(shared_a, shared_b, args.span, args.sharing)


def _sum(args: Arguments) -> Value:
    if len(args.values) != 1 or not args.values[0].shape or args.values[0].scalar == "bool":
        raise args.wrong("1 vector or matrix")
    (x,) = args.values
    return (
        scalar_of(x.scalar, reduction("add", x.elements, args.span, args.sharing))
        if x.elements
        else number(0, x.scalar, args.span)
    )


def _sizes(args: Arguments, counts: tuple[int, ...], wanted: str) -> tuple[int, ...]:
    if len(args.values) not in counts or any(v.shape != () for v in args.values):
        raise args.wrong(wanted)
    sizes: list[int] = []
    for value, expr in zip(args.values, args.call.args, strict=True):
        size = constant(value.single) if value.scalar == "int" else None
        if size is None or size < 0:
            below = size is not None
            raise Rejected(NotAKnownInteger(expr.span, what="size", text=expr.span.text, negative=below))
        sizes.append(int(size))
    return tuple(sizes)


def _limited(args: Arguments, count: int) -> None:
    if count > MAX_ELEMENTS:
        raise Rejected(ModelTooLarge(args.span, what=f"a value of {count} elements", limit=MAX_ELEMENTS))


def _eye(args: Arguments) -> Value:
    (n,) = _sizes(args, (1,), "1 size")
    _limited(args, n * n)
    elements = tuple(Number(args.span, float(i == j)) for i in range(n) for j in range(n))
    return Value("int", (n, n), elements)


def _zeros(args: Arguments) -> Value:
    shape = _sizes(args, (1, 2), "1 or 2 sizes")
    count = shape[0] * shape[-1] if len(shape) == 2 else shape[0]
    _limited(args, count)
    return Value("int", shape, (Number(args.span, 0.0),) * count)


BUILT_IN_FUNCTIONS: Mapping[str, Callable[[Arguments], Value]] = {
    "sqrt": _real("sqrt"), "exp": _real("exp"), "log": _real("log"), "log10": _real("log10"),
    "sin": _real("sin"), "cos": _real("cos"), "tan": _real("tan"), "asin": _real("asin"), "acos": _real("acos"),
    "atan": _real("atan"), "sinh": _real("sinh"), "cosh": _real("cosh"), "tanh": _real("tanh"), "atan2": _atan2,
    "abs": _same_type("abs", 1), "sign": _same_type("sign", 1), "mod": _same_type("mod", 2), "div": _div,
    "floor": _whole("floor"), "ceil": _whole("ceil"), "round": _whole("round"),
    "min": _extreme("min"), "max": _extreme("max"), "clamp": _clamp, "smooth": _smooth,
    "dot": _dot, "cross": _cross, "norm": _norm, "transpose": _transpose, "trace": _trace, "sum": _sum,
    "det": _det, "inverse": _inverse, "solve": _solve, "eye": _eye, "zeros": _zeros,
}  # fmt: skip
