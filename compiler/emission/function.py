"""Emission of functions: a `Program` becomes the statements of a Python function.

In: values and a program. Out: target statements. Guaranteed: statements are small (an expression used once stands where it is used, up to
`LARGEST` operations); every value of a choice is set in both branches of its `if`; no user's name becomes code.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from hierc.compiler.emission.names import callee_name
from hierc.compiler.emission.target import (
    Assign,
    Binary,
    Call,
    Conditional,
    Constant,
    If,
    Item,
    Name,
    Operator,
    Slice,
    Statement,
    Target,
    Tuple,
    Unary,
)
from hierc.compiler.symbolic.graph import BOOLEAN, Value
from hierc.compiler.symbolic.schedule import Block, Branch, Compute, Program

#: Operations in one expression.
LARGEST = 6

#: Where leaves are found.
ARRAYS: Mapping[str, str] = {"state": "x", "input": "u", "value": "p", "parameter": "q"}
#: The same in defaults of blocks: an element's own scalars, and what they use besides.
BLOCK_ARRAYS: Mapping[str, str] = {"value": "v", "parameter": "a"}
_OPERATORS: Mapping[str, Operator] = {
    "add": "+", "sub": "-", "mul": "*", "div": "/", "and": "and", "or": "or",
    "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!=",
}  # fmt: skip
_LIBRARY = frozenset(
    {
        "pow",
        "sqrt",
        "exp",
        "log",
        "log10",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
    }
)


class FunctionBody:
    """Writes programs that store into one array. Comments: of values by number, of stores by entry."""

    def __init__(
        self,
        values: Sequence[Value],
        output: str,
        names: Mapping[int, str] | None = None,
        comments: Mapping[int, str] | None = None,
        prefix: str = "a",
        arrays: Mapping[str, str] = ARRAYS,
    ) -> None:
        self._values = values
        self._output = output
        self._names = names or {}
        self._comments = comments or {}
        self._prefix = prefix
        self._arrays = arrays
        self._count_of_names = 0
        self._named: dict[int, str] = {}  # what the scope being written may use
        self._inline: dict[int, tuple[Target, int]] = {}  # expression and its operations
        self._uses: Counter[int] = Counter()
        self._loaded: dict[int, str] = {}
        self._elements: dict[tuple[int, int], int] = {}  # of systems: the value of each unknown that is used
        self._unknowns: dict[int, tuple[Name, ...]] = {}

    def statements(self, program: Program) -> tuple[Statement, ...]:
        """The function's body; empty if it stores nothing."""
        self._count(program.block)
        entries = sorted(
            (self._values[v].op, self._values[v].index, v)
            for v, uses in self._uses.items()
            if uses > 1 and self._is_entry(v)
        )
        loads = [self._load(v) for _, _, v in entries]
        body = self._block(program.block)
        stores = [
            Assign(self._entry(entry, value), self._expression(value), self._comments.get(entry, ""))
            for entry, value in program.stores
        ]
        return (*loads, *body, *stores)

    # ---- what is used how often ---------------------------------------------------

    def _count(self, block: Block) -> None:
        for step in block.steps:
            if isinstance(step, Compute):
                self._uses.update(self._operands(step.value))
                v = self._values[step.value]
                if v.op == "element":
                    self._elements[v.args[0], v.index] = step.value
            else:
                self._uses[step.condition] += 1
                self._count(step.then)
                self._count(step.other)
        self._uses.update(block.results)

    def _operands(self, value: int) -> tuple[int, ...]:
        """Arguments as often as the printed operation names them."""
        v = self._values[value]
        match v.op:
            case "sign":
                return v.args * 3
            case "max" | "min":
                return (v.args[0],) * 3 + (v.args[1],)
            case "mod" | "round":
                return v.args * 2
        return v.args

    def _entry(self, first: int, value: int) -> Item | Slice:
        """Where a value is stored."""
        count = self._values[value].entries
        return Item(self._output, first) if count == 1 else Slice(self._output, first, first + count)

    def _is_entry(self, value: int) -> bool:
        return self._values[value].op in self._arrays

    def _load(self, value: int) -> Assign:
        v = self._values[value]
        array = self._arrays[v.op]
        self._loaded[value] = f"{array}{v.index}"
        return Assign(Name(self._loaded[value]), Item(array, v.index))

    # ---- steps ------------------------------------------------------------------------

    def _block(self, block: Block) -> list[Statement]:
        out: list[Statement] = []
        for step in block.steps:
            if isinstance(step, Branch):
                out.append(self._branch(step))
            else:
                self._compute(step.value, out)
        return out

    def _branch(self, step: Branch) -> If:
        targets = [Name(self._name(v)) for v in step.values]
        test = self._test(step.condition)
        branches = []
        for block in (step.then, step.other):
            outside = len(self._named)
            body = self._block(block)
            body += [
                Assign(target, self._expression(result), self._names.get(value, ""))
                for target, result, value in zip(targets, block.results, step.values, strict=True)
            ]
            branches.append(tuple(body))
            while len(self._named) > outside:  # what a branch names nobody else may use
                self._named.popitem()
        return If(test, branches[0], branches[1])

    def _compute(self, value: int, out: list[Statement]) -> None:
        v = self._values[value]
        match v.op:
            case "factor":
                entries = (Constant(v.size), *map(self._expression, v.args))
                out.append(Assign(Name(self._name(value)), Call("linalg.factor", entries)))
                return
            case "solve":
                self._system(value, out)
                return
            case "call":
                out.append(
                    Assign(Name(self._name(value)), self._operation(value, out), self._names.get(value, ""))
                )
                return
            case "element":
                self._named[value] = self._unknowns[v.args[0]][v.index].id
                return
        size = 1 + sum(self._inline[a][1] for a in v.args if a in self._inline)
        expression = self._operation(value, out)
        if self._uses[value] == 1 and size <= LARGEST and value not in self._names:
            self._inline[value] = expression, size
            return
        if v.op in BOOLEAN:
            expression = Conditional(expression, Constant(1.0), Constant(0.0))
        out.append(Assign(Name(self._name(value)), expression, self._names.get(value, "")))

    def _system(self, value: int, out: list[Statement]) -> None:
        """All unknowns of a system; they get their names here."""
        v = self._values[value]
        names = tuple(Name(self._fresh()) for _ in range(v.size))
        self._unknowns[value] = names
        said = [self._names.get(self._elements.get((value, k), -1), "") for k in range(v.size)]
        given = (Constant(v.size), *map(self._expression, v.args))
        out.append(Assign(Tuple(names), Call("linalg.substitute", given), ", ".join(filter(None, said))))

    def _name(self, value: int) -> str:
        """A name for a value in this scope."""
        self._named[value] = self._fresh()
        self._inline.pop(value, None)
        return self._named[value]

    def _fresh(self) -> str:
        self._count_of_names += 1
        return f"{self._prefix}{self._count_of_names - 1}"

    # ---- expressions ---------------------------------------------------------------------

    def _expression(self, value: int) -> Target:
        """A value as a number."""
        if value in self._named:
            return Name(self._named[value])
        if value in self._inline:
            expression = self._inline[value][0]
            if self._values[value].op in BOOLEAN:
                return Conditional(expression, Constant(1.0), Constant(0.0))
            return expression
        v = self._values[value]
        match v.op:
            case "number":
                return Constant(v.number)
            case "time":
                return Name("t")
            case "factors":
                return Slice("p", v.index, v.index + v.entries)
            case _ if value in self._loaded:
                return Name(self._loaded[value])
            case _:
                return Item(self._arrays[v.op], v.index)

    def _test(self, value: int) -> Target:
        """A value as a condition."""
        if value in self._inline and self._values[value].op in BOOLEAN:
            return self._inline[value][0]
        return Binary("!=", self._expression(value), Constant(0.0))

    def _operation(self, value: int, out: list[Statement]) -> Target:
        """One operation; what needs several statements puts the first of them out."""
        v = self._values[value]
        match v.op:
            case "and" | "or":
                return Binary(v.op, self._test(v.args[0]), self._test(v.args[1]))
            case "not":
                return Unary("not ", self._test(v.args[0]))
            case "mod":
                return self._mod(out, *v.args)
            case "round":
                return self._round(out, *v.args)
        args = [self._expression(a) for a in v.args]
        match v.op:
            case "neg":
                return Unary("-", args[0])
            case "abs":
                return Call("math.fabs", tuple(args))
            case "det":
                return Call("linalg.determinant", (Constant(v.size), *args))
            case "sign":
                return _sign(args[0])
            case "max":
                return _extreme(Binary(">", *args), *args)
            case "min":
                return _extreme(Binary("<", *args), *args)
            case "floor" | "ceil":
                return _whole(v.op, args[0])
            case "quotient":
                return _whole("floor", Binary("/", args[0], args[1]))
            case "call":
                return Call(callee_name(v.index), tuple(args))
            case op if op in _LIBRARY:
                return Call(f"math.{op}", tuple(args))
        return Binary(_OPERATORS[v.op], args[0], args[1])

    def _temporary(self, expression: Target, out: list[Statement]) -> Name:
        """A name for an intermediate result of one operation."""
        name = Name(self._fresh())
        out.append(Assign(name, expression))
        return name

    def _mod(self, out: list[Statement], a: int, b: int) -> Target:
        """The remainder with the sign of the divisor."""
        y = self._expression(b)
        rest = self._temporary(Call("math.fmod", (self._expression(a), y)), out)
        zero = Constant(0.0)
        below = Binary("and", Binary("<", rest, zero), Binary(">", y, zero))
        above = Binary("and", Binary(">", rest, zero), Binary("<", y, zero))
        own = Call("math.copysign", (rest, y))  # a zero takes the sign of the divisor, too
        return Conditional(Binary("or", below, above), Binary("+", rest, y), own)

    def _round(self, out: list[Statement], a: int) -> Target:
        """Half away from zero."""
        x = self._expression(a)
        size = self._temporary(Call("math.fabs", (x,)), out)
        whole = self._temporary(_whole("floor", size), out)
        up = Binary(">=", Binary("-", size, whole), Constant(0.5))
        return Call("math.copysign", (Conditional(up, Binary("+", whole, Constant(1.0)), whole), x))


def _whole(function: str, x: Target) -> Target:
    return Call("float", (Call(f"math.{function}", (x,)),))


def _sign(x: Target) -> Target:
    """A zero or NaN is its own sign."""
    zero = Constant(0.0)
    negative = Conditional(Binary("<", x, zero), Constant(-1.0), x)
    return Conditional(Binary(">", x, zero), Constant(1.0), negative)


def _extreme(better: Target, a: Target, b: Target) -> Target:
    """`a` if it is better, else `b`; NaN if either is NaN, whatever their order."""
    return Conditional(Binary("or", better, Binary("!=", a, a)), a, b)
