"""The functions of a group, composed from those of its nodes, in machine code.

A group is data: calls of class functions in order, their inputs taken from the group's own states, from outputs of earlier calls, or from channels that
other groups publish. `Form` is that data with everything taken out that differs between equal groups, so that a thousand equal groups share one
form and its code. `Composer` emits, for one form and number of lanes, the functions that the methods ask for; the Jacobian of a group of several nodes is
assembled from the nodes' blocks by the chain rule.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from llvmlite import ir
from llvmlite.ir.instructions import CallInstr

from hierc.runtime.contract import Class
from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.bytable import LARGE, TableCode
from hierc.runtime.machine.linear import Elimination, LinearCode, eliminate
from hierc.runtime.machine.split import depends, split, switches
from hierc.runtime.machine.types import DOUBLE, I64, POINTER, Emitted, Float, Pointer, Type, Value, llvm_type
from hierc.runtime.machine.unit import Unit

#: Instructions of a composed function, before LLVM has seen them, up to which it becomes part of every piece that calls it. Beside a larger one the
#: call costs nothing, and its copies, one in each of six pieces, would take most of the compilation.
INLINED = 2000

#: Where a call finds an input; "none": it does not look at it.
Where = tuple[Literal["channel", "state", "out", "none"], int]


@dataclass(frozen=True, slots=True)
class CallForm:
    """One call: `part` of class `kind`, or its right-hand side (part -1).

    States begin at `x`, values at `p`, the class's outs at `y` of the group's outs; `sources[k]` says where input k is found.
    """

    kind: int
    part: int
    x: int
    p: int
    y: int
    sources: tuple[Where, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """What equal groups have in common: n states, their right-hand sides' calls, the calls that publish `published` outs, sizes."""

    states: int
    inputs: int
    outs: int
    calls: tuple[CallForm, ...]
    publishing: tuple[CallForm, ...]
    published: tuple[int, ...]


Definitions = Callable[[Callable[..., Any]], ast.FunctionDef]


