"""Built-in and elementary functions of the dialect to LLVM.

Scalars call the C library's functions, the very ones that CPython's `math` calls, so that both agree bit for bit. Lanes use `vectormath.py` for
sin, cos and exp (within 2 ulp) and the C library lane by lane for the rest.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from llvmlite import ir

from hierc.runtime.machine import dialect, vectormath
from hierc.runtime.machine.types import (
    DOUBLE,
    I64,
    Bool,
    Float,
    Int,
    Operand,
    Pointer,
    UnsupportedCode,
    Value,
    llvm_type,
)

if TYPE_CHECKING:
    from hierc.runtime.machine.lower import Lowering

#: math.* functions that LLVM has as exact intrinsics.
_EXACT = {"sqrt": "sqrt", "fabs": "fabs", "floor": "floor", "ceil": "ceil", "copysign": "copysign"}
#: math.* functions of the C library, with their number of arguments.
_LIBM = {
    "exp": 1, "log": 1, "log10": 1, "sin": 1, "cos": 1, "tan": 1, "asin": 1, "acos": 1, "atan": 1, "atan2": 2,
    "sinh": 1, "cosh": 1, "tanh": 1, "pow": 2, "fmod": 2,
}  # fmt: skip
_OVER_LANES = {"sin": vectormath.sin, "cos": vectormath.cos, "exp": vectormath.exp}

#: Python's own functions that the dialect keeps.
PYTHON = frozenset({"float", "int", "abs", "max", "min"})


def is_builtin(known: Any) -> bool:
    """Whether a name stands for a function of `dialect.py`."""
    return getattr(known, "__module__", None) == dialect.__name__


def arity(name: str) -> int | None:
    """How many arguments `math.name` takes; None if the dialect has no such function."""
    return 2 if name == "copysign" else 1 if name in _EXACT else _LIBM.get(name)


def elementary(low: Lowering, name: str, args: Sequence[Operand], node: ast.AST) -> Value:
    """`math.name(args)`."""
    count = arity(name)
    if count is None or count != len(args):
        raise UnsupportedCode(f"line {getattr(node, 'lineno', '?')}: math.{name} with {len(args)} arguments")
    values = [low.math.convert(a, Float()) if not isinstance(a, Value) else a for a in args]
    lanes = max(v.type.lanes if isinstance(v.type, Float) else 1 for v in values)
    values = [low.math.convert(v, Float(lanes)) for v in values]
    if name in _EXACT:
        exact = _intrinsic(low, _EXACT[name], values)
        # CPython's floor and ceil are integers, which have no negative zero; adding 0.0 takes its sign away.
        return low.math.binary("Add", exact, 0.0) if name in ("floor", "ceil") else exact
    if lanes > 1 and name in _OVER_LANES:
        result = low.call_function(_OVER_LANES[name], values, apart=low.apart)
        assert result is not None
        return result
    function = _libm(low, name, count)
    if lanes == 1:
        return Value(low.builder.call(function, [v.ir for v in values]), Float())
    each = [
        Value(low.builder.call(function, [low.math.extract(v, k).ir for v in values]), Float())
        for k in range(lanes)
    ]
    return low.math.gather_lanes(each)


def _intrinsic(low: Lowering, name: str, values: list[Value]) -> Value:
    kind = values[0].type
    assert isinstance(kind, Float)
    full = f"llvm.{name}.v{kind.lanes}f64" if kind.lanes > 1 else f"llvm.{name}.f64"
    function = low.function.module.globals.get(full)
    if function is None:
        signature = ir.FunctionType(llvm_type(kind), [llvm_type(kind)] * len(values))
        function = ir.Function(low.function.module, signature, full)
    return Value(low.builder.call(function, [v.ir for v in values]), kind)


def _libm(low: Lowering, name: str, arity: int) -> ir.Function:
    known = low.function.module.globals.get(name)
    if isinstance(known, ir.Function):
        return known
    function = ir.Function(low.function.module, ir.FunctionType(DOUBLE, [DOUBLE] * arity), name)
    attributes = ["nounwind", "willreturn", "memory(none)"]
    if name == "pow":
        attributes.append(
            "nobuiltin"
        )  # LLVM would make pow(x, 0.5) a root, pow(2, x) an exp2: not the same bits
    for attribute in attributes:
        add_attribute(function, attribute)
    return function


def add_attribute(function: ir.Function, attribute: str) -> None:
    """Add a function attribute by name."""
    # llvmlite's list of known attributes predates memory(none).
    function.attributes._known = function.attributes._known | frozenset([attribute])
    function.attributes.add(attribute)


def call(low: Lowering, name: str, args: list[Operand], node: ast.AST) -> Operand | None:
    """A function of `dialect.py`, or one of Python's own that the dialect keeps."""
    math, builder = low.math, low.builder
    match name, args:
        case "float", [a]:
            return (
                math.convert(a, Float()) if not isinstance(a, Value) or isinstance(a.type, Int | Bool) else a
            )
        case "int", [Value(type=Float(1)) as a]:
            return Value(builder.fptosi(a.ir, I64), Int())
        case "int", [Value(type=Int()) as a]:
            return a
        case "abs", [int() | float() as a]:
            return abs(a)
        case "abs", [Value(type=Float()) as a]:
            return _intrinsic(low, "fabs", [a])
        case (("max" | "min"), [a, b]):
            # As Python has it: the second only if it compares greater (smaller).
            return math.select(math.compare(">" if name == "max" else "<", b, a), b, a)
        case _:
            return _of_dialect(low, name, args, node)


