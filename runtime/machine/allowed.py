"""What the functions of a generated module may say: checked before any of it is lowered.

In: a class. Guaranteed of one that passes: its functions hold nothing but arithmetic, comparisons, choices, elementary functions of floats, the systems of
equations of `linalg.py`, and calls of the module's tables and externs; every index is a constant within its array; every name is set once on every path and
before it is read; every entry of the output is set. So the machine code made from it touches only the memory it is given, calls only the C library's
mathematics, our own and the user's externs, and ends. Anything else is refused; nothing is executed.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Collection, Mapping
from collections.abc import Set as AbstractSet

from hierc.runtime import linalg
from hierc.runtime.contract import Class
from hierc.runtime.machine.builtins import arity
from hierc.runtime.machine.callees import called, count_of_arguments
from hierc.runtime.machine.types import UnsupportedCode
from hierc.runtime.machine.unit import parse_function

#: Entries that may be read, by array.
Readable = Mapping[str, Collection[int]]
_ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_ORDER = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
#: Python's own functions, with their number of arguments.
_PYTHON = {"float": 1, "abs": 1, "max": 2, "min": 2}
#: Names that no local may take.
_RESERVED = {"t", "math", "linalg", *_PYTHON}
#: Names, and entries of the output as `dx[0]`, that are set.
Known = AbstractSet[str]
NO_CALLEES: Mapping[str, int] = {}


@functools.cache
def check_class(kind: Class) -> None:
    """Raise UnsupportedCode where a function that is lowered, or the tables it belongs to, are not as the contract has them."""
    n, m = len(kind.states), kind.inputs
    arrays: Readable = {"x": range(n), "u": range(m), "d": (), "p": range(kind.values)}
    _check(kind.rhs, arrays, "dx", range(n))
    _check(kind.jac, arrays, "J", range(len(kind.pattern)))
    if kind.observe is not None:
        _check(kind.observe, arrays, "y", range(kind.observed))
    for part in kind.parts:
        if not set(part.inputs) <= set(range(m)) or not set(part.outs) <= set(range(kind.outs)):
            raise UnsupportedCode(f"{kind.name}: a part with inputs {part.inputs} and outs {part.outs}")
        _check(part.function, {**arrays, "u": part.inputs}, "y", part.outs)
    for row, column in kind.pattern:
        if not (0 <= row < n + kind.outs and 0 <= column < n + m):
            raise UnsupportedCode(f"{kind.name}: entry ({row}, {column}) of the Jacobian")


def _check(function: Callable[..., None], arrays: Readable, output: str, entries: Collection[int]) -> None:
    definition = parse_function(function)
    found = called(function)
    counts = {name: count_of_arguments(callee) for name, callee in found.items()}
    check_function(definition, arrays, output, entries, counts)


def check_function(
    definition: ast.FunctionDef,
    arrays: Readable,
    output: str,
    entries: Collection[int],
    callees: Mapping[str, int] = NO_CALLEES,
) -> None:
    """Check one function (t, *arrays, output) that sets just these entries of its output.

    `callees` are the tables and externs that it may call, with their numbers of arguments.
    """
    expected = ["t", *arrays, output]
    signature = definition.args
    given = [a.arg for a in signature.args]
    if given != expected or ast.unparse(signature) != ", ".join(expected) or definition.decorator_list:
        raise UnsupportedCode(
            f"line {definition.lineno}: {definition.name} must take just ({', '.join(expected)})"
        )
    known = _Checker(arrays, output, entries, callees).block(definition.body, set())
    if missing := [k for k in entries if f"{output}[{k}]" not in known]:
        raise UnsupportedCode(
            f"line {definition.lineno}: {definition.name} never sets {output}[{missing[0]}]"
        )


class _Checker:
    """Walks one function. `known` is what is set: names, and entries of the output as `dx[0]`."""

    def __init__(
        self, arrays: Readable, output: str, entries: Collection[int], callees: Mapping[str, int]
    ) -> None:
        self.arrays, self.output, self.entries, self.callees = arrays, output, entries, callees
        self.reserved = {*_RESERVED, *arrays, output, *callees}
        self.factors: dict[str, int] = {}  # names of factors, with the size of their matrix

    def block(self, body: list[ast.stmt], before: Known) -> set[str]:
        """What is set after some statements."""
        known = set(before)
        for statement in body:
            match statement:
                case ast.Assign(targets=[target], value=value):
                    names = self.assignment(target, value, known)
                    if twice := [name for k, name in enumerate(names) if name in known or name in names[:k]]:
                        raise _refused(statement, f"{twice[0]} is set twice")
                    known.update(names)
                case ast.If(test=test, body=then, orelse=orelse):
                    self.condition(test, known)
                    known = self.block(then, known) & self.block(orelse, known)
                case ast.Pass() | ast.Expr(value=ast.Constant(value=str())):
                    pass
                case _:
                    raise _refused(statement)
        return known

    def assignment(self, target: ast.expr, value: ast.expr, known: Known) -> list[str]:
        """Check an assignment; the names that it sets."""
        match target, value:
            case ast.Name(), ast.Call(func=function, args=[size, *entries], keywords=[]) if (
                _linalg(function) == "factor"
            ):
                n = _size(size)
                self.numbers(value, entries, n * n, known)
                name = self.target(target)
                self.factors[name] = n
                return [name]
            case ast.Tuple(elts=several), ast.Call(
                func=function, args=[size, factors, *right], keywords=[]
            ) if _linalg(function) == "substitute":
                n = _size(size)
                self.factors_of(factors, n, known)
                self.numbers(value, right, n, known)
                if len(several) != n:
                    raise _refused(value, f"has {n} values")
                return [self.target(item) for item in several]
            case _:
                self.number(value, known)
                return [self.target(target)]

    def numbers(self, node: ast.expr, given: list[ast.expr], count: int, known: Known) -> None:
        """Check `count` arguments that are numbers."""
        if len(given) != count:
            raise _refused(node, "wrong number of arguments")
        for item in given:
            self.number(item, known)

    def factors_of(self, node: ast.expr, n: int, known: Known) -> None:
        """Check the factors of an n-by-n matrix: a name, or the entries of an array that hold them."""
        match node:
            case ast.Name(id=name) if name in known and self.factors.get(name) == n:
                return
            case ast.Subscript(
                value=ast.Name(id=array),
                slice=ast.Slice(
                    lower=ast.Constant(value=int(a)), upper=ast.Constant(value=int(b)), step=None
                ),
            ) if b - a == linalg.factor_size(n) and all(k in self.arrays.get(array, ()) for k in range(a, b)):
                return
        raise _refused(node, f"not the factors of a matrix of {n} rows")

    def target(self, node: ast.expr) -> str:
        """The name, or entry of the output, that an assignment sets."""
        match node:
            case ast.Name(id=name) if name not in self.reserved:
                if name in self.factors:
                    raise _refused(node, "set twice")
                return name
            case ast.Subscript(value=ast.Name(id=array), slice=ast.Constant(value=int(k))) if (
                array == self.output
            ):
                if k in self.entries and not isinstance(k, bool):
                    return f"{array}[{k}]"
                raise _refused(node, "no such entry")
            case _:
                raise _refused(node, "cannot be set")

    def number(self, node: ast.expr, known: Known) -> None:
        """Check an expression that is a number."""
        match node:
            case ast.Constant(value=bool()):
                raise _refused(node)
            case ast.Constant(value=float() | int()):
                pass
            case ast.Name(id=name):
                if name != "t" and name not in known:
                    raise _refused(node, "read before it is set")
                if name in self.factors:
                    raise _refused(node, "not a number")
            case ast.Subscript(value=ast.Name(id=array), slice=ast.Constant(value=int(k))):
                if k not in self.arrays.get(array, ()) or isinstance(k, bool):
                    raise _refused(node, "no such entry")
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, _ARITHMETIC):
                self.number(left, known)
                self.number(right, known)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                self.number(operand, known)
            case ast.IfExp(test=test, body=then, orelse=orelse):
                self.condition(test, known)
                self.number(then, known)
                self.number(orelse, known)
            case ast.Call(func=function, args=[size, factors], keywords=[]) if (
                _linalg(function) == "determinant"
            ):
                self.factors_of(factors, _size(size), known)
            case ast.Call(func=function, args=args, keywords=[]) if len(args) == self.arguments(function):
                for argument in args:
                    self.number(argument, known)
            case _:
                raise _refused(node)

    def arguments(self, function: ast.expr) -> int | None:
        """How many arguments a function takes that may be called."""
        match function:
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                return arity(name)
            case ast.Name(id=name):
                return self.callees.get(name, _PYTHON.get(name))
        return None

    def condition(self, node: ast.expr, known: Known) -> None:
        """Check an expression that is true or false."""
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if isinstance(op, _ORDER):
                self.number(left, known)
                self.number(right, known)
            case ast.BoolOp(values=values):
                for value in values:
                    self.condition(value, known)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self.condition(operand, known)
            case _:
                raise _refused(node, "not a condition")


def _linalg(function: ast.expr) -> str | None:
    """The name of a function of `linalg`."""
    match function:
        case ast.Attribute(value=ast.Name(id="linalg"), attr=name):
            return name
    return None


def _size(node: ast.expr) -> int:
    """The number of rows of a matrix."""
    match node:
        case ast.Constant(value=int(n)) if 1 <= n <= linalg.LARGEST and not isinstance(n, bool):
            return n
    raise _refused(node, f"not a size from 1 to {linalg.LARGEST}")


def _refused(node: ast.AST, why: str = "not allowed in a model's functions") -> UnsupportedCode:
    text = ast.unparse(node).partition("\n")[0][:80]
    return UnsupportedCode(f"line {getattr(node, 'lineno', '?')}: {text}: {why}")