class Composer:
    """Emits the functions of one form over `lanes` lanes into a unit."""

    def __init__(
        self,
        unit: Unit,
        name: str,
        form: Form,
        classes: tuple[Class, ...],
        definitions: Definitions,
        lanes: int,
    ) -> None:
        self.unit, self.name, self.form, self.classes, self.lanes = unit, name, form, classes, lanes
        self.definitions = definitions
        self.wide = Pointer(Float(lanes))
        self.narrow = Pointer(Float())
        self.saved = 0
        self.moving_outs: set[int] = set()
        self.switching = False
        self.rhs_fixed, self.rhs = self._right_hand_sides(form.calls)

    # ---- right-hand side and outs ---------------------------------------------------------------

    def _right_hand_sides(self, calls: tuple[CallForm, ...]) -> tuple[Emitted, Emitted]:
        """(rhs_fixed, rhs): what does not depend on the group's states, and the rest."""
        parts = []
        for call in calls:
            function, output = self._function(call)
            # Outs are told in both parts: in either, what comes after them may read them.
            pieces = split(self.definitions(function), output, self._fixed(call), telling=call.part >= 0)
            if call.part >= 0:
                moving = depends(self.definitions(function), output, self._fixed(call))
                self.moving_outs |= {call.y + k for k in moving}
            parts.append((call, pieces, self.saved))
            self.saved += pieces.saved
            self.switching |= switches(pieces.after)
        fixed = self._begin(
            "fixed", {"t": Float(self.lanes), "u": self.wide, "p": self.narrow, "v": self.wide}
        )
        for call, pieces, first in parts:
            fixed.call(call, pieces.before, "y" if call.part >= 0 else None, first)
        rest = self._begin(
            "rhs",
            {
                "t": Float(self.lanes),
                "x": self.wide,
                "u": self.wide,
                "p": self.narrow,
                "dx": self.wide,
                "v": self.wide,
            },
        )
        for call, pieces, first in parts:
            rest.call(call, pieces.after, "dx" if call.part < 0 else "y", first)
        return fixed.end(), rest.end()

    def publish(self) -> Emitted:
        """The published outs, whole, at given states and inputs."""
        body = self._begin(
            "publish",
            {"t": Float(self.lanes), "x": self.wide, "u": self.wide, "p": self.narrow, "out": self.wide},
        )
        for call in self.form.publishing:
            body.call(call, self.definitions(self._function(call)[0]), "y", None)
        for k, slot in enumerate(self.form.published):
            body.copy(body.outs, slot, body.args["out"].ir, k)
        return body.end()

    def _function(self, call: CallForm) -> tuple[Callable[..., Any], str]:
        kind = self.classes[call.kind]
        return (kind.rhs, "dx") if call.part < 0 else (kind.parts[call.part].function, "y")

    def _fixed(self, call: CallForm) -> Callable[[str, int], bool]:
        """What the call's function does not have from the group's states."""

        def fixed(array: str, index: int) -> bool:
            if array == "u":
                where, k = call.sources[index]
                return where in ("channel", "none") or (where == "out" and k not in self.moving_outs)
            return array != "x"

        return fixed

    def _begin(self, name: str, arguments: Mapping[str, Type]) -> _Body:
        return _Body(self, f"{self.name}_{name}", arguments)

    # ---- Jacobian -------------------------------------------------------------------------------

    @cached_property
    def elimination(self) -> Elimination:
        """Order of elimination for the group's own Jacobian."""
        return eliminate(self.form.states, frozenset(self.pattern))

    @property
    def pattern(self) -> tuple[tuple[int, int], ...]:
        """Nonzeros of the Jacobian of the group's states by themselves."""
        return tuple(sorted(self._chain(lambda call: None)))

    def linear(self) -> bool:
        """Whether the right-hand side is linear in the states, its Jacobian constant within a run."""
        if self.switching:
            return False
        for call in self.form.calls:
            kind = self.classes[call.kind]
            varying = depends(self.definitions(kind.jac), "J", lambda array, _: array in ("p", "d"))
            if varying & {e for e, (row, _) in enumerate(kind.pattern) if self._wanted(call, row)}:
                return False
        return True

    def _wanted(self, call: CallForm, row: int) -> bool:
        n = len(self.classes[call.kind].states)
        return (
            (row < n)
            if call.part < 0
            else (row >= n and row - n in self.classes[call.kind].parts[call.part].outs)
        )

    def _chain(
        self, evaluate: Callable[[CallForm], Any], math: Arithmetic | None = None
    ) -> dict[tuple[int, int], Any]:
        """d dx/d x by the chain rule. `evaluate(call)` returns the class's nonzeros as values (None: pattern only)."""
        outs: dict[int, dict[int, Any]] = {}
        result: dict[tuple[int, int], Any] = {}

        def add(row: dict[int, Any], column: int, factor: Any, value: Any) -> None:
            if math is None:
                row[column] = None
                return
            term = value if factor is None else math.binary("Mult", factor, value)
            row[column] = term if column not in row else math.binary("Add", row[column], term)

        for call in self.form.calls:
            kind = self.classes[call.kind]
            n = len(kind.states)
            values = evaluate(call)
            rows: dict[int, dict[int, Any]] = {}
            for e, (row, column) in enumerate(kind.pattern):
                if not self._wanted(call, row):
                    continue
                entry = None if values is None else values[e]
                into = rows.setdefault(row, {})
                if column < n:
                    add(into, call.x + column, None, entry)
                    continue
                where, k = call.sources[column - n]
                if where == "state":
                    add(into, k, None, entry)
                elif where == "out":
                    for through, value in outs.get(k, {}).items():
                        add(into, through, entry, value)
            for row, entries in rows.items():
                if call.part < 0:
                    result.update({(call.x + row, c): v for c, v in entries.items()})
                else:
                    outs[call.y + row - n] = entries
        return result

    def factor(self, eigenvalues: tuple[float, ...], middle: int) -> Emitted:
        """factor(t, h, x, u, p, factors): the Jacobian at lane `middle` of x and u, then the factors of lambda - h J."""
        body = self._begin(
            "factor",
            {"t": Float(), "h": Float(), "x": self.wide, "u": self.wide, "p": self.narrow, "m": self.narrow},
        )
        math, builder = body.math, body.builder
        narrow = body.narrowed(middle)

        def evaluate(call: CallForm) -> list[Value]:
            kind = self.classes[call.kind]
            if call.part >= 0:
                narrow.call(call, self.definitions(self._function(call)[0]), "y", None)
            into = narrow.call(call, self.definitions(kind.jac), "J", None, len(kind.pattern))
            return [math.extract(narrow.load(into, e), 0) for e in range(len(kind.pattern))]

        jacobian = self._chain(evaluate, math)
        packed = Value(ir.Constant(llvm_type(Float(self.lanes)), list(eigenvalues)), Float(self.lanes))
        memory = body.args["m"]
        if self.by_table is None:
            LinearCode(self.elimination, self.lanes, builder, memory.ir).factor(
                body.args["h"], jacobian, packed
            )
        else:
            self.by_table.fill(math, body.args["h"], jacobian, packed, memory.ir)
            function, table = self.by_table.factoring()
            builder.call(function.function, [memory.ir, table.ir, ir.Constant(I64, self.form.states)])
        return body.end()

    @cached_property
    def by_table(self) -> TableCode | None:
        """How a large group's linear algebra is done; None for a small one, whose is written out."""
        large = self.elimination.updates > LARGE
        return TableCode(self.elimination, self.lanes, self.unit) if large else None

    @property
    def factor_size(self) -> int:
        """Doubles that the factors take."""
        return self.elimination.size(self.lanes) if self.by_table is None else self.by_table.size

    def solve(self) -> Emitted:
        """solve(b, factors): packed systems, in place."""
        return self._solver("solve", self.lanes)

    def solve_real(self) -> Emitted:
        """solve_real(b, factors): the real eigenvalue's system, in place."""
        return self._solver("solve_real", 1, real=True)

    def solve_lanes(self) -> Emitted:
        """solve_lanes(b, factors): the real eigenvalue's system, for a right-hand side in each lane, in place."""
        return self._solver("solve_lanes", self.lanes, real=True)

    def _solver(self, name: str, width: int, *, real: bool = False) -> Emitted:
        body = self._begin(name, {"b": Pointer(Float(width)), "m": self.narrow})
        b, memory = body.args["b"].ir, body.args["m"].ir
        if self.by_table is not None:
            function, table = self.by_table.solving(real=real, width=width)
            body.builder.call(function.function, [b, memory, table.ir, ir.Constant(I64, self.form.states)])
            return body.end()
        code = LinearCode(self.elimination, self.lanes, body.builder, memory)
        solve = code.solve_real if real else code.solve
        solve(lambda i: body.load(b, i, width), lambda i, v: body.store(b, i, v, width))
        return body.end()


