"""Tables and external functions as machine code: what generated functions call by name.

In: the functions of a class, whose modules hold `Table`s and `Extern`s. Out: an LLVM function of scalars for each that is called. Over lanes they are
called lane by lane, and within a branch only for the lanes that take it (see `types.PerLane`).

A table's numbers are constants of the object; `NAME_outside` marks where it was used beyond its grid. An extern that cannot be compiled in is called
through the address in `NAME_callback`. Python finds both by name once the object is loaded.
"""

from __future__ import annotations

import ast
import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from llvmlite import ir

from hierc.runtime.externs import Extern
from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.interpolation import interpolate
from hierc.runtime.machine.translate import Translation
from hierc.runtime.machine.types import DOUBLE, I64, POINTER, Emitted, Float, Int, PerLane, Pointer, Value
from hierc.runtime.machine.unit import Loaded, Unit, parse_function
from hierc.runtime.tables import Table

Callee = Table | Extern
NO_NAMES: Mapping[str, Any] = {}


def called(function: Callable[..., Any]) -> dict[str, Callee]:
    """The tables and externs that a function calls, by their names among its module's globals."""
    names = function.__globals__
    if not any(isinstance(names.get(name), Callee) for name in function.__code__.co_names):
        return {}  # told at once: a run whose code is cached needs no syntax trees
    found = (
        n.func.id
        for n in ast.walk(parse_function(function))
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
    )
    return {name: names[name] for name in dict.fromkeys(found) if isinstance(names.get(name), Callee)}


def calls_of_python(function: Callable[..., Any]) -> int:
    """How often a function calls externs that are called back."""
    slow = {
        name
        for name, callee in called(function).items()
        if isinstance(callee, Extern) and isinstance(callee.translation, str)
    }
    if not slow:
        return 0
    calls = (n.func for n in ast.walk(parse_function(function)) if isinstance(n, ast.Call))
    return sum(isinstance(called, ast.Name) and called.id in slow for called in calls)


def count_of_arguments(callee: Callee) -> int:
    """How many numbers it is called with."""
    return len(callee.axes) if isinstance(callee, Table) else callee.arguments


def description(callee: Callee) -> str:
    """All that decides its code."""
    if isinstance(callee, Table):
        return callee.digest
    how = callee.translation.text if isinstance(callee.translation, Translation) else "called back"
    return repr((callee.arguments, callee.scales, callee.scale, how))


def emit(unit: Unit, label: str, callees: Mapping[str, Callee]) -> dict[str, PerLane]:
    """The functions of a unit that stand for callees, by name."""
    emitter = _Emitter(unit, label)
    return {name: PerLane(emitter.function(name, callee)) for name, callee in callees.items()}


class Links:
    """The variables by which loaded code and Python's tables and externs know of each other."""

    def __init__(self, code: Loaded) -> None:
        self._code = code
        self._marks: list[Any] = []
        #: The externs that are called back.
        self.called_back: dict[Extern, None] = {}

    def add(self, label: str, callees: Mapping[str, Callee]) -> None:
        """Connect the object of a form."""
        for name, callee in callees.items():
            if isinstance(callee, Table):
                address = self._code.variable(f"{label}_{name}_outside")
                self._marks.append((ctypes.c_int64 * (2 * len(callee.axes))).from_address(address))
            elif isinstance(callee.translation, str):
                slot = ctypes.c_int64.from_address(self._code.variable(f"{label}_{name}_callback"))
                slot.value = ctypes.cast(callee.callback, ctypes.c_void_p).value or 0
                self.called_back[callee] = None

    def marked(self) -> bool:
        """Whether machine code used a table outside its grid since this was asked last."""
        found = any(any(marks) for marks in self._marks)
        for marks in self._marks:
            marks[:] = [0] * len(marks)
        return found


