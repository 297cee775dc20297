"""The body of one composed function: gathers each call's inputs and makes the call; of many equal calls, by a loop over a table."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from llvmlite import ir
from llvmlite.ir.instructions import CallInstr

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.calls import CallForm, Form
from hierc.runtime.machine.types import DOUBLE, I64, POINTER, Emitted, Float, Pointer, Type, Value, llvm_type
from hierc.runtime.machine.unit import Unit

#: Equal calls from which on a loop makes them.
MANY = 4
#: Instructions of a composed function, before LLVM has seen them, up to which it becomes part of every piece that calls it. Beside a larger one the
#: call costs nothing, and its copies, one in each of six pieces, would take most of the compilation.
INLINED = 2000


def inlined_size(function: ir.Function, known: dict[str, int]) -> int:
    """Instructions of a function, with those of all that becomes part of it. `known`: of other functions, by name."""
    if function.name not in known:
        calls = [i for block in function.blocks for i in block.instructions if isinstance(i, CallInstr)]
        inlined = [call.callee for call in calls if "alwaysinline" in call.callee.attributes]
        own = sum(len(block.instructions) for block in function.blocks)
        known[function.name] = own + sum(inlined_size(callee, known) for callee in inlined)
    return known[function.name]


class _Places(NamedTuple):
    """A call's places in the group's arrays, as `CallForm` has them: known numbers, or in a loop values that are read from its table."""

    x: Any
    p: Any
    y: Any
    sources: Sequence[tuple[str, Any]]


class Body:
    """The body of one function of a form over `lanes` lanes: gathers each call's inputs and makes the call."""

    def __init__(self, unit: Unit, form: Form, lanes: int, name: str, arguments: Mapping[str, Type]) -> None:
        self.unit, self.form, self.kinds, self.lanes = unit, form, tuple(arguments.values()), lanes
        module = unit.module
        signature = ir.FunctionType(ir.VoidType(), [llvm_type(k) for k in self.kinds])
        self.function = ir.Function(module, signature, module.get_unique_name(name))
        self.function.linkage = "internal"
        self.function.attributes.add("nounwind")
        for argument in self.function.args:
            if argument.type == POINTER:
                argument.add_attribute("noalias")
        self.builder = ir.IRBuilder(self.function.append_basic_block("entry"))
        self.math = Arithmetic(self.builder, contract=True)
        self.args = {n: Value(a, k) for a, (n, k) in zip(self.function.args, arguments.items(), strict=True)}
        self.outs = self._room(form.outs)

    def _room(self, count: int) -> Any:
        with self.builder.goto_entry_block():
            room = self.builder.alloca(ir.ArrayType(llvm_type(Float(self.lanes)), max(count, 1)))
        room.type = POINTER  # llvmlite types the result by its item; we give types at each load and store
        return room

    def end(self) -> Emitted:
        self.builder.ret_void()
        small = inlined_size(self.function, {}) <= INLINED
        self.function.attributes.add("alwaysinline" if small else "noinline")
        return Emitted(self.function, self.kinds, None)

    # ---- memory ---------------------------------------------------------------------------------

    def load(self, array: Any, index: Any, lanes: int | None = None) -> Value:
        kind = Float(lanes or self.lanes)
        address = self._item(array, index, kind.lanes)
        return Value(self.builder.load(address, typ=llvm_type(kind), align=8), kind)

    def store(self, array: Any, index: Any, value: Value, lanes: int | None = None) -> None:
        self.builder.store(value.ir, self._item(array, index, lanes or self.lanes), align=8)

    def copy(self, source: Any, i: Any, target: Any, j: Any) -> None:
        self.store(target, j, self.load(source, i))

    def _item(self, array: Any, index: Any, lanes: int) -> Any:
        """Address of an item; the index is a number or a value."""
        if isinstance(index, int):
            place = ir.Constant(I64, index * lanes)
        else:
            place = self.builder.mul(index, ir.Constant(I64, lanes))
        return self.builder.gep(array, [place], inbounds=True, source_etype=DOUBLE)

    # ---- calls ----------------------------------------------------------------------------------

    def call(
        self,
        call: CallForm,
        definition: ast.FunctionDef,
        output: str | None,
        first: int | None,
        room: int = 0,
    ) -> Any:
        """Call a class's function with its own slices of the group's arrays; returns where its output went."""
        return self._call(_Places(call.x, call.p, call.y, call.sources), definition, output, first, room)

    def calls(self, alike: Sequence[CallForm], definition: ast.FunctionDef) -> None:
        """Outs of calls that differ in numbers only and do not read each other's: one by one, or if they are many by a loop over a table."""
        if len(alike) < MANY:
            for call in alike:
                self.call(call, definition, "y", None)
            return
        columns = list(zip(*((c.x, c.p, c.y, *(k for _, k in c.sources)) for c in alike), strict=True))
        moving = [k for k, column in enumerate(columns) if len(set(column)) > 1]
        width = len(moving)
        table = self.unit.table("calls", [columns[k][row] for row in range(len(alike)) for k in moving])
        with self._counted(len(alike)) as row:
            numbers: list[Any] = [column[0] for column in columns]
            start = self.builder.mul(row, ir.Constant(I64, width))
            for n, k in enumerate(moving):
                place = self.builder.add(start, ir.Constant(I64, n))
                address = self.builder.gep(table.ir, [place], inbounds=True, source_etype=I64)
                numbers[k] = self.builder.load(address, typ=I64)
            x, p, y, *inputs = numbers
            kinds = [where for where, _ in alike[0].sources]
            self._call(_Places(x, p, y, list(zip(kinds, inputs, strict=True))), definition, "y", None, 0)

    @contextmanager
    def _counted(self, count: int) -> Iterator[Any]:
        """A loop: within, the number of the round."""
        before = self.builder.block
        inside, after = (self.function.append_basic_block(name) for name in ("calls", "after"))
        self.builder.branch(inside)
        self.builder.position_at_end(inside)
        row = self.builder.phi(I64)
        row.add_incoming(ir.Constant(I64, 0), before)
        yield row
        following = self.builder.add(row, ir.Constant(I64, 1), flags=("nsw", "nuw"))
        row.add_incoming(following, self.builder.block)
        self.builder.cbranch(
            self.builder.icmp_unsigned("<", following, ir.Constant(I64, count)), inside, after
        )
        self.builder.position_at_end(after)

    def _call(
        self, at: _Places, definition: ast.FunctionDef, output: str | None, first: int | None, room: int
    ) -> Any:
        wide, narrow = Pointer(Float(self.lanes)), Pointer(Float())
        into = {"dx": lambda: self._item(self.args["dx"].ir, at.x, self.lanes),
                "y": lambda: self._item(self.outs, at.y, self.lanes),
                "J": lambda: self._room(room)}[output]() if output else None  # fmt: skip
        given: dict[str, tuple[Any, Type]] = {
            "t": (self.args["t"].ir, Float(self.lanes)),
            "x": (self._item(self.args["x"].ir, at.x, self.lanes) if "x" in self.args else self.outs, wide),
            "u": (self._gather(at.sources), wide),
            "d": (self.outs, wide),
            "p": (self._item(self.args["p"].ir, at.p, 1), narrow),
            "v": (self._item(self.args["v"].ir, first, self.lanes) if first is not None else self.outs, wide),
        }
        if output is not None:
            given[output] = (into, wide)
        names = [a.arg for a in definition.args.args]
        types = {n: given[n][1] for n in names}
        target = self.unit.model_function(definition, types, self.lanes)
        self.builder.call(target, [given[n][0] for n in names])
        return into

    def _gather(self, sources: Sequence[tuple[str, Any]]) -> Any:
        """A call's inputs, copied together."""
        into = self._room(len(sources))
        for k, (where, index) in enumerate(sources):
            match where:
                case "channel":
                    self.copy(self.args["u"].ir, index, into, k)
                case "state" if "x" in self.args:
                    self.copy(self.args["x"].ir, index, into, k)
                case "out":
                    self.copy(self.outs, index, into, k)
                case _:
                    pass  # the part that is fixed does not look at states
        return into

    def narrowed(self, lane: int, channels: Sequence[int], outs: Sequence[int]) -> Body:
        """A view of this body over two lanes, both of which hold states, some channels and some outs at one lane of this body.

        The values of these outs, in their order, are the first of `v`. Two lanes cost what one does, and have the quick elementary functions.
        """
        view = object.__new__(Body)
        view.unit, view.form, view.kinds, view.lanes = self.unit, self.form, self.kinds, 2
        view.function, view.builder, view.math = self.function, self.builder, self.math
        view.args = dict(self.args)
        view.outs = view._room(self.form.outs)
        states = list(range(self.form.states))
        for name, count, wanted in (("x", self.form.states, states), ("u", self.form.inputs, channels)):
            room = view._room(count)
            for k in wanted:
                view.store(room, k, self._at_lane(name, k, lane))
            view.args[name] = Value(room, Pointer(Float(2)))
        for k, out in enumerate(outs):
            view.store(view.outs, out, self._at_lane("v", k, lane))
        view.args["t"] = self.math.convert(self.args["t"], Float(2))
        return view

    def _at_lane(self, name: str, k: int, lane: int) -> Value:
        """One lane of an item of an argument, twice."""
        address = self._item(self.args[name].ir, k * self.lanes + lane, 1)
        return self.math.convert(Value(self.builder.load(address, typ=DOUBLE, align=8), Float()), Float(2))