def inlined_size(function: ir.Function, known: dict[str, int]) -> int:
    """Instructions of a function, with those of all that becomes part of it. `known`: of other functions, by name."""
    if function.name not in known:
        calls = [i for block in function.blocks for i in block.instructions if isinstance(i, CallInstr)]
        inlined = [call.callee for call in calls if "alwaysinline" in call.callee.attributes]
        own = sum(len(block.instructions) for block in function.blocks)
        known[function.name] = own + sum(inlined_size(callee, known) for callee in inlined)
    return known[function.name]


class _Body:
    """The body of one composed function: gathers each call's inputs and makes the call."""

    def __init__(self, composer: Composer, name: str, arguments: Mapping[str, Type]) -> None:
        self.composer, self.kinds, self.lanes = composer, tuple(arguments.values()), composer.lanes
        module = composer.unit.module
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
        self.outs = self._room(composer.form.outs)

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

    def load(self, array: Any, index: int, lanes: int | None = None) -> Value:
        kind = Float(lanes or self.lanes)
        address = self._item(array, index, kind.lanes)
        return Value(self.builder.load(address, typ=llvm_type(kind), align=8), kind)

    def store(self, array: Any, index: int, value: Value, lanes: int | None = None) -> None:
        self.builder.store(value.ir, self._item(array, index, lanes or self.lanes), align=8)

    def copy(self, source: Any, i: int, target: Any, j: int) -> None:
        self.store(target, j, self.load(source, i))

    def _item(self, array: Any, index: int, lanes: int) -> Any:
        return self.builder.gep(array, [ir.Constant(I64, index * lanes)], inbounds=True, source_etype=DOUBLE)

    def _gather(self, call: CallForm) -> Any:
        """The call's inputs, copied together."""
        into = self._room(len(call.sources))
        for k, (where, index) in enumerate(call.sources):
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

    def call(
        self,
        call: CallForm,
        definition: ast.FunctionDef,
        output: str | None,
        first: int | None,
        room: int = 0,
    ) -> Any:
        """Call a class's function with its own slices of the group's arrays; returns where its output went."""
        wide, narrow = Pointer(Float(self.lanes)), Pointer(Float())
        into = {"dx": lambda: self._item(self.args["dx"].ir, call.x, self.lanes),
                "y": lambda: self._item(self.outs, call.y, self.lanes),
                "J": lambda: self._room(room)}[output]() if output else None  # fmt: skip
        given: dict[str, tuple[Any, Type]] = {
            "t": (self.args["t"].ir, Float(self.lanes)),
            "x": (self._item(self.args["x"].ir, call.x, self.lanes) if "x" in self.args else self.outs, wide),
            "u": (self._gather(call), wide),
            "d": (self.outs, wide),
            "p": (self._item(self.args["p"].ir, call.p, 1), narrow),
            "v": (self._item(self.args["v"].ir, first, self.lanes) if first is not None else self.outs, wide),
        }
        if output is not None:
            given[output] = (into, wide)
        names = [a.arg for a in definition.args.args]
        types = {n: given[n][1] for n in names}
        target = self.composer.unit.model_function(definition, types, self.lanes)
        self.builder.call(target, [given[n][0] for n in names])
        return into

    def narrowed(self, lane: int) -> _Body:
        """A view of this body over two lanes, both of which hold states and inputs at one lane of this body.

        Two lanes cost what one does, and have the quick elementary functions.
        """
        form = self.composer.form
        view = object.__new__(_Body)
        view.composer, view.kinds, view.lanes = self.composer, self.kinds, 2
        view.function, view.builder, view.math = self.function, self.builder, self.math
        view.args = dict(self.args)
        view.outs = view._room(form.outs)
        for name, count in (("x", form.states), ("u", form.inputs)):
            room = view._room(count)
            for k in range(count):
                value = self.builder.load(self._lane_address(name, k, lane), typ=DOUBLE, align=8)
                view.store(room, k, self.math.convert(Value(value, Float()), Float(2)))
            view.args[name] = Value(room, Pointer(Float(2)))
        view.args["t"] = self.math.convert(self.args["t"], Float(2))
        return view

    def _lane_address(self, name: str, k: int, lane: int) -> Any:
        return self.builder.gep(
            self.args[name].ir, [ir.Constant(I64, k * self.lanes + lane)], inbounds=True, source_etype=DOUBLE
        )
