"""Types of the dialect and typed values, on the machine's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin

from llvmlite import ir

from hierc.runtime.machine.dialect import Array, Lanes, Record

DOUBLE = ir.DoubleType()
I64 = ir.IntType(64)
I1 = ir.IntType(1)
POINTER = ir.PointerType()


class UnsupportedCode(Exception):
    """Text outside the dialect: refused, never guessed. The message names the construct and its line."""


@dataclass(frozen=True, slots=True)
class Float:
    """A double, or `lanes` of them."""

    lanes: int = 1


@dataclass(frozen=True, slots=True)
class Int:
    """A 64-bit integer."""


@dataclass(frozen=True, slots=True)
class Bool:
    """A truth value, or one for each lane."""

    lanes: int = 1


@dataclass(frozen=True, slots=True)
class Pointer:
    """The address of consecutive items."""

    item: Type


@dataclass(frozen=True, slots=True)
class RecordRef:
    """A record in memory. It is always handled by its address."""

    record: type[Record]


Type = Float | Int | Bool | Pointer | RecordRef


class Value(NamedTuple):
    """An LLVM value and its type."""

    ir: Any
    type: Type


class Emitted(NamedTuple):
    """A function made by the compiler's own parts that dialect text may call by name."""

    function: ir.Function
    kinds: tuple[Type, ...]
    returns: Type | None


@dataclass(frozen=True, slots=True)
class PerLane:
    """A function of scalars that dialect text may call by name; over lanes it is called for each lane that is live, and for no other."""

    callee: Emitted


@dataclass(frozen=True, slots=True)
class LaneConstant:
    """A constant for each lane, under a name of dialect text."""

    values: tuple[float, ...]

    @property
    def value(self) -> Value:
        kind = Float(len(self.values))
        return Value(ir.Constant(llvm_type(kind), list(self.values)), kind)


@dataclass(frozen=True, slots=True)
class LaneTable:
    """Rows of lane constants; indexed by constants only."""

    rows: tuple[tuple[float, ...], ...]


#: A constant known while lowering, or a value.
Operand = Value | int | float | bool


def llvm_type(kind: Type) -> ir.Type:
    """The LLVM type that holds a value of this type."""
    match kind:
        case Float(1):
            return DOUBLE
        case Float(n):
            return ir.VectorType(DOUBLE, n)
        case Int():
            return I64
        case Bool(1):
            return I1
        case Bool(n):
            return ir.VectorType(I1, n)
        case Pointer() | RecordRef():
            return POINTER


def size_of(kind: Type) -> int:
    """Bytes between items of an array of this type."""
    match kind:
        case Float(n):
            return 8 * n
        case Int() | Pointer():
            return 8
        case RecordRef(record):
            return 8 * len(record.fields())
        case Bool():
            raise UnsupportedCode("truth values are not stored in arrays")


def from_annotation(hint: Any, lanes: int) -> Type:
    """The type that an annotation of the dialect stands for; `lanes` is the width of `Lanes` in this unit."""
    if hint is float:
        return Float()
    if hint is int:
        return Int()
    if hint is bool:
        return Bool()
    if hint == Lanes:
        return Float(lanes)
    if get_origin(hint) is Array:
        return Pointer(from_annotation(get_args(hint)[0], lanes))
    if isinstance(hint, type) and issubclass(hint, Record):
        return RecordRef(hint)
    raise UnsupportedCode(f"no machine type for the annotation {hint!r}")
