"""Outs and observed variables of many elements at many times.

In: a system, the calls that make outs, in order, and the elements that are observed. Out: their observed variables. Guaranteed: the very bits that the
generated functions have under CPython. Machine code makes all numbers; whatever has to do with one that is not finite, where CPython may have raised, is
then done again by the functions themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.columns import distinct
from hierc.runtime.elements import Block
from hierc.runtime.machine.batch import Task, driver, machine_code
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.records import Evaluation
from hierc.runtime.system import NO_DISCRETE, System, call
from hierc.runtime.trajectory import Trajectories

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_NAN = float("nan")
#: Numbers that are held at a time, about.
HELD = 2_000_000


@dataclass(frozen=True, slots=True)
class _Section:
    """Evaluations of one function: their numbers among all, and the rows of the world (evaluations, entries) that they read and set."""

    task: Task
    numbers: Integers
    reads: Integers
    sets: Integers


def batch(system: System, calls: Sequence[tuple[int, int]], nodes: Sequence[int], most: int) -> Batch | None:
    """The batch of calls (element, part) and observed nodes; None where that would compile more functions than `most`, or call back."""
    elements = np.array([*(e for e, _ in calls), *nodes], np.int64)
    parts = np.array([*(part for _, part in calls), *[-1] * len(nodes)], np.int64)
    found = [
        (block, Task(kind, part), np.flatnonzero((system.elements.block[elements] == b) & (parts == part)))
        for b, part in sorted(set(zip(system.elements.block[elements].tolist(), parts.tolist(), strict=True)))
        for block in [system.elements.blocks[b]]
        for kind in [system.plan.classes[block.kind]]
    ]
    tasks = {task for _, task, _ in found}
    if len(tasks) > most or any(task.calls_back for task in tasks):
        return None
    return Batch(system, elements, found)


class Batch:
    """Evaluations in order, of the elements `elements`; `tasks` say of which block they are, what each does, and their numbers.

    A *world* has a row of times for each number: the states that are `needed`, by position, then outs, then what is observed, node by node.
    """

    def __init__(
        self, system: System, elements: Integers, tasks: Sequence[tuple[Block, Task, Integers]]
    ) -> None:
        self._system, self._elements = system, elements
        widths = np.zeros(len(elements), np.int64)
        for _, task, numbers in tasks:
            widths[numbers] = task.kind.observed if task.part < 0 else 0
        firsts = system.size + int(system.elements.outs[-1]) + np.cumsum(widths) - widths
        sections = [self._section(block, task, numbers, firsts[numbers]) for block, task, numbers in tasks]
        read = np.concatenate([s.reads.ravel() for s in sections])
        self.needed: Integers = distinct(read[read < system.size])
        slots = np.concatenate([self.needed, np.sort(np.concatenate([s.sets.ravel() for s in sections]))])
        rows = np.full(int(firsts[-1] + widths[-1]), -1, np.int64)
        rows[slots] = np.arange(len(slots))
        self._sections = [_Section(s.task, s.numbers, rows[s.reads], rows[s.sets]) for s in sections]
        self.rows, self.observed = len(slots), int(widths.sum())
        self._fill()

    def _section(self, block: Block, task: Task, numbers: Integers, firsts: Integers) -> _Section:
        """Evaluations of one function with slots for rows: states and outs as in a world of `System`, then what is observed from `firsts` on."""
        elements = self._system.elements
        owners = self._elements[numbers]
        first = {"state": elements.offsets, "out": self._system.size + elements.outs}
        columns = [first["state"][owners] + k for k in range(len(task.kind.states))]
        for source in block.sources:
            rows = owners - block.first
            columns.append(first[source.what][source.elements[rows]] + source.index[rows])
        reads = [columns[k] for k in task.reads]
        begin = firsts if task.part < 0 else first["out"][owners]
        return _Section(
            task,
            numbers,
            np.stack(reads, axis=1) if reads else np.zeros((len(numbers), 0), np.int64),
            begin[:, None] + np.array(task.sets, np.int64),
        )

    def _fill(self) -> None:
        """Fill the records of all evaluations."""
        self._records = RecordArray(Evaluation, len(self._elements))
        self._places = [np.ascontiguousarray(a) for s in self._sections for a in (s.reads, s.sets)]
        self._values = self._system.values_of(self._elements)
        lengths = np.array([self._system.kind(e).values for e in self._elements], np.int64)
        self._records["p"][:] = self._values.ctypes.data + 8 * (np.cumsum(lengths) - lengths)
        for k, section in enumerate(self._sections):
            for name, places in (("places", self._places[2 * k]), ("targets", self._places[2 * k + 1])):
                across = 8 * places.shape[1] * np.arange(len(places))
                self._records[name][section.numbers] = places.ctypes.data + across
            self._records["code"][section.numbers] = machine_code(section.task)[0]
        self._room = np.zeros(max(s.task.size for s in self._sections))

    def observe(self, trajectories: Trajectories, t: Floats) -> Floats:
        """What is observed (len(t), observed), at the times t."""
        result = np.empty((len(t), self.observed))
        step = max(HELD // self.rows, 1)
        for first in range(0, len(t), step):
            times = np.ascontiguousarray(t[first : first + step])
            world = np.empty((self.rows, len(times)))
            world[: len(self.needed)] = trajectories.states(self.needed, times).T
            self._evaluate(times, world)
            result[first : first + step] = world[self.rows - self.observed :].T
        return result

    def _evaluate(self, times: Floats, world: Floats) -> None:
        shape = np.array([len(self._elements), len(times)], np.int64)
        arrays = (shape, times, world, self._room)
        driver()[0](self._records.address, *(a.ctypes.data for a in arrays))
        if not np.isfinite(world).all():
            self._mend(times, world)

    def _mend(self, times: Floats, world: Floats) -> None:
        """Do again, under CPython, the evaluations that read or made a number which is not finite."""
        bad = ~np.isfinite(world)
        again = []
        for section in self._sections:
            touched = bad[section.reads].any(axis=1) | bad[section.sets].any(axis=1)
            for row, moment in zip(*(a.tolist() for a in np.nonzero(touched)), strict=True):
                again.append((int(section.numbers[row]), moment, section, row))
        for number, moment, section, row in sorted(again, key=lambda item: item[:2]):
            kind, function = section.task.kind, section.task.function
            given = [_NAN] * (len(kind.states) + kind.inputs)
            for k, place in zip(section.task.reads, section.reads[row].tolist(), strict=True):
                given[k] = float(world[place, moment])
            x, u = given[: len(kind.states)], given[len(kind.states) :]
            y = [_NAN] * (section.task.size - len(given))
            p = self._system.values[int(self._elements[number])]
            call(function, float(times[moment]), x, u, NO_DISCRETE, p, y)
            world[section.sets[row], moment] = [y[k] for k in section.task.sets]
