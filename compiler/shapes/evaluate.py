"""Evaluating expressions of the syntax tree to shaped values of scalars: shapes are checked and vectors split on the way.

In: an expression and an `Environment` that knows the names of its scope. Out: a `Value`, or `Rejected` with what is wrong. Names are right already
(`names.py`). Conditions made of literals, indices and structural parameters are decided here, and only the chosen branch is evaluated.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn, assert_never

from hierc.compiler.arrays.columns import Index
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Choose, Gather, Time
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.resolve.names import size_names
from hierc.compiler.shapes.environment import REDUCTIONS, Axis, Chosen, Ends, Environment, Values
from hierc.compiler.shapes.errors import (
    IndexOutside,
    NotAKnownInteger,
    RaggedList,
    TypeDiffers,
    WrongArguments,
    WrongIndexCount,
)
from hierc.compiler.shapes.folding import constant
from hierc.compiler.shapes.functions import MAX_ELEMENTS, call_built_in, call_callee
from hierc.compiler.shapes.operations import binary, condition, unary
from hierc.compiler.shapes.picking import picked
from hierc.compiler.shapes.values import (
    Scalar,
    Shape,
    Value,
    fits,
    index_value,
    joined,
    number,
    scalar_of,
    size_of,
    type_text,
)
from hierc.compiler.units.units import literal_in_si
from hierc.grammar import tree

#: Most elements, and longest element, of a list that a message spells out.
SMALL, LONGEST = 4, 12


def evaluate(expr: tree.Expr, env: Environment) -> Value:
    """The value of `expr`."""
    value = _evaluate(expr, env)
    env.budget.spend(1 + len(value.elements), expr)
    return value


def _evaluate(expr: tree.Expr, env: Environment) -> Value:
    match expr:
        case tree.Number():
            return number(
                literal_in_si(expr), "int" if expr.is_int and expr.unit is None else "real", expr.span
            )
        case tree.Bool(value=value):
            return number(value, "bool", expr.span)
        case tree.Time():
            return scalar_of("real", Time(expr.span))
        case tree.Ref():
            return _reference(expr, env)
        case tree.Call():
            return _call(expr, env)
        case tree.Unary(operand=operand):
            return unary(expr, evaluate(operand, env))
        case tree.Binary():
            return _chain(expr, env)
        case tree.Cond():
            return _choice(expr, env)
        case tree.ListExpr(items=items):
            return _list(expr, [evaluate(item, env) for item in items])
        case tree.Comprehension(item=item, over=over):
            steps = [
                evaluate(item, env.bind(over.index.text, scalar_of("int", index_value(i))))
                for i in _indices(over.range, env)
            ]
            return _list(expr, steps) if steps else Value("int", (0,), ())
        case _ as never:
            assert_never(never)


def _chain(expr: tree.Binary, env: Environment) -> Value:
    """A chain `a + b - c`, which leans to the left, without recursion along it."""
    spine = [expr]
    while isinstance(left := spine[-1].left, tree.Binary):
        spine.append(left)
    value = evaluate(spine[-1].left, env)
    for node in reversed(spine):
        value = binary(node, value, evaluate(node.right, env), env.sharing)
        env.budget.spend(len(value.elements), node)
    return value


def _choice(expr: tree.Cond, env: Environment) -> Value:
    test = condition(evaluate(expr.condition, env), expr.condition)
    known = constant(test)
    if known is not None:
        return evaluate(expr.then if known else expr.other, env)
    then, other = evaluate(expr.then, env), evaluate(expr.other, env)
    if then.shape != other.shape or (then.scalar == "bool") != (other.scalar == "bool"):
        raise Rejected(
            TypeDiffers(
                expr.other.span,
                subject="the `then` branch",
                wanted=then.type,
                given=other.type,
                other="the `else` branch",
            )
        )
    if then.shape:
        test = env.sharing.value(scalar_of("bool", test), "condition").single
    scalar = "bool" if then.scalar == "bool" else joined((then.scalar, other.scalar))
    pairs = zip(then.elements, other.elements, strict=True)
    return Value(scalar, then.shape, tuple(Choose(expr.span, test, a, b) for a, b in pairs))


def _list(expr: tree.Expr, items: list[Value]) -> Value:
    first = items[0]
    for item in items:
        if (
            item.shape != first.shape
            or len(item.shape) > 1
            or (item.scalar == "bool") != (first.scalar == "bool")
        ):
            raise Rejected(RaggedList(expr.span, first=first.type, other=item.type))
    scalar = "bool" if first.scalar == "bool" else joined([item.scalar for item in items])
    return Value(scalar, (len(items), *first.shape), tuple(e for item in items for e in item.elements))


# ---- references ---------------------------------------------------------------------------------------------------------------------


def _reference(ref: tree.Ref, env: Environment) -> Value:
    first, last = ref.path.steps[0], ref.path.steps[-1]
    if len(ref.path.steps) == 1 and first.name.text in env.indices:
        value = env.indices[first.name.text]
    else:
        value = env.scope.lookup(ref, _chosen(first, env) if first is not last and first.subs else None)
    if not last.subs:
        return value
    indices = [_indices(sub, env) for sub in last.subs]
    if all(isinstance(index, int) for axis in indices for index in axis):
        shape, places = selected(ref.path.text, value.type, value.shape, last.subs, last, env)
        return Value(value.scalar, shape, tuple(value.elements[p] for p in places))
    return picked(ref, value, indices, env)


def _chosen(step: tree.Step, env: Environment) -> Chosen:
    """The elements that the subscript of an array of agents names."""
    axis = _agents(step, env)
    several = isinstance(axis, Ends)
    return Chosen(tuple(axis.indices()) if isinstance(axis, Ends) else (axis,), several, step)


def _agents(step: tree.Step, env: Environment) -> Axis:
    """What the subscript of an array of agents chooses."""
    if len(step.subs) != 1:
        raise Rejected(
            WrongIndexCount(
                step.span, name=step.name.text, type="array of agents", wanted=1, given=len(step.subs)
            )
        )
    return _axis(step.subs[0], env)


def _axis(sub: tree.Expr | tree.Range, env: Environment) -> Axis:
    """What a subscript chooses."""
    if not isinstance(sub, tree.Range):
        return index_of(sub, env, "index")
    first, last = (index_of(end, env, "end of a range") for end in (sub.first, sub.last))
    if isinstance(first, int) and isinstance(last, int) and last - first >= MAX_ELEMENTS:
        _too_long(sub, last - first + 1)
    return Ends(first, last, sub)


def _indices(sub: tree.Expr | tree.Range, env: Environment) -> list[Index]:
    """The indices that a subscript names: one, or those of a range, which has the same length for all elements."""
    axis = _axis(sub, env)
    return axis.indices() if isinstance(axis, Ends) else [axis]


def index_of(expr: tree.Expr, env: Environment, what: str) -> Index:
    """The value of an expression that must be an integer known when compiling, perhaps another for each element."""
    index = index_in(evaluate(expr, env))
    if index is None:
        raise Rejected(NotAKnownInteger(expr.span, what=what, text=expr.span.text))
    return index


def index_in(value: Value) -> Index | None:
    """An integer that is known when compiling, perhaps another for each element; None for any other value."""
    if value.shape != () or value.scalar != "int":
        return None
    if isinstance(value.single, Gather) and value.single.kind == "index":
        return value.single.at
    known = constant(value.single)
    return None if known is None else int(known)


def selected(
    name: str,
    type_: str,
    shape: Shape,
    subs: tuple[tree.Expr | tree.Range, ...],
    node: tree.Node,
    env: Environment,
) -> tuple[Shape, tuple[int, ...]]:
    """The shape and the places (from 0, row by row) of the elements that subscripts choose from a value of `shape`."""
    if len(subs) != len(shape):
        raise Rejected(WrongIndexCount(node.span, name=name, type=type_, wanted=len(shape), given=len(subs)))
    places = [0]
    chosen_shape: list[int] = []
    for axis, (sub, size) in enumerate(zip(subs, shape, strict=True), start=1):
        if isinstance(sub, tree.Range):
            chosen = list(span_of(sub, env))
            chosen_shape.append(len(chosen))
        else:
            chosen = [known_integer(sub, env, "index")]
        for index in chosen:
            if not 1 <= index <= size:
                raise Rejected(IndexOutside(sub.span, name=name, sizes=shape, index=str(index), axis=axis))
        places = [place * size + index - 1 for place in places for index in chosen]
    return tuple(chosen_shape), tuple(places)


def known_integer(expr: tree.Expr, env: Environment, what: str) -> int:
    """The value of an expression that must be an integer known when compiling."""
    value = evaluate(expr, env)
    known = constant(value.single) if value.shape == () and value.scalar == "int" else None
    if known is None:
        raise Rejected(NotAKnownInteger(expr.span, what=what, text=expr.span.text))
    return int(known)


def span_of(range_: tree.Range, env: Environment) -> range:
    """The integers of `first..last`."""
    first = known_integer(range_.first, env, "end of a range")
    last = known_integer(range_.last, env, "end of a range")
    if last - first >= MAX_ELEMENTS:
        _too_long(range_, last - first + 1)
    return range(first, last + 1)


def _too_long(range_: tree.Range, count: int) -> NoReturn:
    raise Rejected(ModelTooLarge(range_.span, what=f"a range of {count} indices", limit=MAX_ELEMENTS))


def declared_shape(type_: tree.Type, env: Environment) -> Shape:
    """The shape of a declared type; sizes are positive."""
    shape: list[int] = []
    for size in type_.sizes:
        known = known_integer(size, env, "array size")
        if known < 1:
            raise Rejected(NotAKnownInteger(size.span, what="array size", text=size.span.text, positive=True))
        shape.append(known)
    if len(shape) > 2:
        raise Rejected(RaggedList(type_.span, first=type_.span.text, other=type_.span.text))
    if size_of(tuple(shape)) > MAX_ELEMENTS:
        raise Rejected(
            ModelTooLarge(type_.span, what=f"a value of {size_of(tuple(shape))} elements", limit=MAX_ELEMENTS)
        )
    return tuple(shape)


def expected(value: Value, scalar: Scalar, shape: Shape, subject: str, node: tree.Node) -> Value:
    """`value` as the declared type; raises Rejected (E302) when it is of another one."""
    if value.shape != shape or not fits(value.scalar, scalar):
        raise Rejected(
            TypeDiffers(
                node.span,
                subject=subject,
                wanted=type_text(scalar, shape),
                given=value.type,
                instead=_filled(value, shape, node),
            )
        )
    return Value(scalar, shape, value.elements)


def _filled(value: Value, shape: Shape, node: tree.Node) -> tuple[str, ...]:
    """How to write a vector or matrix of which every element is the literal `node`; nothing where that is not short."""
    if not isinstance(node, tree.Number) or not shape:
        return ()
    text = node.span.text
    zeros = (f"zeros({', '.join(map(str, shape))})",) if node.value == 0 else ()
    small = size_of(shape) <= SMALL and len(text) <= LONGEST
    for size in reversed(shape):
        text = f"[{', '.join([text] * size)}]" if small else text
    return (*zeros, text) if small else zeros


# ---- calls --------------------------------------------------------------------------------------------------------------------------


def _call(call: tree.Call, env: Environment) -> Value:
    if (alone := _reduced(call, env)) is not None:
        return alone
    values = tuple(evaluate(arg, env) for arg in call.args)
    name = call.function.text
    if env.library.signature(name) is not None:
        if name not in env.library.callees:
            raise Rejected  # reported where it is declared
        return call_callee(call, env.library.callees[name], values)
    func = env.library.funcs.get(name)
    if func is None:
        return call_built_in(call, values, env.sharing)
    return _inlined(call, func, values, env)


def _reduced(call: tree.Call, env: Environment) -> Value | None:
    """`sum(car.v)` and its like over many agents; None for any other call."""
    if call.function.text not in REDUCTIONS or len(call.args) != 1:
        return None
    match call.args[0]:
        case tree.Ref(path=path) as ref if len(path.steps) == 2:
            agents = _agents(path.steps[0], env) if path.steps[0].subs else None
            return env.scope.reduced(call, ref, agents, [_axis(sub, env) for sub in path.steps[1].subs])
        case tree.Comprehension(over=over) as comprehension:
            return env.scope.reduced_over(call, comprehension, _axis(over.range, env), env)
        case _:
            return None


def _inlined(call: tree.Call, func: tree.Func, values: tuple[Value, ...], env: Environment) -> Value:
    """The body of a function of the user's, with its arguments named once."""
    name = func.name.text
    given = tuple(v.type for v in values)
    wanted = ", ".join(p.type.span.text for p in func.params)
    if len(values) != len(func.params):
        raise Rejected(WrongArguments(call.span, function=name, wanted=wanted, given=given))
    inside = replace(env, scope=Values(env.constants), indices={})
    inside = _bind_sizes(func, values, inside)
    for param, value in zip(func.params, values, strict=True):
        fit = fits(value.scalar, param.type.scalar) and len(param.type.sizes) == len(value.shape)
        fit = fit and declared_shape(param.type, inside) == value.shape
        if not fit:
            raise Rejected(WrongArguments(call.span, function=name, wanted=f"({wanted})", given=given))
    for param, value in zip(func.params, values, strict=True):
        argument = replace(value, scalar=param.type.scalar)
        named = env.sharing.value(argument, f"argument {param.name.text} of {name}")
        inside = inside.bind(param.name.text, named)
    result = evaluate(func.body, inside)
    return expected(
        result, func.type.scalar, declared_shape(func.type, inside), f"the value of `{name}`", func.body
    )


def _bind_sizes(func: tree.Func, values: tuple[Value, ...], env: Environment) -> Environment:
    """Give each size name of the parameters' types the size of the first argument that has it."""
    names = size_names(func, env.library.consts)
    for param, value in zip(func.params, values, strict=True):
        for size, actual in zip(param.type.sizes, value.shape, strict=False):
            if isinstance(size, tree.Ref) and size.path.text in names - env.indices.keys():
                env = env.bind(size.path.text, number(actual, "int"))
    return env
