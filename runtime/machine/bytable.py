"""The LU of `linear.py` for large patterns: the same elimination in loops over tables instead of written out.

The elimination of an array of agents does the same few steps again and again. Such a stretch is a loop whose body is written out, with places from a
table; entries that stay real are real numbers there. What does not repeat is done by the loops of `irregular.py`, where all entries are packed complex
numbers, and dense blocks by those of `dense.py`, which need no table of their entries. So the code does not grow with the length of an array.

The diagonal holds the inverses of the pivots; all other entries are as the elimination leaves them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from llvmlite import ir

from hierc.runtime.machine import dense, irregular
from hierc.runtime.machine.elimination import Elimination, Entry, Step
from hierc.runtime.machine.packed import Packed
from hierc.runtime.machine.repetitions import Stretch, stretches
from hierc.runtime.machine.rows import MANY, Number, counted, each_row, load, scaled, store
from hierc.runtime.machine.types import I64, LaneConstant, Value

if TYPE_CHECKING:
    from hierc.runtime.machine.unit import Unit

#: Updates above which a factorisation is done by tables; the bodies of its loops have no more than these together.
LARGE = 400


class Layout:
    """Where the entries of a matrix are kept, and which steps of its elimination are done by loops with a body of their own."""

    def __init__(self, plan: Elimination, lanes: int) -> None:
        self.plan, self.lanes = plan, lanes
        self.stretches = _affordable(plan)
        order = dict.fromkeys(range(plan.n), len(plan.steps))
        order |= {step.pivot: k for k, step in enumerate(plan.steps)}
        repeats = [s.rounds > 1 for s in self.stretches for _ in range(s.first, s.end)]
        real = [(i, j) for i, j in plan.real_entries if repeats[min(order[i], order[j])]]
        others = sorted({*plan.complex_entries, *plan.real_entries}.difference(real))
        packed = [*((step, step) for step in sorted(step.pivot for step in plan.steps)), *others]
        #: Of each row in a block: where the block begins, in packed numbers, how many rows it has, and which of them this is.
        self.in_block: dict[int, tuple[int, int, int]] = {}
        first = len(packed)
        for block in plan.blocks:
            self.in_block |= {row: (first, len(block), k) for k, row in enumerate(block)}
            first += len(block) ** 2
        self.packed, self.real = first, len(real)
        #: Of each entry outside of blocks its place, in doubles: first packed numbers, those of the diagonal in order, and after the blocks real ones.
        self.places = {entry: k * lanes for k, entry in enumerate(packed)}
        self.places |= {entry: self.packed * lanes + k for k, entry in enumerate(real)}

    @property
    def size(self) -> int:
        """Doubles, in whole lanes."""
        return (self.packed + -(-self.real // self.lanes)) * self.lanes

    def place(self, entry: Entry) -> int:
        """The place of any entry, in doubles; blocks are row by row."""
        listed = self.places.get(entry)
        if listed is not None:
            return listed
        first, size, i = self.in_block[entry[0]]
        return (first + i * size + self.in_block[entry[1]][2]) * self.lanes

    def width(self, entry: Entry) -> int:
        """Doubles that an entry takes: one if it is real."""
        return self.lanes if self.place(entry) < self.packed * self.lanes else 1

    @property
    def blocks(self) -> list[int]:
        """For `dense.py`: of each block its first place, in lanes, how many rows it has, and these."""
        firsts = [(self.in_block[block[0]][0], block) for block in self.plan.blocks]
        return [number for first, block in firsts for number in (first, len(block), *block)]

    def steps(self, stretch: Stretch) -> Sequence[Step]:
        """The steps of a stretch."""
        return self.plan.steps[stretch.first : stretch.end]

    def body(self, stretch: Stretch) -> Sequence[Step]:
        """The steps of its first round."""
        return self.plan.steps[stretch.first : stretch.first + stretch.period]

    def table(self, stretch: Stretch, record: Callable[[Step], Sequence[int]]) -> list[list[int]]:
        """The records of a stretch, a line for each of its rounds."""
        steps, period = self.steps(stretch), stretch.period
        return [
            [number for step in steps[k : k + period] for number in record(step)]
            for k in range(0, len(steps), period)
        ]


def _affordable(plan: Elimination) -> list[Stretch]:
    """The stretches of an elimination. Where their bodies would be too long, they count as not repeating."""
    complex_entries = set(plan.complex_entries)

    def shape(step: Step) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
        below = tuple((i, step.pivot) in complex_entries for i in step.below)
        return below, tuple((step.pivot, j) in complex_entries for j in step.right)

    left = LARGE
    found: list[Stretch] = []
    for stretch in stretches([shape(step) for step in plan.steps], MANY):
        body = plan.steps[stretch.first : stretch.first + stretch.period]
        updates = sum(1 + len(step.below) * len(step.right) for step in body)
        if stretch.rounds > 1 and updates <= left:
            left -= updates
            found.append(stretch)
        elif found and found[-1].rounds == 1:
            found[-1] = Stretch(found[-1].first, stretch.end - found[-1].first, 1)
        else:
            found.append(Stretch(stretch.first, stretch.end - stretch.first, 1))
    return found


class TableCode:
    """Emits factorisation and solutions of one elimination by tables. `memory` is the address of the factors."""

    def __init__(self, plan: Elimination, lanes: int, unit: Unit) -> None:
        self.layout, self.lanes, self.unit = Layout(plan, lanes), lanes, unit
        signs = LaneConstant((-1.0,) * (lanes // 2) + (1.0,) * (lanes // 2))
        self.names: dict[str, Any] = {"SIGNS": signs, "WIDTH": lanes, "entry_times": irregular.complex_times}
        self.real_names: dict[str, Any] = {"WIDTH": lanes, "entry_times": irregular.real_times}

    # ---- the matrix -------------------------------------------------------------------------------

    def fill(
        self,
        builder: ir.IRBuilder,
        h: Value,
        values: Any,
        slots: Mapping[Entry, int],
        eigenvalues: Value,
        memory: Any,
    ) -> None:
        """Store lambda I - h J. `values` is the address of doubles, `slots` says which of them are the entries of J."""
        packed, layout, n = Packed(builder, self.lanes), self.layout, len(self.layout.plan.steps)
        zero = packed.constant([0.0] * self.lanes)
        for first, last, value in ((0, n, eigenvalues), (n, layout.packed, zero)):
            if first < last:
                with counted(builder, last - first) as k:
                    place = scaled(builder, builder.add(k, ir.Constant(I64, first)), self.lanes)
                    store(builder, memory, place, value)
        if layout.in_block:
            diagonal = [[layout.place((k, k))] for block in layout.plan.blocks for k in block]
            with each_row(self.unit, builder, diagonal) as (place,):
                store(builder, memory, place, eigenvalues)
        minus_h = packed.math.negate(h)
        for width in (1, self.lanes):
            table = [(layout.place(e), slot) for e, slot in slots.items() if layout.width(e) == width]
            if not table:
                continue
            with each_row(self.unit, builder, table) as (place, slot):
                value = packed.math.binary("Mult", minus_h, load(builder, values, slot, 1))
                if width > 1:
                    value = packed.math.binary("Mult", value, packed.one)
                    value = packed.math.binary("Add", load(builder, memory, place, width), value)
                store(builder, memory, place, value)

    def factor(self, builder: ir.IRBuilder, memory: Any) -> None:
        """Factor what `fill` has stored."""
        for stretch in self.layout.stretches:
            if stretch.rounds == 1:
                text = self.unit.dialect(irregular.factor_by_table, self.lanes, self.names)
                records = map(self._factor_record, self.layout.steps(stretch))
                self._go_through(builder, text.function, [memory], stretch, records)
                continue
            with each_row(self.unit, builder, self.layout.table(stretch, self._factor_places)) as row:
                places = iter(row)
                for step in self.layout.body(stretch):
                    self._factor_step(builder, memory, step, places)
        self._blocks(builder, dense.factor, self.lanes, self.names, [memory])

    def _factor_step(self, builder: ir.IRBuilder, memory: Any, step: Step, places: Iterator[Number]) -> None:
        """One step, written out for all of its shape."""
        packed, width = Packed(builder, self.lanes), self.layout.width
        place = next(places)
        inverse = packed.inverse(load(builder, memory, place, self.lanes))
        store(builder, memory, place, inverse)
        below = [load(builder, memory, next(places), width((i, step.pivot))) for i in step.below]
        right = [load(builder, memory, next(places), width((step.pivot, j))) for j in step.right]
        for entry in below:
            multiplier = packed.spread(packed.times(packed.factor(entry), inverse))
            for other in right:
                place = next(places)
                now = load(builder, memory, place, self.lanes)
                update = packed.product(multiplier, other)
                store(builder, memory, place, packed.math.binary("Sub", now, update))

    def _factor_places(self, step: Step) -> list[int]:
        pivot, below, right = step.pivot, step.below, step.right
        entries = [(pivot, pivot), *((i, pivot) for i in below), *((pivot, j) for j in right)]
        return [self.layout.place(e) for e in [*entries, *((i, j) for i in below for j in right)]]

    def _factor_record(self, step: Step) -> list[int]:
        """For `irregular.factor_by_table`, where places count lanes."""

        def place(i: int, j: int) -> int:
            return self.layout.place((i, j)) // self.lanes

        record = [place(step.pivot, step.pivot), len(step.below), len(step.right)]
        for i in step.below:
            record.append(place(i, step.pivot))
            for j in step.right:
                record += [place(step.pivot, j), place(i, j)]
        return record

    def _go_through(
        self,
        builder: ir.IRBuilder,
        function: ir.Function,
        arrays: Sequence[Any],
        stretch: Stretch,
        records: Iterable[Sequence[int]],
    ) -> None:
        """Call a loop of `irregular.py`."""
        table = self.unit.table("steps", [number for record in records for number in record])
        builder.call(function, [*arrays, table.ir, ir.Constant(I64, stretch.period)])

    def _blocks(
        self,
        builder: ir.IRBuilder,
        loops: Callable[..., None],
        width: int,
        names: dict[str, Any],
        arrays: Sequence[Any],
    ) -> None:
        """Call loops of `dense.py`, if there are blocks."""
        blocks = self.layout.plan.blocks
        if blocks:
            table = self.unit.table("blocks", self.layout.blocks)
            function = self.unit.dialect(loops, width, names).function
            builder.call(function, [*arrays, table.ir, ir.Constant(I64, len(blocks))])

    # ---- solutions --------------------------------------------------------------------------------

    def solve(self, builder: ir.IRBuilder, b: Any, memory: Any, width: int, *, real: bool) -> None:
        """Solve in place for b of `width` lanes; `real`: by the real eigenvalue's matrix, for a right-hand side in each lane."""
        code = _Substitution(self.layout, Packed(builder, self.lanes), builder, b, memory, width, real)
        for stretch in self.layout.stretches:
            self._substitute(code, stretch, back=False)
        names = self.real_names if real else self.names
        self._blocks(builder, dense.solve, width, names, [b, memory])
        for stretch in reversed(self.layout.stretches):
            self._substitute(code, stretch, back=True)

    def _substitute(self, code: _Substitution, stretch: Stretch, *, back: bool) -> None:
        """One direction of a stretch."""
        if stretch.rounds == 1:
            names = self.real_names if code.real else self.names
            loop = irregular.back_by_table if back else irregular.forward_by_table
            text = self.unit.dialect(loop, code.width, names)
            steps = self.layout.steps(stretch)
            records = ([row, place, len(rest) // 2, *rest] for row, place, *rest in (
                code.record(step, back) for step in (reversed(steps) if back else steps)
            ))  # fmt: skip
            self._go_through(code.builder, text.function, [code.b, code.memory], stretch, records)
            return
        body = self.layout.body(stretch)
        table = self.layout.table(stretch, lambda step: code.record(step, back))
        with each_row(self.unit, code.builder, table, backwards=back) as row:
            numbers = iter(row)
            given = [(step, [next(numbers) for _ in code.record(step, back)]) for step in body]
            for step, record in reversed(given) if back else given:
                (code.back if back else code.forward)(step, record)


