"""Scalar expressions as formulas for people to read, in the names of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isqrt
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.arrays.columns import Column, Index, Integers, column, expanded, taken
from hierc.compiler.arrays.elements import Elements, ranges, spelled
from hierc.compiler.expression import (
    Apply,
    Choose,
    Expr,
    Gather,
    Input,
    Local,
    Number,
    Operator,
    Parameter,
    Rate,
    State,
    Time,
)
from hierc.compiler.model import Constants, Model, Node, Source
from hierc.compiler.model import Parameter as ModelParameter
from hierc.compiler.shapes.values import element_names

_INFIX: Mapping[Operator, tuple[str, int]] = {
    "or": (" or ", 1), "and": (" and ", 2), "lt": (" < ", 3), "le": (" <= ", 3), "gt": (" > ", 3), "ge": (" >= ", 3),
    "eq": (" == ", 3), "ne": (" != ", 3), "add": (" + ", 4), "sub": (" - ", 4), "mul": ("*", 5), "div": ("/", 5), "pow": ("^", 7),
}  # fmt: skip
_SIGN = 6


class Formulas:
    """Writes the expressions of one node, or those of parameters' values, which have none."""

    def __init__(self, names: Names, node: Node | None = None) -> None:
        self._names = names
        self._node = node
        self._inputs = tuple(names.source(source, node.count) for source in node.inputs) if node else ()

    def _owner(self) -> Node:
        if self._node is None:
            raise ValueError("a parameter's value refers to a variable")
        return self._node

    def text(self, expr: Expr, least: int = 0) -> str:
        """The formula, in parentheses if it binds less than `least`."""
        match expr:
            case Number(value=value):
                text = number_text(value)
                return f"({text})" if value < 0 and least > 4 else text
            case Time():
                return "time"
            case State(index=index):
                return self._owner().states[index].name
            case Rate(index=index):
                return self._owner().states[index].name + "'"
            case Input(index=index):
                return self._inputs[index]
            case Parameter(index=index):
                return self._names.entry(self._node.parameters[index] if self._node else index)
            case Local(index=index):
                return self._owner().definitions[index].name
            case Choose(condition=condition, then=then, other=other):
                text = f"if {self.text(condition)} then {self.text(then)} else {self.text(other)}"
                return f"({text})" if least > 0 else text
            case Apply():
                return self._apply(expr, least)
            case Gather(kind="parameter", at=index):
                return self._names.entry(index)
            case Gather():
                raise ValueError("what elements gather is no part of a node")
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
        if expr.op == "solve":
            return self._unknown(expr)
        name = expr.callee.name if expr.callee else "div" if expr.op == "quotient" else expr.op
        return f"{name}({', '.join(self.text(arg) for arg in expr.args)})"

    def _unknown(self, expr: Apply) -> str:
        """One unknown of a system: `solve([[a, b], [c, d]], [e, f])[1]`."""
        number, *system = expr.args
        n = isqrt(len(system))  # n*n + n is less than (n + 1)^2
        rows = [", ".join(self.text(e) for e in system[k * n : (k + 1) * n]) for k in range(n + 1)]
        matrix = ", ".join(f"[{row}]" for row in rows[:n])
        place = int(number.value) + 1 if isinstance(number, Number) else 0
        return f"solve([{matrix}], [{rows[n]}])[{place}]"


def number_text(value: float) -> str:
    """A literal without a needless `.0`."""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


class Names:
    """Names of scalars: of other nodes, and of the parameter vector. Those of several elements are named together."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._elements = Elements(node.first for node in model.nodes)
        vector: tuple[ModelParameter | Constants, ...] = (*model.parameters, *model.constants)
        self._vector = sorted(vector, key=lambda p: p.first)
        self._entries = Elements(p.first for p in self._vector)

    def source(self, source: Source, count: int = 1) -> str:
        """The path of a scalar that `count` elements read: `plan.p[1]'`, `car[1..9].x`."""
        numbers, indices = expanded(source.node, count), expanded(source.index, count)
        blocks = self._elements.blocks(numbers)
        found: dict[str, list[list[Integers]]] = {}
        for block, index in self._elements.touched(source, count):
            node, at = self._model.nodes[block], (blocks == block) & (indices == index)
            name = _scalar(node, source.kind, index)
            path = f"{node.path}.{name}" if node.path else name
            found.setdefault(path, []).append(_indices(node.indices, numbers[at] - node.first))
        return ", ".join(spelled(path, _together(columns)) for path, columns in found.items())

    def entry(self, entry: Index) -> str:
        """What stands in entries of the parameter vector: the name of a parameter, or constants as ranges."""
        numbers = np.unique(expanded(entry, 1))
        owners = self._entries.blocks(numbers)
        found: dict[str, list[list[Integers]]] = {}
        for owner in np.unique(owners).tolist():
            p, places = self._vector[owner], numbers[owners == owner] - self._vector[owner].first
            if isinstance(p, Constants):
                values = np.unique(
                    np.array(p.values.values if isinstance(p.values, Column) else p.values)[places]
                )
                found.setdefault(_numbers(values), []).append([])
                continue
            of_element = element_names(p.path, p.shape)
            for k in np.unique(places % len(of_element)).tolist():
                at = places[places % len(of_element) == k] // len(of_element)
                found.setdefault(of_element[k], []).append(_indices(p.indices, at))
        return ", ".join(spelled(path, _together(columns)) for path, columns in found.items())


def _scalar(node: Node, kind: str, index: int) -> str:
    """The name of a scalar within its node."""
    if kind == "local":
        return node.definitions[index].name
    return node.states[index].name + ("'" if kind == "rate" else "")


def _indices(indices: Sequence[Index], places: Integers) -> list[Integers]:
    """The indices of elements at some places of a block."""
    return [expanded(taken(index, places), len(places)) for index in indices]


def _together(columns: Sequence[Sequence[Integers]]) -> list[Index]:
    """The indices of elements of several blocks."""
    return [column(np.concatenate(some)) for some in zip(*columns, strict=True)]


def _numbers(values: NDArray[np.float64] | Integers) -> str:
    """Constants in ascending order."""
    if len(values) == 1:
        return number_text(float(values[0]))
    if (values == np.floor(values)).all():
        return f"({ranges(values.astype(np.int64))})"
    return f"({number_text(float(values[0]))} ... {number_text(float(values[-1]))})"
