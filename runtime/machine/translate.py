"""Python functions of users as text of the dialect, where their meaning is the same.

In: a function. Out: its syntax tree, made of floats only, and those of the functions it calls; or `UnsupportedCode` with the line that is outside.
Accepted are plain functions of floats: assignments to local names, `if`, `return`, arithmetic, comparisons, conditional expressions, powers with a
whole number, functions and constants of `math`, `abs`, two-argument `max` and `min`, numbers of the module as they are now, and calls of functions that
are such themselves. What CPython answers with an exception (1/0, the root of -1) is infinite or NaN in machine code, as in a model's equations.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

from hierc.runtime.machine.builtins import arity
from hierc.runtime.machine.types import UnsupportedCode

#: Functions that call functions are followed so deep.
DEEPEST = 8
#: Larger integers are not doubles; larger powers are called.
_EXACT, _LARGEST_POWER = 2**53, 64
_PYTHON = {"abs": 1, "float": 1, "max": 2, "min": 2}
_ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_ORDER = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)


@dataclass(frozen=True, slots=True)
class Translation:
    """A function of floats. `callees` are those it calls, by the name it calls them."""

    definition: ast.FunctionDef
    callees: Mapping[str, Translation]

    @property
    def arguments(self) -> list[str]:
        """Names of the arguments."""
        return [a.arg for a in self.definition.args.args]

    @property
    def text(self) -> str:
        """Everything that decides its code."""
        inner = [f"{name}: {callee.text}" for name, callee in self.callees.items()]
        return "\n".join([ast.unparse(self.definition), *inner])


def translate(function: Callable[..., Any], arguments: int, depth: int = 0) -> Translation:
    """A function of `arguments` floats in the dialect. Raises UnsupportedCode where it is not one."""
    if not isinstance(function, types.FunctionType):
        raise UnsupportedCode(f"{_name(function)} is not written in Python")
    if function.__closure__ or depth > DEEPEST:
        raise UnsupportedCode(f"{function.__name__} is more than a plain function")
    definition, first = _definition(function)
    try:
        return _Translator(function, definition, depth).result(arguments)
    except _Refused as refusal:
        line = first + getattr(refusal.node, "lineno", 1) - 1
        raise UnsupportedCode(f"line {line}: {refusal}") from None


def _name(function: object) -> str:
    return f"`{getattr(function, '__name__', type(function).__name__)}`"


def _definition(function: types.FunctionType) -> tuple[ast.FunctionDef, int]:
    """The syntax tree of a function, and the line it begins at."""
    try:
        lines, first = inspect.getsourcelines(function)
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except (OSError, SyntaxError, TypeError):
        raise UnsupportedCode(f"the text of {function.__name__} is not at hand") from None
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef):
        raise UnsupportedCode(f"line {first}: not a plain function")
    return definition, max(first, 1)


class _Refused(Exception):
    """What cannot be translated, and why."""

    def __init__(self, node: ast.AST, why: str) -> None:
        self.node = node
        super().__init__(f"{ast.unparse(node).splitlines()[0][:60]}: {why}")


def _refuse(node: ast.AST, why: str = "not compiled") -> NoReturn:
    raise _Refused(node, why)


class _Translator:
    """Translates one function. `known` are the locals that are set."""

    def __init__(self, function: types.FunctionType, definition: ast.FunctionDef, depth: int) -> None:
        self.function, self.definition, self.depth = function, definition, depth
        self.locals = {n.id for n in _names_set(definition)} | {a.arg for a in definition.args.args}
        self.callees: dict[str, Translation] = {}

    def result(self, arguments: int) -> Translation:
        given = self.definition.args
        plain = not (given.vararg or given.kwarg or given.kwonlyargs or given.posonlyargs or given.defaults)
        if self.definition.decorator_list:
            _refuse(self.definition.decorator_list[0], "decorators are not compiled")
        if not plain or len(given.args) != arguments:
            _refuse(given, f"only functions of just {arguments} plain arguments are compiled")
        names = [ast.arg(a.arg) for a in given.args]
        body, known = self.block(self.definition.body, frozenset(a.arg for a in given.args))
        if known is not None:
            _refuse(self.definition, "it can end without a `return`")
        signature = ast.arguments([], names, None, [], [], None, [])
        made = ast.FunctionDef(self.definition.name, signature, body, [])
        return Translation(ast.fix_missing_locations(made), self.callees)

    # ---- statements -------------------------------------------------------------------------------

    def block(
        self, body: list[ast.stmt], known: frozenset[str]
    ) -> tuple[list[ast.stmt], frozenset[str] | None]:
        """Statements, and what is set after them; None if they always return."""
        made: list[ast.stmt] = []
        after: frozenset[str] | None = known
        for node in body:
            if after is None:
                _refuse(node, "never reached")
            statement, after = self.statement(node, after)
            made.append(statement)
        return made, after

    def statement(self, node: ast.stmt, known: frozenset[str]) -> tuple[ast.stmt, frozenset[str] | None]:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                return self.assign(node, name, self.number(value, known)), known | {name}
            case ast.AnnAssign(target=ast.Name(id=name), value=value) if value is not None:
                return self.assign(node, name, self.number(value, known)), known | {name}
            case ast.AugAssign(target=ast.Name(id=name), op=op, value=value):
                whole = ast.copy_location(
                    ast.BinOp(ast.copy_location(ast.Name(name, ast.Load()), node), op, value), node
                )
                return self.assign(node, name, self.number(whole, known)), known
            case ast.If(test=test, body=then, orelse=orelse):
                condition = self.condition(test, known)
                yes, after_yes = self.block(then, known)
                no, after_no = self.block(orelse, known)
                ends = [after for after in (after_yes, after_no) if after is not None]
                after = frozenset.intersection(*ends) if ends else None
                return ast.copy_location(ast.If(condition, yes, no), node), after
            case ast.Return(value=value) if value is not None:
                return ast.copy_location(ast.Return(self.number(value, known)), node), None
            case ast.Pass() | ast.Expr(value=ast.Constant(value=str())):
                return ast.copy_location(ast.Pass(), node), known
            case _:
                _refuse(node)

    def assign(self, node: ast.stmt, name: str, value: ast.expr) -> ast.stmt:
        return ast.copy_location(ast.Assign([ast.Name(name, ast.Store())], value), node)

    # ---- expressions ------------------------------------------------------------------------------

    def number(self, node: ast.expr, known: frozenset[str]) -> ast.expr:
        """An expression that is a number."""
        return ast.copy_location(self._number(node, known), node)

    def _number(self, node: ast.expr, known: frozenset[str]) -> ast.expr:
        match node:
            case ast.Constant(value=value):
                return self.constant(node, value)
            case ast.Name(id=name) if name in self.locals:
                if name not in known:
                    _refuse(node, "may not be set here")
                return ast.Name(name, ast.Load())
            case ast.Name() | ast.Attribute():
                return self.constant(node, self.outer(node))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return self.power(node, self.number(left, known), self.number(right, known))
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, _ARITHMETIC):
                return ast.BinOp(self.number(left, known), op, self.number(right, known))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return ast.UnaryOp(ast.USub(), self.number(operand, known))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.number(operand, known)
            case ast.IfExp(test=test, body=then, orelse=other):
                return ast.IfExp(
                    self.condition(test, known), self.number(then, known), self.number(other, known)
                )
            case ast.Call(func=function, args=args, keywords=[]):
                return self.call(node, function, [self.number(a, known) for a in args])
            case _:
                _refuse(node)

    def condition(self, node: ast.expr, known: frozenset[str]) -> ast.expr:
        """An expression that is true or false."""
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if isinstance(op, _ORDER):
                made: ast.expr = ast.Compare(self.number(left, known), [op], [self.number(right, known)])
            case ast.Compare(left=left, ops=ops, comparators=rights) if all(
                isinstance(o, _ORDER) for o in ops
            ):
                sides = [left, *rights]
                pairs = zip(sides, ops, rights, strict=False)
                parts: list[ast.expr] = [
                    ast.copy_location(ast.Compare(a, [o], [b]), node) for a, o, b in pairs
                ]
                made = ast.BoolOp(ast.And(), [self.condition(part, known) for part in parts])
            case ast.BoolOp(op=op, values=values):
                made = ast.BoolOp(op, [self.condition(value, known) for value in values])
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                made = ast.UnaryOp(ast.Not(), self.condition(operand, known))
            case _:  # any number but zero is true
                zero = ast.copy_location(ast.Constant(0.0), node)
                made = ast.Compare(self.number(node, known), [ast.NotEq()], [zero])
        return ast.copy_location(made, node)

    def constant(self, node: ast.expr, value: object) -> ast.expr:
        """A number that is known now, as a float."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            _refuse(node, "not a number")
        if isinstance(value, int) and abs(value) > _EXACT:
            _refuse(node, "too large for a float")
        if isinstance(value, float) and not math.isfinite(value):
            _refuse(node, "not a finite number")
        number = float(value)
        return ast.UnaryOp(ast.USub(), ast.Constant(-number)) if number < 0.0 else ast.Constant(number)

    def power(self, node: ast.expr, base: ast.expr, exponent: ast.expr) -> ast.expr:
        """A power with a whole number: others may be complex, which is no float."""
        size = exponent.operand if isinstance(exponent, ast.UnaryOp) else exponent
        value = size.value if isinstance(size, ast.Constant) else None
        if isinstance(value, float) and value.is_integer() and value <= _LARGEST_POWER:
            return _math("pow", [base, exponent], node)
        _refuse(node, "only powers with a whole number are compiled; `math.pow` takes any")

    def outer(self, node: ast.expr) -> object:
        """What a name of the module stands for now; None for what is not simply a name."""
        match node:
            case ast.Name(id=name):
                missing = getattr(builtins, name, None)
                return self.function.__globals__.get(name, missing)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if name not in self.locals:
                module = self.function.__globals__.get(name)
                if isinstance(module, types.ModuleType):
                    return getattr(module, attribute, None)
        return None

    def call(self, node: ast.Call, function: ast.expr, args: list[ast.expr]) -> ast.expr:
        if isinstance(function, ast.Name) and function.id in self.locals:
            _refuse(node, "only functions of the module are called")
        known = self.outer(function)
        name = getattr(known, "__name__", "")
        if known is not None and known is getattr(math, name, None):
            if arity(name) != len(args):
                _refuse(node, f"math.{name} is not compiled with {len(args)} arguments")
            return _math(name, args, node)
        if known is not None and known is getattr(builtins, name, None) and _PYTHON.get(name) == len(args):
            return ast.Call(ast.Name(name, ast.Load()), args, [])
        if isinstance(known, types.FunctionType) and known.__module__ == self.function.__module__:
            self.callees[f"{name}_"] = translate(known, len(args), self.depth + 1)
            return ast.Call(ast.Name(f"{name}_", ast.Load()), args, [])
        _refuse(node, "functions of `math` and plain functions of the same module are compiled")


def _math(name: str, args: list[ast.expr], node: ast.expr) -> ast.expr:
    function = ast.copy_location(ast.Attribute(ast.Name("math", ast.Load()), name, ast.Load()), node)
    return ast.copy_location(ast.Call(function, args, []), node)


def _names_set(definition: ast.FunctionDef) -> Iterator[ast.Name]:
    """Every name that is set anywhere in a function."""
    for node in ast.walk(definition):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node
