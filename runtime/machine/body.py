"""The body of one composed function: gathers each call's inputs and makes the call; of many equal calls, by a loop over a table."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from llvmlite import ir
from llvmlite.ir.instructions import CallInstr

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.calls import CallForm, Form
from hierc.runtime.machine.rows import MANY, Number, address, each_row, load, scaled, store
from hierc.runtime.machine.types import POINTER, Emitted, Float, Pointer, Type, Value, llvm_type
from hierc.runtime.machine.unit import Unit

#: Copies from which on a loop makes them.
COPIES = 32
#: What is done with a call's output: its address, and the number that the call has been given.
Then = Callable[[Any, Number], None]
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

    def load(self, array: Any, index: Number, lanes: int | None = None) -> Value:
        lanes = lanes or self.lanes
        return load(self.builder, array, scaled(self.builder, index, lanes), lanes)

    def store(self, array: Any, index: Number, value: Value, lanes: int | None = None) -> None:
        store(self.builder, array, scaled(self.builder, index, lanes or self.lanes), value)

    def copy(self, source: Any, i: Number, target: Any, j: Number) -> None:
        self.store(target, j, self.load(source, i))

    def copies(self, source: Any, target: Any, pairs: Sequence[tuple[int, int]]) -> None:
        """Copy several items, from and to these indices."""
        self._for_each(pairs, lambda i, j: self.copy(source, i, target, j), COPIES)

    def _for_each(self, rows: Sequence[tuple[int, ...]], do: Callable[..., None], many: int) -> None:
        """Written out, or by a loop from `many` on."""
        if len(rows) < many:
            for row in rows:
                do(*row)
            return
        with each_row(self.unit, self.builder, rows) as numbers:
            do(*numbers)

    def _item(self, array: Any, index: Number, lanes: int) -> Any:
        """Address of an item."""
        return address(self.builder, array, scaled(self.builder, index, lanes))

    # ---- calls ----------------------------------------------------------------------------------

    def calls(
        self,
        alike: Sequence[CallForm],
        definition: ast.FunctionDef,
        output: str | None,
        *,
        firsts: Sequence[int] = (),
        room: int = 0,
        then: Then | None = None,
        loop: bool = True,
    ) -> None:
        """Make calls that differ in numbers only and do not read each other's: one by one, or by a loop if they are many and `loop` allows it.

        `firsts`: a number for each call, where its values begin in `v`, or what `then` is given, which sees to its output; `room` is the size of "J".
        """
        numbers = firsts or [0] * len(alike)
        rows = [(c.x, c.p, c.y, k, *(i for _, i in c.sources)) for c, k in zip(alike, numbers, strict=True)]
        kinds = [where for where, _ in alike[0].sources]

        def make(x: Number, p: Number, y: Number, first: Number, *inputs: Number) -> None:
            places = _Places(x, p, y, list(zip(kinds, inputs, strict=True)))
            into = self._call(places, definition, output, first, room)
            if then is not None:
                then(into, first)

        self._for_each(rows, make, MANY if loop else len(rows) + 1)

    def _call(
        self, at: _Places, definition: ast.FunctionDef, output: str | None, first: Number, room: int
    ) -> Any:
        """Call a class's function with its own slices of the group's arrays; returns where its output went."""
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
            "v": (self._item(self.args["v"].ir, first, self.lanes) if "v" in self.args else self.outs, wide),
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
        for name, count, taken in (("x", self.form.states, states), ("u", self.form.inputs, channels)):
            room = view._room(count)
            view._take(self, name, lane, room, [(k, k) for k in taken])
            view.args[name] = Value(room, Pointer(Float(2)))
        view._take(self, "v", lane, view.outs, list(enumerate(outs)))
        view.args["t"] = self.math.convert(self.args["t"], Float(2))
        return view

    def _take(self, body: Body, name: str, lane: int, into: Any, pairs: Sequence[tuple[int, int]]) -> None:
        """Copy items of an argument of a wider body at one lane."""
        first = address(self.builder, body.args[name].ir, lane)

        def take(i: Number, j: Number) -> None:
            value = load(self.builder, first, scaled(self.builder, i, body.lanes), 1)
            self.store(into, j, self.math.convert(value, Float(self.lanes)))

        self._for_each(pairs, take, COPIES)