class _Emitter:
    def __init__(self, unit: Unit, label: str) -> None:
        self.unit, self.label = unit, label
        self.data: dict[
            int, Any
        ] = {}  # constants by the identity of their numbers: a table's derivatives have the same ones

    def function(self, name: str, callee: Callee) -> Emitted:
        if isinstance(callee, Table):
            return self.table(name, callee)
        if isinstance(callee.translation, Translation):
            return self.compiled_in(name, callee, callee.translation)
        return self.called_back(name, callee)

    def table(self, name: str, table: Table) -> Emitted:
        count = len(table.axes)
        made, builder = self._begin(name, count)
        point, weights = (builder.alloca(ir.ArrayType(DOUBLE, n)) for n in (count, 4 * count))
        for room in (point, weights):
            room.type = POINTER
        for k, argument in enumerate(made.args):
            builder.store(argument, _item(builder, point, k), align=8)
        marks = self._variable(f"{self.label}_{name}_outside", ir.ArrayType(I64, 2 * count), None)
        floats, ints = Pointer(Float()), Pointer(Int())
        facts = (table.kind, count, len(table.values))
        given = [Value(ir.Constant(I64, fact), Int()) for fact in facts]
        given += [
            Value(self._constant(I64, table.sizes), ints),
            Value(self._constant(DOUBLE, table.knots), floats),
            Value(self._data(table.data), floats),
            Value(self._constant(I64, table.orders), ints),
            Value(point, floats),
            Value(weights, floats),
            Value(marks, ints),
        ]
        inner = self.unit.dialect(interpolate, 1, NO_NAMES)
        builder.ret(builder.call(inner.function, [value.ir for value in given]))
        return Emitted(made, (Float(),) * count, Float())

    def called_back(self, name: str, extern: Extern) -> Emitted:
        """The call through Python, which converts units itself."""
        made, builder = self._begin(name, extern.arguments)
        slot = self._variable(f"{self.label}_{name}_callback", I64, 0)
        signature = ir.FunctionType(DOUBLE, [DOUBLE] * extern.arguments)
        target = builder.inttoptr(builder.load(slot, typ=I64), signature.as_pointer())
        builder.ret(builder.call(target, list(made.args)))
        return Emitted(made, (Float(),) * extern.arguments, Float())

    def compiled_in(self, name: str, extern: Extern, translation: Translation) -> Emitted:
        """The function itself, between conversions of units as `Extern` makes them. It takes no vectors."""
        inner = self.unit.translated(translation)
        made, builder = self._begin(name, extern.arguments)
        arithmetic = Arithmetic(builder, contract=False)
        given = [
            argument if scale == 1.0 else arithmetic.binary("Div", Value(argument, Float()), scale).ir
            for argument, scale in zip(made.args, extern.scales, strict=True)
        ]
        value = Value(builder.call(inner.function, given), Float())
        if extern.scale != 1.0:
            value = arithmetic.binary("Mult", value, extern.scale)
        builder.ret(value.ir)
        return Emitted(made, (Float(),) * extern.arguments, Float())

    def _begin(self, name: str, count: int) -> tuple[ir.Function, ir.IRBuilder]:
        signature = ir.FunctionType(DOUBLE, [DOUBLE] * count)
        made = ir.Function(self.unit.module, signature, self.unit.module.get_unique_name(f"call_{name}"))
        made.linkage = "internal"
        for attribute in ("noinline", "nounwind"):
            made.attributes.add(attribute)
        return made, ir.IRBuilder(made.append_basic_block("entry"))

    def _data(self, values: list[float]) -> Any:
        if id(values) not in self.data:
            self.data[id(values)] = self._constant(DOUBLE, values)
        return self.data[id(values)]

    def _constant(self, item: ir.Type, values: Sequence[float]) -> Any:
        kind = ir.ArrayType(item, len(values))
        name = self.unit.module.get_unique_name("data")
        made = ir.GlobalVariable(self.unit.module, kind, name)
        made.linkage, made.global_constant = "internal", True
        made.initializer = ir.Constant(kind, list(values))
        made.type = POINTER
        return made

    def _variable(self, symbol: str, kind: ir.Type, value: int | None) -> Any:
        made = ir.GlobalVariable(self.unit.module, kind, symbol)
        made.initializer = ir.Constant(kind, value)
        made.type = POINTER
        return made


def _item(builder: ir.IRBuilder, array: Any, index: int) -> Any:
    return builder.gep(array, [ir.Constant(I64, index)], inbounds=True, source_etype=DOUBLE)