@dataclass(frozen=True, slots=True)
class _Substitution:
    """Emits steps of forward and back substitution, written out for all of their shape."""

    layout: Layout
    packed: Packed
    builder: ir.IRBuilder
    b: Any
    memory: Any
    width: int
    real: bool

    def record(self, step: Step, back: bool) -> list[int]:
        """The numbers of a step: row and place of the pivot, then of all other entries."""
        others = (
            ((j, (step.pivot, j)) for j in step.right) if back else ((i, (i, step.pivot)) for i in step.below)
        )
        pairs = [(step.pivot, (step.pivot, step.pivot)), *others]
        return [number for row, entry in pairs for number in (row, self.layout.place(entry))]

    def forward(self, step: Step, record: Sequence[Number]) -> None:
        """Find the pivot's unknown, and take it from the rows below."""
        row, place, *rest = record
        known = self._times((step.pivot, step.pivot), place, self._load(row))
        self._store(row, known)
        for i, row, place in zip(step.below, rest[::2], rest[1::2], strict=True):
            update = self._times((i, step.pivot), place, known)
            self._store(row, self.packed.math.binary("Sub", self._load(row), update))

    def back(self, step: Step, record: Sequence[Number]) -> None:
        """Take the unknowns of the columns to the right from the pivot's."""
        row, place, *rest = record
        terms = [
            self._times((step.pivot, j), other, self._load(column))
            for j, column, other in zip(step.right, rest[::2], rest[1::2], strict=True)
        ]
        if terms:
            total = functools.reduce(functools.partial(self.packed.math.binary, "Add"), terms)
            update = self._times((step.pivot, step.pivot), place, total)
            self._store(row, self.packed.math.binary("Sub", self._load(row), update))

    def _times(self, entry: Entry, place: Number, value: Value) -> Value:
        lanes = 1 if self.real else self.layout.width(entry)
        kept = load(self.builder, self.memory, place, lanes)
        return (
            self.packed.math.binary("Mult", kept, value)
            if self.real
            else self.packed.times(self.packed.factor(kept), value)
        )

    def _load(self, row: Number) -> Value:
        return load(self.builder, self.b, scaled(self.builder, row, self.width), self.width)

    def _store(self, row: Number, value: Value) -> None:
        store(self.builder, self.b, scaled(self.builder, row, self.width), value)
