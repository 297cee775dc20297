"""Constants: the values of the file's and the agents' constants, and expressions without shared definitions.

In: constants in an order in which each comes after those it uses. Out: values of literals.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Sequence
from math import pi

from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.expression import Apply, Choose, Expr, Number
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes.environment import Budget, Environment, Values
from hierc.compiler.shapes.errors import NoFiniteValue
from hierc.compiler.shapes.evaluate import declared_shape, evaluate, expected
from hierc.compiler.shapes.operations import Sharing
from hierc.compiler.shapes.values import Value, number
from hierc.grammar import tree

#: Largest expression, in operations and in depth, where nothing can be shared: constants, arguments, sizes.
MAX_UNSHARED = 2_000
MAX_UNSHARED_DEPTH = 200

ByName = dict[str, Value]


def file_constants(library: Library, order: Sequence[str], budget: Budget, problems: Collector) -> ByName:
    """The constants of the file and the built-in ones."""
    found: dict[str, Value] = {"pi": number(pi)}
    for name in order:
        _evaluate(
            library.consts[name],
            Environment(library, found, Values(found), UNSHARED, budget),
            found,
            problems,
        )
    return found


def agent_constants(
    library: Library,
    agent: Agent,
    order: Sequence[str],
    constants: ByName,
    budget: Budget,
    problems: Collector,
) -> ByName:
    """The constants of an agent alone."""
    found: dict[str, Value] = {}
    scope = Values(ChainMap(found, constants))
    for name in order:
        _evaluate(
            agent.consts[name], Environment(library, constants, scope, UNSHARED, budget), found, problems
        )
    return found


def _evaluate(const: tree.Const, env: Environment, found: dict[str, Value], problems: Collector) -> None:
    name = const.name.text
    try:
        shape = declared_shape(const.type, env)
        value = expected(evaluate(const.value, env), const.type.scalar, shape, f"`{name}`", const.value)
        found[name] = literal(value, f"`{name}`", const.value)
    except Rejected as rejection:
        found.pop(name, None)  # it may hide a built-in constant
        problems.rejected(rejection)


def literal(value: Value, subject: str, node: tree.Node) -> Value:
    """`value`, which must be made of literals only; raises Rejected (E311) when an operation in it has no finite value."""
    if not all(isinstance(e, Number) for e in value.elements):
        raise Rejected(NoFiniteValue(node.span, subject=subject, text=node.span.text))
    return value


def measured(expr: Expr) -> Expr:
    """`expr`, which must not be too large; raises Rejected (E217)."""
    stack = [(expr, 1)]
    count = 0
    while stack:
        here, depth = stack.pop()
        count += 1
        if count > MAX_UNSHARED or depth > MAX_UNSHARED_DEPTH:
            raise Rejected(
                ModelTooLarge(expr.span, what="operations in an argument or constant", limit=MAX_UNSHARED)
            )
        if isinstance(here, Apply):
            stack.extend((arg, depth + 1) for arg in here.args)
        elif isinstance(here, Choose):
            stack.extend((arg, depth + 1) for arg in (here.condition, here.then, here.other))
    return expr


#: Nothing can be named here: expressions are repeated, but they stay small.
UNSHARED = Sharing(lambda name, expr: measured(expr))
