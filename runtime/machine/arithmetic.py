"""Typed arithmetic on LLVM values: conversions, operators, comparisons, over doubles, lanes and integers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from hierc.runtime.machine.types import (
    DOUBLE,
    I1,
    I64,
    Bool,
    Float,
    Int,
    Operand,
    Pointer,
    Type,
    UnsupportedCode,
    Value,
    llvm_type,
)

_FLOAT_OPS = {"Add": "fadd", "Sub": "fsub", "Mult": "fmul", "Div": "fdiv"}
_INT_OPS = {"Add": "add", "Sub": "sub", "Mult": "mul", "FloorDiv": "sdiv", "Mod": "srem", "BitAnd": "and_"}


class Arithmetic:
    """Emits operations through one builder. `contract` allows a*b + c to be rounded once (never for a model's own text)."""

    def __init__(self, builder: ir.IRBuilder, contract: bool) -> None:
        self.builder = builder
        self.flags = ("contract",) if contract else ()

    def value(self, operand: Operand) -> Value:
        """A constant as a value."""
        match operand:
            case Value():
                return operand
            case bool():
                return Value(ir.Constant(I1, int(operand)), Bool())
            case int():
                return Value(ir.Constant(I64, operand), Int())
            case float():
                return Value(ir.Constant(DOUBLE, operand), Float())

    def splat(self, scalar: Any, kind: ir.Type, lanes: int) -> Any:
        """A scalar in every lane."""
        if isinstance(scalar, ir.Constant):
            return ir.Constant(ir.VectorType(kind, lanes), [scalar] * lanes)
        vector = ir.VectorType(kind, lanes)
        first = self.builder.insert_element(
            ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
        )
        order = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [ir.Constant(ir.IntType(32), 0)] * lanes)
        return self.builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), order)

    def convert(self, operand: Operand, kind: Type) -> Value:
        """The operand as `kind`: integers become floats, scalars are repeated over lanes, nothing else changes."""
        if isinstance(operand, int) and not isinstance(operand, bool) and isinstance(kind, Float):
            operand = float(operand)
        value = self.value(operand)
        if value.type == kind:
            return value
        match value.type, kind:
            case Int(), Float():
                return self.convert(Value(self.builder.sitofp(value.ir, DOUBLE), Float()), kind)
            case Float(1), Float(lanes):
                return Value(self.splat(value.ir, DOUBLE, lanes), kind)
            case Bool(1), Bool(lanes):
                return Value(self.splat(value.ir, I1, lanes), kind)
            case Bool(1), Int():
                return Value(self.builder.zext(value.ir, I64), kind)
            case Bool(1), Float():
                return self.convert(Value(self.builder.uitofp(value.ir, DOUBLE), Float()), kind)
            case Pointer(Float()), Pointer(Float()):
                return Value(value.ir, kind)  # the same memory, as doubles or as lanes
            case _:
                raise UnsupportedCode(f"a value of type {value.type} cannot be used as {kind}")

    def common(self, a: Type, b: Type) -> Type:
        """The type in which a and b meet."""
        match a, b:
            case Int(), Int():
                return a
            case Bool(m), Bool(n):
                return Bool(max(m, n))
            case Float(m), Float(n):
                return Float(max(m, n))
            case (Float(n), Int() | Bool(1)) | (Int() | Bool(1), Float(n)):
                return Float(n)
            case (Int(), Bool(1)) | (Bool(1), Int()):
                return Int()
            case _ if a == b:
                return a
            case _:
                raise UnsupportedCode(f"{a} and {b} cannot be combined")

    def binary(self, op: str, a: Operand, b: Operand) -> Value:
        """a op b; `/` is always of floats."""
        a, b = self.value(a), self.value(b)
        kind = self.common(a.type, b.type)
        if op == "Div" and isinstance(kind, Int):
            kind = Float()
        left, right = self.convert(a, kind).ir, self.convert(b, kind).ir
        if isinstance(kind, Float) and op in _FLOAT_OPS:
            return Value(getattr(self.builder, _FLOAT_OPS[op])(left, right, flags=self.flags), kind)
        if isinstance(kind, Int) and op in _INT_OPS:
            return Value(getattr(self.builder, _INT_OPS[op])(left, right), kind)
        raise UnsupportedCode(f"{op} of {kind}")

    def negate(self, a: Value) -> Value:
        if isinstance(a.type, Float):
            return Value(self.builder.fneg(a.ir), a.type)
        return Value(self.builder.neg(a.ir), a.type)

    def compare(self, predicate: str, a: Operand, b: Operand) -> Value:
        """a predicate b; with NaN every comparison but `!=` is false."""
        a, b = self.value(a), self.value(b)
        kind = self.common(a.type, b.type)
        left, right = self.convert(a, kind).ir, self.convert(b, kind).ir
        if isinstance(kind, Float):
            emit = self.builder.fcmp_unordered if predicate == "!=" else self.builder.fcmp_ordered
            return Value(emit(predicate, left, right), Bool(kind.lanes))
        return Value(self.builder.icmp_signed(predicate, left, right), Bool())

    def truth(self, a: Operand) -> Value:
        """A number as a truth value: whether it is not zero."""
        a = self.value(a)
        return a if isinstance(a.type, Bool) else self.compare("!=", a, 0)

    def invert(self, a: Value) -> Value:
        a = self.truth(a)
        return Value(self.builder.xor(a.ir, self.convert(True, a.type).ir), a.type)

    def both(self, a: Value, b: Value) -> Value:
        a, b = self._masks(a, b)
        return Value(self.builder.and_(a.ir, b.ir), a.type)

    def either(self, a: Value, b: Value) -> Value:
        a, b = self._masks(a, b)
        return Value(self.builder.or_(a.ir, b.ir), a.type)

    def _masks(self, a: Value, b: Value) -> tuple[Value, Value]:
        a, b = self.truth(a), self.truth(b)
        kind = self.common(a.type, b.type)
        return self.convert(a, kind), self.convert(b, kind)

    def select(self, mask: Value, a: Operand, b: Operand) -> Value:
        """a where mask holds, else b."""
        a, b = self.value(a), self.value(b)
        kind = self.common(a.type, b.type)
        if isinstance(mask.type, Bool) and mask.type.lanes > 1 and isinstance(kind, Float | Bool):
            kind = type(kind)(mask.type.lanes)
        return Value(self.builder.select(mask.ir, self.convert(a, kind).ir, self.convert(b, kind).ir), kind)

    def extract(self, a: Value, lane: int) -> Value:
        """One lane as a scalar."""
        if isinstance(a.type, Float | Bool) and a.type.lanes == 1:
            return a
        kind = Bool() if isinstance(a.type, Bool) else Float()
        return Value(self.builder.extract_element(a.ir, ir.Constant(ir.IntType(32), lane)), kind)

    def gather_lanes(self, scalars: list[Value]) -> Value:
        """Scalars as lanes of one vector."""
        kind = Float(len(scalars))
        if len(scalars) == 1:
            return scalars[0]
        out: Any = ir.Constant(llvm_type(kind), ir.Undefined)
        for k, scalar in enumerate(scalars):
            out = self.builder.insert_element(out, scalar.ir, ir.Constant(ir.IntType(32), k))
        return Value(out, kind)

    def shuffle(self, a: Value, order: list[int], b: Value | None = None) -> Value:
        """The lanes of a (then b) in another order."""
        mask = ir.Constant(
            ir.VectorType(ir.IntType(32), len(order)), [ir.Constant(ir.IntType(32), k) for k in order]
        )
        other = b.ir if b is not None else ir.Constant(a.ir.type, ir.Undefined)
        return Value(self.builder.shuffle_vector(a.ir, other, mask), Float(len(order)))
