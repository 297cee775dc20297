"""A plain interpreter of structured models in Python floats: the meaning of `Model`, written as directly as possible."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hierc.compiler.expression import Apply, Choose, Expr, Input, Local, Number, Parameter, Rate, State, Time
from hierc.compiler.model import Model, Node, Source

OPERATIONS = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": lambda a, b: a / b,
    "neg": lambda a: -a, "pow": lambda a, b: a**b, "abs": abs, "min": min, "max": max,
    "sign": lambda a: float(a > 0) - float(a < 0), "mod": lambda a, b: a - b * math.floor(a / b),
    "quotient": lambda a, b: math.floor(a / b), "round": lambda a: math.copysign(math.floor(abs(a) + 0.5), a),
    "lt": lambda a, b: a < b, "le": lambda a, b: a <= b, "gt": lambda a, b: a > b, "ge": lambda a, b: a >= b,
    "eq": lambda a, b: a == b, "ne": lambda a, b: a != b,
    "and": lambda a, b: bool(a and b), "or": lambda a, b: bool(a or b), "not": lambda a: not a,
    **{name: getattr(math, name) for name in (
        "sqrt", "exp", "log", "log10", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "floor", "ceil",
    )},
}  # fmt: skip


class Interpreter:
    """Evaluates a model at one time and one set of states, everything on demand."""

    def __init__(self, model: Model, given: Mapping[str, float] | None = None) -> None:
        """`given` replaces scalar parameters by path."""
        self.model = model
        self.parameters: list[float] = []
        self.time = 0.0
        self._known: dict[tuple[int, int], float] = {}
        self.states: dict[tuple[int, int], float] = {}
        for parameter in model.parameters:
            for value in parameter.values:
                chosen = (given or {}).get(parameter.path)
                self.parameters.append(self._parameter(value) if chosen is None else chosen)

    def start(self) -> dict[str, float]:
        """Initial values by path; afterwards they are the states."""
        self.states, self._known = {}, {}
        return {
            self.path(node, state.name): self._initial(node.id, index)
            for node in self.model.nodes
            for index, state in enumerate(node.states)
        }

    def rates(self, time: float, states: Mapping[str, float]) -> dict[str, float]:
        """Derivatives by path."""
        self.set(time, states)
        return {
            self.path(node, state.name): self._value(node, state.rate)
            for node in self.model.nodes
            for state in node.states
        }

    def set(self, time: float, states: Mapping[str, float]) -> None:
        self.time = time
        self._known = {}
        self.states = {
            (node.id, index): states[self.path(node, state.name)]
            for node in self.model.nodes
            for index, state in enumerate(node.states)
        }

    def definitions(self, node: Node) -> list[float]:
        """All definitions of a node, in their order."""
        return [self._value(node, Local(None, index)) for index in range(len(node.definitions))]

    def variable(self, path: str) -> list[float]:
        """The scalars of a variable."""
        (variable,) = (v for v in self.model.variables if v.path == path)
        return [self._source(source) for source in variable.elements]

    @staticmethod
    def path(node: Node, name: str) -> str:
        return f"{node.path}.{name}" if node.path else name

    def _source(self, source: Source) -> float:
        node = self.model.nodes[source.node]
        match source.kind:
            case "state":
                return self._state(node, source.index)
            case "rate":
                return self._value(node, node.states[source.index].rate)
            case "local":
                return self._value(node, node.definitions[source.index].value)

    def _state(self, node: Node, index: int) -> float:
        found = self.states.get((node.id, index))
        return self._initial(node.id, index) if found is None else found

    def _initial(self, node: int, index: int) -> float:
        return self._value(self.model.nodes[node], self.model.nodes[node].states[index].initial)

    def _value(self, node: Node, expr: Expr) -> float:
        match expr:
            case Number(value=value):
                return value
            case Time():
                return self.time
            case State(index=index):
                return self._state(node, index)
            case Rate(index=index):
                return self._value(node, node.states[index].rate)
            case Input(index=index):
                return self._source(node.inputs[index])
            case Parameter(index=index):
                return self.parameters[node.parameters[index]]
            case Local(index=index):
                if (node.id, index) not in self._known:
                    self._known[node.id, index] = self._value(node, node.definitions[index].value)
                return self._known[node.id, index]
            case Apply(op=op, args=args):
                return OPERATIONS[op](*(self._value(node, arg) for arg in args))
            case Choose(condition=condition, then=then, other=other):
                return self._value(node, then if self._value(node, condition) else other)

    def _parameter(self, expr: Expr) -> float:
        """The value of a parameter, over the parameters before it."""
        match expr:
            case Number(value=value):
                return value
            case Parameter(index=index):
                return self.parameters[index]
            case Apply(op=op, args=args):
                return OPERATIONS[op](*(self._parameter(arg) for arg in args))
            case Choose(condition=condition, then=then, other=other):
                return self._parameter(then if self._parameter(condition) else other)
        raise AssertionError(expr)
