"""`linalg.factor`, `linalg.substitute` and `linalg.determinant` of generated modules to LLVM.

Factors are the address of consecutive lanes: a local array, or a slice of the array that keeps them. The work is done by the two loops of `linalg.py`,
lowered once a unit and number of lanes and called with the size of the matrix, so the code of a model does not grow with its matrices.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from llvmlite import ir

from hierc.runtime import linalg
from hierc.runtime.machine.types import (
    POINTER,
    Float,
    Operand,
    Pointer,
    UnsupportedCode,
    Value,
    llvm_type,
)

if TYPE_CHECKING:
    from hierc.runtime.machine.lower import Lowering


def call(low: Lowering, name: str, args: Sequence[Operand], node: ast.AST) -> Value:
    """`linalg.factor(n, …)` or `linalg.determinant(n, factors)`."""
    match name, args:
        case "factor", [int(n), *entries] if len(entries) == n * n:
            return _factor(low, n, entries)
        case "determinant", [int(n), Value(type=Pointer(Float())) as factors]:
            return _wide(low, _load(low, factors, n * (n + 1)))
        case _:
            raise UnsupportedCode(
                f"line {getattr(node, 'lineno', '?')}: linalg.{name} with {len(args)} arguments"
            )


def substitute(low: Lowering, node: ast.expr) -> list[Value]:
    """`linalg.substitute(n, factors, …)`: the unknowns."""
    match node:
        case ast.Call(
            func=ast.Attribute(value=ast.Name(id="linalg"), attr="substitute"), args=args, keywords=[]
        ):
            match [low.expression(a) for a in args]:
                case [int(n), Value(type=Pointer(Float())) as factors, *right] if len(right) == n:
                    return _substitute(low, n, factors, right)
    raise UnsupportedCode(f"line {node.lineno}: {ast.unparse(node)[:80]}: not several values")


def slice_of(low: Lowering, array: Operand, bounds: ast.Slice) -> tuple[Value, int]:
    """`array[first:last]` with constant bounds: the address of its first item, and its length."""
    match array, bounds:
        case Value(type=Pointer(Float())), ast.Slice(
            lower=ast.Constant(value=int(first)), upper=ast.Constant(value=int(last)), step=None
        ):
            return Value(low.item(array, first), array.type), last - first
        case _:
            raise UnsupportedCode(f"line {bounds.lineno}: {ast.unparse(bounds)}: not a slice of an array")


def copy(low: Lowering, source: Value, target: Value, count: int) -> None:
    """Items of one array to another, which may have more lanes."""
    for k in range(count):
        _store(low, target, k, _load(low, source, k))


def _factor(low: Lowering, n: int, entries: Sequence[Operand]) -> Value:
    factors, work = _room(low, linalg.factor_size(n)), _room(low, n + 1)
    for k, entry in enumerate(entries):
        _store(low, factors, k // n * (n + 1) + k % n, entry)
    low.call_function(linalg.factor_rows, [factors, work, low.math.value(n)])
    return factors


def _substitute(low: Lowering, n: int, factors: Value, right: Sequence[Operand]) -> list[Value]:
    b, x = _room(low, n), _room(low, n)
    if factors.type != b.type:  # kept once for all lanes
        spread = _room(low, linalg.factor_size(n))
        copy(low, factors, spread, linalg.factor_size(n))
        factors = spread
    for k, entry in enumerate(right):
        _store(low, b, k, entry)
    low.call_function(linalg.substitute_rows, [factors, b, x, low.math.value(n)])
    return [_load(low, x, k) for k in range(n)]


def _room(low: Lowering, count: int) -> Value:
    """A local array of lanes."""
    kind = Float(low.lanes)
    with low.builder.goto_entry_block():
        room: Any = low.builder.alloca(ir.ArrayType(llvm_type(kind), count), name="room")
    room.type = POINTER  # llvmlite types the result by its item; we give types at each load and store
    return Value(room, Pointer(kind))


def _load(low: Lowering, array: Value, k: int) -> Value:
    assert isinstance(array.type, Pointer)
    loaded = low.builder.load(low.item(array, k), typ=llvm_type(array.type.item), align=8)
    return Value(loaded, array.type.item)


def _store(low: Lowering, array: Value, k: int, value: Operand) -> None:
    assert isinstance(array.type, Pointer)
    low.builder.store(low.math.convert(value, array.type.item).ir, low.item(array, k), align=8)


def _wide(low: Lowering, value: Value) -> Value:
    return low.math.convert(value, Float(low.lanes))
