"""Scalar expressions as formulas for people to read, in the names of the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import assert_never

from hierc.compiler.expression import (
    Apply,
    Choose,
    Expr,
    Input,
    Local,
    Number,
    Operator,
    Parameter,
    Rate,
    State,
    Time,
)
from hierc.compiler.model import Model, Node, Source
from hierc.compiler.shapes.values import element_names

_INFIX: Mapping[Operator, tuple[str, int]] = {
    "or": (" or ", 1), "and": (" and ", 2), "lt": (" < ", 3), "le": (" <= ", 3), "gt": (" > ", 3), "ge": (" >= ", 3),
    "eq": (" == ", 3), "ne": (" != ", 3), "add": (" + ", 4), "sub": (" - ", 4), "mul": ("*", 5), "div": ("/", 5), "pow": ("^", 7),
}  # fmt: skip
_SIGN = 6


class Formulas:
    """Writes the expressions of one node. `parameters` are the names of the whole parameter vector."""

    def __init__(self, model: Model, node: Node, parameters: tuple[str, ...]) -> None:
        self._node = node
        self._inputs = tuple(source_name(model, source) for source in node.inputs)
        self._parameters = tuple(parameters[index] for index in node.parameters)

    def text(self, expr: Expr, least: int = 0) -> str:
        """The formula, in parentheses if it binds less than `least`."""
        match expr:
            case Number(value=value):
                text = number_text(value)
                return f"({text})" if value < 0 and least > 4 else text
            case Time():
                return "time"
            case State(index=index):
                return self._node.states[index].name
            case Rate(index=index):
                return self._node.states[index].name + "'"
            case Input(index=index):
                return self._inputs[index]
            case Parameter(index=index):
                return self._parameters[index]
            case Local(index=index):
                return self._node.definitions[index].name
            case Choose(condition=condition, then=then, other=other):
                text = f"if {self.text(condition)} then {self.text(then)} else {self.text(other)}"
                return f"({text})" if least > 0 else text
            case Apply():
                return self._apply(expr, least)
            case _ as never:
                assert_never(never)

    def _apply(self, expr: Apply, least: int) -> str:
        if expr.op in _INFIX:
            sign, strength = _INFIX[expr.op]
            left, right = expr.args
            tight_left = strength + (expr.op == "pow") + (strength == 3)
            text = f"{self.text(left, tight_left)}{sign}{self.text(right, strength + (expr.op not in ('add', 'mul')))}"
            return f"({text})" if strength < least else text
        if expr.op in ("neg", "not"):
            text = ("-" if expr.op == "neg" else "not ") + self.text(expr.args[0], _SIGN)
            return f"({text})" if least > (4 if expr.op == "neg" else 0) else text
        name = expr.callee.name if expr.callee else "div" if expr.op == "quotient" else expr.op
        return f"{name}({', '.join(self.text(arg) for arg in expr.args)})"


def number_text(value: float) -> str:
    """A literal without a needless `.0`."""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def source_name(model: Model, source: Source) -> str:
    """The path of a scalar of some node: `plan.p[1]'`."""
    node = model.nodes[source.node]
    if source.kind == "local":
        name = node.definitions[source.index].name
    else:
        name = node.states[source.index].name + ("'" if source.kind == "rate" else "")
    return f"{node.path}.{name}" if node.path else name


def parameter_names(model: Model) -> tuple[str, ...]:
    """The names of the scalars of the parameter vector."""
    return tuple(name for p in model.parameters for name in element_names(p.path, p.shape))
