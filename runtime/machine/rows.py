"""Loops of emitted code over the rows of a table of integers.

Columns that are the same in all rows are constants of the code, evenly spaced ones are computed from the row's number; only what is left is read from
memory. So an array of equal agents that read their neighbours mostly needs no table at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from llvmlite import ir

from hierc.runtime.machine.types import DOUBLE, I64, Float, Value, llvm_type

if TYPE_CHECKING:
    from hierc.runtime.machine.unit import Unit

#: Rows from which on a loop is worth its while; fewer are written out.
MANY = 4
#: An integer that is known, or an LLVM value.
Number = Any


@contextmanager
def each_row(
    unit: Unit, builder: ir.IRBuilder, table: Sequence[Sequence[int]], *, backwards: bool = False
) -> Iterator[list[Number]]:
    """A loop over the rows of a table, at least one and all equally long: what is emitted within is done for each. Gives the row's numbers."""
    with counted(builder, len(table)) as count:
        row = builder.sub(ir.Constant(I64, len(table) - 1), count) if backwards else count
        yield _numbers(unit, builder, table, row)


@contextmanager
def counted(builder: ir.IRBuilder, count: int) -> Iterator[Any]:
    """A loop of a known number of rounds, at least one; gives the round's number, from 0."""
    before = builder.block
    inside, after = (builder.function.append_basic_block(name) for name in ("row", "after"))
    builder.branch(inside)
    builder.position_at_end(inside)
    number = builder.phi(I64)
    number.add_incoming(ir.Constant(I64, 0), before)
    yield number
    following = builder.add(number, ir.Constant(I64, 1), flags=("nsw", "nuw"))
    number.add_incoming(following, builder.block)
    builder.cbranch(builder.icmp_unsigned("<", following, ir.Constant(I64, count)), inside, after)
    builder.position_at_end(after)


def _numbers(unit: Unit, builder: ir.IRBuilder, table: Sequence[Sequence[int]], row: Any) -> list[Number]:
    """The numbers of one row."""
    columns = list(zip(*table, strict=True))
    spacings = [_spacing(column) for column in columns]
    uneven = [column for column, spacing in zip(columns, spacings, strict=True) if spacing is None]
    read = iter(_read(unit, builder, uneven, row) if uneven else [])
    numbers: list[Number] = []
    for column, spacing in zip(columns, spacings, strict=True):
        match spacing:
            case None:
                numbers.append(next(read))
            case 0:
                numbers.append(column[0])
            case _:
                step = builder.mul(row, ir.Constant(I64, spacing))
                numbers.append(builder.add(step, ir.Constant(I64, column[0])))
    return numbers


def _read(unit: Unit, builder: ir.IRBuilder, columns: Sequence[Sequence[int]], row: Any) -> Iterator[Any]:
    """The row's numbers in columns that are stored, side by side."""
    stored = unit.table("rows", [number for line in zip(*columns, strict=True) for number in line])
    place = builder.mul(row, ir.Constant(I64, len(columns)))
    for k in range(len(columns)):
        item = builder.add(place, ir.Constant(I64, k))
        yield builder.load(builder.gep(stored.ir, [item], inbounds=True, source_etype=I64), typ=I64)


def _spacing(column: Sequence[int]) -> int | None:
    """By how much a column's numbers differ from one row to the next, if always by the same."""
    spacing = column[1] - column[0] if len(column) > 1 else 0
    even = all(b - a == spacing for a, b in pairwise(column))
    return spacing if even else None


def load(builder: ir.IRBuilder, memory: Any, place: Number, lanes: int) -> Value:
    """The value of some lanes at a place, in doubles, of memory."""
    kind = Float(lanes)
    return Value(builder.load(address(builder, memory, place), typ=llvm_type(kind), align=8), kind)


def store(builder: ir.IRBuilder, memory: Any, place: Number, value: Value) -> None:
    """Set it."""
    builder.store(value.ir, address(builder, memory, place), align=8)


def address(builder: ir.IRBuilder, memory: Any, place: Number) -> Any:
    """The address of a place."""
    number = ir.Constant(I64, place) if isinstance(place, int) else place
    return builder.gep(memory, [number], inbounds=True, source_etype=DOUBLE)


def scaled(builder: ir.IRBuilder, number: Number, by: int) -> Number:
    """A number times a constant."""
    return number * by if isinstance(number, int) else builder.mul(number, ir.Constant(I64, by))
