"""The functions of a group, composed from those of its nodes, in machine code.

A group is data: calls of class functions in order, their inputs taken from the group's own states, from outputs of earlier calls, or from channels that
other groups publish. `Form` is that data with everything taken out that differs between equal groups, so that a thousand equal groups share one
form and its code. Calls that states do not reach come first, many equal ones in a loop; they have no part in the Jacobian. `Composer` emits, for one form and
number of lanes, the functions that the methods ask for; the Jacobian of a group of several nodes is assembled from the nodes' blocks by the chain rule.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from llvmlite import ir

from hierc.runtime.contract import Class
from hierc.runtime.machine.body import Body
from hierc.runtime.machine.bytable import LARGE, TableCode
from hierc.runtime.machine.calls import CallForm, Division, Form, divide, series
from hierc.runtime.machine.derivatives import Derivatives, StoredDerivatives
from hierc.runtime.machine.elimination import Elimination, Entry, eliminate
from hierc.runtime.machine.jacobian import ONE, Chain, chain, wanted
from hierc.runtime.machine.linear import LinearCode, factor_size
from hierc.runtime.machine.rows import address
from hierc.runtime.machine.split import Split, depends, narrowed, split, switches
from hierc.runtime.machine.types import Emitted, Float, Pointer, Type, Value, llvm_type
from hierc.runtime.machine.unit import Unit

Definitions = Callable[[Callable[..., Any]], ast.FunctionDef]

#: Equal calls that states reach, from which on a group counts as large.
ALIKE = 8


@dataclass(frozen=True, slots=True)
class Reached:
    """Calls that states reach, alike but for numbers: their function in two pieces, and the entries of their class's Jacobian that matter.

    The first one's values begin in `v` at `saved`, its entries at slot `derivatives`; those of the others follow.
    """

    calls: tuple[CallForm, ...]
    pieces: Split
    saved: int
    entries: tuple[int, ...]
    derivatives: int

    @property
    def kind(self) -> int:
        """Their class."""
        return self.calls[0].kind

    @property
    def part(self) -> int:
        """The part of the class that they call."""
        return self.calls[0].part

    @property
    def saved_firsts(self) -> list[int]:
        """Where each one's values begin in `v`."""
        return [self.saved + k * self.pieces.saved for k in range(len(self.calls))]

    @property
    def entry_firsts(self) -> list[int]:
        """The slot of each one's first entry."""
        return [self.derivatives + k * len(self.entries) for k in range(len(self.calls))]


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
        self.moving_outs: set[int] = set()
        self.switching = False
        self._needs_no_states: dict[tuple[int, int], bool] = {}
        self._splits: dict[tuple[int, int, tuple[bool, ...]], tuple[Split, set[int], bool]] = {}
        self._jacobians: dict[tuple[int, tuple[int, ...]], ast.FunctionDef] = {}
        self.rhs_fixed, self.rhs = self._right_hand_sides()

    # ---- right-hand side and outs ---------------------------------------------------------------

    def _right_hand_sides(self) -> tuple[Emitted, Emitted]:
        """(rhs_fixed, rhs): what does not depend on the group's states, and the rest. `v` begins with the outs that are kept."""
        kept = list(enumerate(self.division.kept))
        self.reached = self._find_reached()
        fixed = self._begin(
            "fixed", {"t": Float(self.lanes), "u": self.wide, "p": self.narrow, "v": self.wide}
        )
        self._evaluate(fixed, self.division.before)
        fixed.copies(fixed.outs, fixed.args["v"].ir, [(slot, k) for k, slot in kept])
        for alike in self.reached:
            self._make(fixed, alike, alike.pieces.before, "y" if alike.part >= 0 else None)
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
        rest.copies(rest.args["v"].ir, rest.outs, kept)
        for alike in self.reached:
            self._make(rest, alike, alike.pieces.after, "y" if alike.part >= 0 else "dx")
        return fixed.end(), rest.end()

    def _find_reached(self) -> list[Reached]:
        """The calls that states reach, with their places in `v` and among the derivatives."""
        for call in self.division.reached:
            _, moving, switching = self._split(call)
            self.moving_outs |= {call.y + k for k in moving}
            self.switching |= switching
        self.saved = len(self.division.kept)
        self.derivatives = ONE + 1
        found = []
        for calls in series(self.division.reached, self.classes, self._held):
            pieces, kind = self._split(calls[0])[0], self.classes[calls[0].kind]
            entries = wanted(calls[0], kind, self.moving_outs.__contains__)
            found.append(Reached(calls, pieces, self.saved, entries, self.derivatives))
            self.saved += pieces.saved * len(calls)
            self.derivatives += len(entries) * len(calls)
        return found

    def _make(self, body: Body, alike: Reached, definition: ast.FunctionDef, output: str | None) -> None:
        """One piece of some calls that states reach."""
        body.calls(alike.calls, definition, output, firsts=alike.saved_firsts, loop=self.large)

    def publish(self) -> Emitted:
        """The published outs, whole, at given states and inputs."""
        body = self._begin(
            "publish",
            {"t": Float(self.lanes), "x": self.wide, "u": self.wide, "p": self.narrow, "out": self.wide},
        )
        division = divide(self.form.publishing, self.classes, self._stateless)
        self._evaluate(body, division.before)
        self._evaluate(body, division.reached, loop=self.large)
        published = [(slot, k) for k, slot in enumerate(self.form.published)]
        body.copies(body.outs, body.args["out"].ir, published)
        return body.end()

    def _evaluate(self, body: Body, calls: Sequence[CallForm], *, loop: bool = True) -> None:
        """Calls that set outs, whole."""
        for alike in series(calls, self.classes):
            body.calls(alike, self.definitions(self._function(alike[0])[0]), "y", loop=loop)

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
        held = self._held(call)
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

    def _held(self, call: CallForm) -> tuple[bool, ...]:
        """Which inputs do not come from the group's states."""
        return tuple(
            where in ("channel", "none") or (where == "out" and k not in self.moving_outs)
            for where, k in call.sources
        )

    def _begin(self, name: str, arguments: Mapping[str, Type]) -> Body:
        return Body(self.unit, self.form, self.lanes, f"{self.name}_{name}", arguments)

    # ---- Jacobian -------------------------------------------------------------------------------

    @cached_property
    def chain(self) -> Chain:
        """How the group's Jacobian is made of its nodes'."""
        places = {
            call: (alike.entries, first)
            for alike in self.reached
            for call, first in zip(alike.calls, alike.entry_firsts, strict=True)
        }
        calls = [(call, *places[call]) for call in self.division.reached]
        return chain(calls, self.classes, self.derivatives)

    @cached_property
    def elimination(self) -> Elimination:
        """Order of elimination for the group's own Jacobian."""
        return eliminate(self.form.states, frozenset(self.pattern))

    @property
    def pattern(self) -> tuple[Entry, ...]:
        """Nonzeros of the Jacobian of the group's states by themselves."""
        return tuple(sorted(self.chain.entries))

    @cached_property
    def large(self) -> bool:
        """Whether calls and linear algebra are done by loops over tables; in a small group all is written out."""
        many = max((len(alike.calls) for alike in self.reached), default=0)
        return many >= ALIKE or self.elimination.updates > LARGE

    def linear(self) -> bool:
        """Whether the right-hand side is linear in the states, its Jacobian constant within a run."""
        if self.switching:
            return False
        for alike in self.reached:
            jac = self.definitions(self.classes[alike.kind].jac)
            if depends(jac, "J", lambda array, _: array in ("p", "d")) & {*alike.entries}:
                return False
        return True

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
        sources = {source for call in self.division.reached for source in call.sources}
        channels = sorted(k for where, k in sources if where == "channel")
        narrow = body.narrowed(middle, channels, self.division.kept)
        kind = Float(self.lanes)
        packed = Value(ir.Constant(llvm_type(kind), list(eigenvalues)), kind)
        memory, h = body.args["m"].ir, body.args["h"]
        if self.by_table is None:
            values = Derivatives(narrow)
            self._differentiate(narrow, values)
            jacobian = values.follow(self.chain)
            LinearCode(self.elimination, self.lanes, body.builder, memory).factor(h, jacobian, packed)
        else:
            stored = StoredDerivatives(narrow, address(body.builder, memory, self.by_table.layout.size))
            self._differentiate(narrow, stored)
            stored.follow(self.chain)
            self.by_table.fill(body.builder, h, stored.memory, self.chain.entries, packed, memory)
            self.by_table.factor(body.builder, memory)
        return body.end()

    def _differentiate(self, narrow: Body, into: Derivatives | StoredDerivatives) -> None:
        """Evaluate the entries of all calls' Jacobians that matter."""
        for alike in self.reached:
            if alike.part >= 0:
                definition = self.definitions(self._function(alike.calls[0])[0])
                narrow.calls(alike.calls, definition, "y", loop=self.large)
            kind = self.classes[alike.kind]
            key = alike.kind, alike.entries
            if key not in self._jacobians:
                self._jacobians[key] = narrowed(self.definitions(kind.jac), "J", alike.entries)
            narrow.calls(
                alike.calls,
                self._jacobians[key],
                "J",
                firsts=alike.entry_firsts,
                room=len(kind.pattern),
                then=functools.partial(into.take, alike.entries),
                loop=self.large,
            )

    @cached_property
    def by_table(self) -> TableCode | None:
        """How a large group's linear algebra is done; None for a small one, whose is written out."""
        return TableCode(self.elimination, self.lanes, self.unit) if self.large else None

    @property
    def factor_size(self) -> int:
        """Doubles that the factors take, and the derivatives that they are made from."""
        if self.by_table is None:
            return factor_size(self.elimination, self.lanes)
        return self.by_table.layout.size + self.chain.size

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
            self.by_table.solve(body.builder, b, memory, width, real=real)
            return body.end()
        code = LinearCode(self.elimination, self.lanes, body.builder, memory)
        solve = code.solve_real if real else code.solve
        solve(lambda i: body.load(b, i, width), lambda i, v: body.store(b, i, v, width))
        return body.end()