def _of_dialect(low: Lowering, name: str, args: list[Operand], node: ast.AST) -> Operand | None:
    """A function of `dialect.py`."""
    math, builder = low.math, low.builder
    match name, args:
        case "lane", [Value() as a, int(k)]:
            return math.extract(a, k)
        case "splat", [a]:
            return math.convert(a, Float(low.lanes))
        case "swap_halves", [Value(type=Float(n)) as a]:
            return math.shuffle(a, [*range(n // 2, n), *range(n // 2)])
        case "lower_twice", [Value(type=Float(n)) as a]:
            return math.shuffle(a, [*range(n // 2)] * 2)
        case "upper_twice", [Value(type=Float(n)) as a]:
            return math.shuffle(a, [*range(n // 2, n)] * 2)
        case "total", [Value(type=Float(n)) as a]:
            while n > 2:
                n //= 2
                lower, upper = math.shuffle(a, list(range(n))), math.shuffle(a, list(range(n, 2 * n)))
                a = math.binary("Add", lower, upper)
            return math.binary("Add", math.extract(a, 0), math.extract(a, 1)) if n == 2 else a
        case "largest", [Value(type=Float(n)) as a]:
            lanes = [math.extract(a, k) for k in range(n)]
            while len(lanes) > 1:
                lanes = [
                    # x where it is not below y: so a NaN on either side stays
                    math.select(math.either(math.compare(">", x, y), math.compare("!=", x, x)), x, y)
                    for x, y in zip(lanes[::2], lanes[1::2], strict=True)
                ]
            return lanes[0]
        case "select", [Value() as mask, a, b]:
            return math.select(mask, a, b)
        case "any_lane", [Value(type=Bool(n)) as mask]:
            whole = builder.bitcast(mask.ir, ir.IntType(n))
            return Value(builder.icmp_unsigned("!=", whole, ir.Constant(ir.IntType(n), 0)), Bool())
        case "at", [Value(type=Pointer()) as array, offset]:
            return Value(low.item(array, offset), array.type)
        case "put", [Value(type=Pointer(Float(1))) as array, Value(type=Float()) as a]:
            builder.store(a.ir, array.ir, align=8)
            return None
        case "bits", [Value(type=Float(1)) as a]:
            return Value(builder.bitcast(a.ir, I64), Int())
        case "bit", [Value(type=Float(n)) as a, int(k)]:
            whole = ir.VectorType(I64, n) if n > 1 else I64
            one, none = (ir.Constant(whole, [m] * n if n > 1 else m) for m in (1 << k, 0))
            found = builder.and_(builder.bitcast(a.ir, whole), one)
            return Value(builder.icmp_unsigned("!=", found, none), Bool(n))
        case "from_bits", [Value(type=Int()) as a]:
            return Value(builder.bitcast(a.ir, DOUBLE), Float())
        case (("release" | "acquire"), []):
            builder.fence(name)
            return None
        case "fma", [a, b, c]:
            return _fma(low, a, b, c)
        case "is_finite", [Value(type=Float(1)) as a]:
            magnitude = _intrinsic(low, "fabs", [a])
            return math.compare("<", magnitude, float("inf"))
        case "power_of_two", [Value(type=Float(n)) as a]:
            whole = ir.VectorType(I64, n) if n > 1 else I64
            bias, places = (ir.Constant(whole, [k] * n if n > 1 else k) for k in (1023, 52))
            biased = builder.add(builder.fptosi(a.ir, whole), bias)
            return Value(builder.bitcast(builder.shl(biased, places), llvm_type(a.type)), a.type)
        case "invoke", [Value(type=Int()) as address, *rest]:
            values = [math.value(a) for a in rest]
            signature = ir.FunctionType(DOUBLE, [llvm_type(v.type) for v in values])
            target = builder.inttoptr(address.ir, signature.as_pointer())
            return Value(builder.call(target, [v.ir for v in values]), Float())
        case _:
            raise UnsupportedCode(
                f"line {getattr(node, 'lineno', '?')}: {ast.unparse(node)[:80]}: no such function of the dialect"
            )


def _fma(low: Lowering, a: Operand, b: Operand, c: Operand) -> Value:
    kind = low.math.common(
        low.math.common(low.math.value(a).type, low.math.value(b).type), low.math.value(c).type
    )
    product = low.builder.fmul(
        low.math.convert(a, kind).ir, low.math.convert(b, kind).ir, flags=("contract",)
    )
    return Value(low.builder.fadd(product, low.math.convert(c, kind).ir, flags=("contract",)), kind)
