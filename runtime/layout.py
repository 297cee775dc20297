"""Where the memory of each group lies: worked out once for a plan and its methods, filled in anew for each run.

All groups' states stand side by side, then all their values, and so on, in one block of memory; a group's record holds addresses into it. So a run of
ten thousand groups is set up by a few operations on whole arrays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import records
from hierc.runtime.columns import distinct
from hierc.runtime.elements import Elements, spread
from hierc.runtime.machine.calls import Form
from hierc.runtime.machine.dialect import RecordArray, aligned
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.machine.program import Pieces, Program
from hierc.runtime.methods.catalogue import every_method
from hierc.runtime.methods.method import Method
from hierc.runtime.segments import HEADER

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Doubles in a line of the processor's cache: what each group's part of an array is rounded up to.
_LINE = 8
#: Segments a group has room for at first; fewer, but not below the least, where all groups' would take more than so many bytes.
_ROOM, _LEAST_ROOM, _FIRST_BYTES = 256, 16, 256 << 20
#: Parts of the block that the groups' records point into, by fields side by side.
_ARRAYS = ("x", "p", "absolute", "u", "work")
_POINTERS = slice(records.Group.numbers()["x"], records.Group.numbers()["work"] + 1)


def facts(form: Form, method: Method, program: Program, made: Pieces) -> dict[str, float]:
    """What the records of groups of one form and method hold, by field."""
    return {
        "n": form.states,
        "stride": HEADER + (form.states + len(form.published)) * method.width,
        "width": method.width,
        "contraction": 1.0,
        "inputs": form.inputs,
        "published": len(form.published),
        "degree": method.degree,
        "order": method.error_order,
        "newton_tolerance": method.newton_tolerance,
        "linear": int(made.linear),
        "step": program.steps[method.name],
        **made.addresses,
    }


def cohorts(wiring: Sequence[Wiring], labels: Integers) -> list[tuple[int, int, Integers]]:
    """The groups that share a wiring and a label (label[place]): (number of the wiring, label, their rows in it)."""
    found = []
    for number, w in enumerate(wiring):
        own = labels[w.places]
        found += [(number, int(label), np.flatnonzero(own == label)) for label in distinct(own)]
    return found


class Layout:
    """Group records with everything that no run changes; where a run's own numbers go.

    `records` holds byte offsets in place of addresses. `states`, `values` and `scales` say where in the block of `size` doubles the state vector, those of
    all values that are wanted (`wanted`), and the states' error scales go. For a group's segments there are `rooms` doubles at first. Groups of one form
    whose method keeps nothing between steps share one place to work.
    """

    def __init__(
        self, elements: Elements, wiring: Sequence[Wiring], methods: Sequence[str], program: Program
    ) -> None:
        """`methods`: one a place."""
        count = elements.groups
        self.records = RecordArray(records.Group, count)
        self.lengths = {name: np.zeros(count, np.int64) for name in _ARRAYS}
        known = list(every_method().values())
        codes = {method.name: k for k, method in enumerate(known)}
        chosen = cohorts(wiring, np.array([codes[m] for m in methods], np.int64))
        shared = np.full(count, -1, np.int64)
        for number, code, rows in chosen:
            method = known[code]
            w, places = wiring[number], wiring[number].places[rows]
            self._describe(elements, w, places, method, program, program.pieces[w.form, method.name])
            if not method.keeps_work:
                shared[places] = places[0]
        #: Whether a group shares its places to work, and how many doubles it needs there: of inputs, of workspace.
        self.shares = shared >= 0
        self.room = np.stack([self.lengths["u"], self.lengths["work"]])
        self.size = 0
        offsets = {name: self._place(name, shared) for name in _ARRAYS}
        self.states = spread(offsets["x"], elements.group_states)
        self.scales = spread(offsets["absolute"], elements.group_states)
        self.group_of_state = np.repeat(np.arange(count), elements.group_states)
        self.wanted, self.values = _values(elements, wiring, offsets["p"])
        self._read(wiring)
        strides = self.records["stride"][:count]
        room = min(max(_FIRST_BYTES // (8 * int(strides.sum()) or 1), _LEAST_ROOM), _ROOM)
        self.rooms: Integers = room * strides
        self.records["capacity"][:] = room
        self.records["most_steps"][:] = self.records["review"][:] = np.iinfo(np.int64).max

    def _describe(
        self, elements: Elements, w: Wiring, places: Integers, method: Method, program: Program, made: Pieces
    ) -> None:
        """What is equal in groups of one form and method."""
        form = w.form
        values = sum(elements.kind(int(e)).values for e in w.values[0])
        for name, fact in facts(form, method, program, made).items():
            self.records[name][places] = fact
        sizes = (2 * form.states, values, form.states, form.inputs * method.input_rows, made.work)
        for name, size in zip(_ARRAYS, sizes, strict=True):
            self.lengths[name][places] = size

    def _place(self, name: str, shared: Integers) -> Integers:
        """Offsets, in doubles, of the groups' parts of one array; the records get them in bytes."""
        padded = -(-self.lengths[name] // _LINE) * _LINE
        one = (shared >= 0) & (name in ("u", "work"))  # they use that of the first of them
        padded[one & (shared != np.arange(len(padded)))] = 0
        ends = self.size + np.cumsum(padded)
        offsets: Integers = ends - padded
        offsets[one] = offsets[shared[one]]
        self.size += int(padded.sum())
        self.records[name][: len(offsets)] = 8 * offsets
        return offsets

    def _read(self, wiring: Sequence[Wiring]) -> None:
        """Runs of inputs that come from one group, and each input's place in the segments it is read from."""
        inputs = _counts(wiring, [w.form.inputs for w in wiring])
        runs = _counts(wiring, [len(w.runs) for w in wiring])
        count = len(inputs)
        first_input, first_run = np.cumsum(inputs) - inputs, np.cumsum(runs) - runs
        self.records["sources"][:count] = 8 * len(records.Source.fields()) * first_run
        self.records["source_count"][:count] = runs
        self.sources = RecordArray(records.Source, int(runs.sum()))
        self.places = np.zeros(max(int(inputs.sum()), 1), np.int64)
        self.records["channels"][:count] = self.places.ctypes.data + 8 * first_input
        widths = self.records["width"]
        for w in wiring:
            into = first_input[w.places][:, None] + np.arange(w.form.inputs)
            self.places[into] = HEADER + w.channels * widths[w.owners]
            for k, (first, length) in enumerate(w.runs):
                at = first_run[w.places] + k
                self.sources["group"][at] = w.owners[:, first]
                self.sources["first"][at] = first
                self.sources["count"][at] = length


class Memory:
    """One run's memory: the records, with addresses, and what they point to beside the layout's own `places`."""

    def __init__(self, layout: Layout) -> None:
        self.groups = layout.records.copy()
        self.sources = layout.sources.copy()
        self.block: Floats = aligned(max(layout.size, 1))
        self.groups.memory[:, _POINTERS] += self.block.ctypes.data
        self.groups["sources"][:] += self.sources.address
        self._layout = layout
        self._rooms: list[Floats] = []

    def separate(self, first: int, last: int) -> None:
        """Let groups, from `first` to before `last`, that share their places to work share them with no others."""
        which = first + np.flatnonzero(self._layout.shares[first:last])
        inputs, work = self._layout.room[:, which].max(axis=1, initial=0)
        inputs = -(-inputs // _LINE) * _LINE
        room = aligned(int(inputs + work) + _LINE)
        self.groups["u"][which] = room.ctypes.data
        self.groups["work"][which] = room.ctypes.data + 8 * int(inputs)
        self._rooms.append(room)


def _counts(wiring: Sequence[Wiring], counts: Sequence[int]) -> Integers:
    """A number of each wiring, by place."""
    found = np.zeros(sum(len(w.places) for w in wiring), np.int64)
    for w, count in zip(wiring, counts, strict=True):
        found[w.places] = count
    return found


def _values(elements: Elements, wiring: Sequence[Wiring], offsets: Integers) -> tuple[Integers, Integers]:
    """Which of all elements' values, laid end to end, are wanted, and where in the array each of them goes."""
    lengths = np.array([elements.plan.classes[b.kind].values for b in elements.blocks] or [0], np.int64)
    lengths = lengths[elements.block]
    firsts = np.cumsum(lengths) - lengths
    wanted: list[Integers] = []
    places: list[Integers] = []
    for w in wiring:
        used = w.values.ravel()
        wanted.append(spread(firsts[used], lengths[used]))
        within = np.arange(int(lengths[w.values[0]].sum()))
        places.append((offsets[w.places][:, None] + within).ravel())
    none = np.zeros(0, np.int64)
    return np.concatenate([none, *wanted]), np.concatenate([none, *places])
