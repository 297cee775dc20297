"""The functions of a group, composed from those of its nodes, in machine code.

A group is data: calls of class functions in order, their inputs taken from the group's own states, from outputs of earlier calls, or from channels that
other groups publish. `Form` is that data with everything taken out that differs between equal groups, so that a thousand equal groups share one
form and its code. Calls that states do not reach come first, many equal ones in a loop; they have no part in the Jacobian. `Composer` emits, for one form and
number of lanes, the functions that the methods ask for; the Jacobian of a group of several nodes is assembled from the nodes' blocks by the chain rule.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

from llvmlite import ir

from hierc.runtime.contract import Class
from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.body import Body
from hierc.runtime.machine.bytable import LARGE, TableCode
from hierc.runtime.machine.calls import CallForm, Division, Form, divide, series
from hierc.runtime.machine.linear import Elimination, LinearCode, eliminate
from hierc.runtime.machine.split import Split, depends, split, switches
from hierc.runtime.machine.types import I64, Emitted, Float, Pointer, Type, Value, llvm_type
from hierc.runtime.machine.unit import Unit

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
        self._needs_no_states: dict[tuple[int, int], bool] = {}
        self._splits: dict[tuple[int, int, tuple[bool, ...]], tuple[Split, set[int], bool]] = {}
        self.rhs_fixed, self.rhs = self._right_hand_sides()

    # ---- right-hand side and outs ---------------------------------------------------------------

    def _right_hand_sides(self) -> tuple[Emitted, Emitted]:
        """(rhs_fixed, rhs): what does not depend on the group's states, and the rest. `v` begins with the outs that are kept."""
        division = self.division
        self.saved = len(division.kept)
        parts = []
        for call in division.reached:
            pieces, moving, switching = self._split(call)
            self.moving_outs |= {call.y + k for k in moving}
            parts.append((call, pieces, self.saved))
            self.saved += pieces.saved
            self.switching |= switching
        fixed = self._begin(
            "fixed", {"t": Float(self.lanes), "u": self.wide, "p": self.narrow, "v": self.wide}
        )
        self._evaluate(fixed, division.before)
        for k, slot in enumerate(division.kept):
            fixed.copy(fixed.outs, slot, fixed.args["v"].ir, k)
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
        for k, slot in enumerate(division.kept):
            rest.copy(rest.args["v"].ir, k, rest.outs, slot)
        for call, pieces, first in parts:
            rest.call(call, pieces.after, "dx" if call.part < 0 else "y", first)
        return fixed.end(), rest.end()

    def publish(self) -> Emitted:
        """The published outs, whole, at given states and inputs."""
        body = self._begin(
            "publish",
            {"t": Float(self.lanes), "x": self.wide, "u": self.wide, "p": self.narrow, "out": self.wide},
        )
        division = divide(self.form.publishing, self.classes, self._stateless)
        self._evaluate(body, division.before)
        for call in division.reached:
            body.call(call, self.definitions(self._function(call)[0]), "y", None)
        for k, slot in enumerate(self.form.published):
            body.copy(body.outs, slot, body.args["out"].ir, k)
        return body.end()

    def _evaluate(self, body: Body, calls: Sequence[CallForm]) -> None:
        """The outs of calls that no states reach."""
        for alike in series(calls, self.classes):
            body.calls(alike, self.definitions(self._function(alike[0])[0]))

    @cached_property
    def division(self) -> Division:
        """The calls of the right-hand sides."""
        return divide(self.form.calls, self.classes, self._stateless)

    def _stateless(self, call: CallForm) -> bool:
        """Whether a call only sets outs, and for that needs its inputs alone."""
        if call.part < 0:
            return False
        key = call.kind, call.part
        if key not in self._needs_no_states:
            moving = depends(self.definitions(self._function(call)[0]), "y", lambda array, _: array != "x")
            self._needs_no_states[key] = not moving
        return self._needs_no_states[key]

    def _split(self, call: CallForm) -> tuple[Split, set[int], bool]:
        """A call's function in two, which of its output moves with the states, and whether it jumps then."""
        held = tuple(self._held(where, k) for where, k in call.sources)
        key = call.kind, call.part, held
        if key not in self._splits:
            function, output = self._function(call)
            definition = self.definitions(function)

            def fixed(array: str, index: int) -> bool:
                return held[index] if array == "u" else array != "x"

            # Outs are told in both parts: in either, what comes after them may read them.
            pieces = split(definition, output, fixed, telling=call.part >= 0)
            moving = depends(definition, output, fixed) if call.part >= 0 else set()
            self._splits[key] = (pieces, moving, switches(pieces.after))
        return self._splits[key]

    def _function(self, call: CallForm) -> tuple[Callable[..., Any], str]:
        kind = self.classes[call.kind]
        return (kind.rhs, "dx") if call.part < 0 else (kind.parts[call.part].function, "y")

    def _held(self, where: str, k: int) -> bool:
        """Whether an input does not come from the group's states."""
        return where in ("channel", "none") or (where == "out" and k not in self.moving_outs)

    def _begin(self, name: str, arguments: Mapping[str, Type]) -> Body:
        return Body(self.unit, self.form, self.lanes, f"{self.name}_{name}", arguments)

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
        for call in self.division.reached:
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

        for call in self.division.reached:
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
        """factor(t, h, x, u, p, v, factors): the Jacobian at lane `middle` of x, u and v, then the factors of lambda - h J."""
        body = self._begin(
            "factor",
            {
                "t": Float(),
                "h": Float(),
                "x": self.wide,
                "u": self.wide,
                "p": self.narrow,
                "v": self.wide,
                "m": self.narrow,
            },
        )
        math, builder = body.math, body.builder
        sources = {source for call in self.division.reached for source in call.sources}
        channels = sorted(k for where, k in sources if where == "channel")
        narrow = body.narrowed(middle, channels, self.division.kept)

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
