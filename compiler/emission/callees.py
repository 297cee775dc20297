"""Emission of tables and external functions: the constants of a generated module that its functions call."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from hierc.compiler.callees.callee import Axis, Extern, Table
from hierc.compiler.emission.names import callee_name
from hierc.compiler.emission.target import (
    Assign,
    Blank,
    Call,
    Constant,
    Import,
    Name,
    Statement,
    Target,
    Tuple,
)
from hierc.compiler.symbolic.graph import Called


def imports(called: Sequence[Called]) -> list[Statement]:
    """What the module needs for what it calls."""
    found: list[Statement] = []
    if any(isinstance(c.callee, Extern) for c in called):
        found.append(Import("hierc.runtime.externs", ("Extern",)))
    if any(isinstance(c.callee, Table) for c in called):
        found.append(Import("hierc.runtime.tables", ("Axis", "Table")))
    return found


def definitions(called: Sequence[Called]) -> list[Statement]:
    """An assignment for each table, each derivative of one, and each external function."""
    found: list[Statement] = [Blank()] if called else []
    for index, one in enumerate(called):
        if one.by is not None:
            table = callee_name(called.index(Called(one.callee, None)))
            value = Call(f"{table}.by", (Constant(one.by),))
        else:
            value = _table(one.callee) if isinstance(one.callee, Table) else _extern(one.callee)
        found.append(Assign(Name(callee_name(index)), value))
    return found


def listed(called: Sequence[Called]) -> list[str]:
    """Lines for the module's header."""
    tables = [
        f"Table {c.callee.name}: {c.callee.file}, {c.callee.method}."
        for c in called
        if isinstance(c.callee, Table) and c.by is None
    ]
    externs = [
        f"Extern {c.callee.name}: imported from {c.callee.target}."
        for c in called
        if isinstance(c.callee, Extern)
    ]
    return [*tables, *externs]


def names_of(called: Sequence[Called], kind: type[Table] | type[Extern]) -> Tuple:
    """The module's tables or externs."""
    chosen = (k for k, one in enumerate(called) if isinstance(one.callee, kind) and one.by is None)
    return Tuple(tuple(Name(callee_name(k)) for k in chosen))


def _table(table: Table) -> Call:
    axes = Tuple(tuple(_axis(axis) for axis in table.axes))
    return Call("Table", (Constant(table.name), Constant(table.method), axes, _floats(table.values)))


def _axis(axis: Axis) -> Call:
    rest: list[tuple[str, Target]] = [] if axis.unit is None else [("unit", Constant(axis.unit))]
    rest += [] if axis.scale == 1.0 else [("scale", Constant(axis.scale))]
    return Call("Axis", (Constant(axis.name), _floats(axis.knots)), tuple(rest))


def _extern(extern: Extern) -> Call:
    shapes = Tuple(tuple(Tuple(tuple(Constant(n) for n in shape)) for shape in extern.shapes))
    given = (
        Constant(extern.name),
        Constant(extern.target),
        shapes,
        _floats(extern.scales),
        Constant(extern.scale),
    )
    return Call("Extern", given)


def _floats(numbers: Iterable[float]) -> Tuple:
    return Tuple(tuple(Constant(number) for number in numbers))
