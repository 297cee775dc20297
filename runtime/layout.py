"""Where the memory of each group lies: worked out once for a plan and its methods, filled in anew for each run.

All groups' states stand in one array, all their values in another, and so on; a group's record holds addresses into them. So a run of ten
thousand groups is set up by a few operations on whole arrays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import records
from hierc.runtime.contract import Plan
from hierc.runtime.machine.dialect import RecordArray, aligned
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.machine.program import Program
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.segments import HEADER

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Doubles in a line of the processor's cache: what each group's part of an array is rounded up to.
_LINE = 8


class Layout:
    """Group records with everything that no run changes; where a run's own numbers go.

    `records` holds byte offsets in place of addresses. `states`, `values` and `scales` say where in the arrays `x`, `p` and `absolute` the state
    vector, the nodes' values laid end to end (`value_nodes`), and the states' error scales go. `strides` counts the doubles of each group's segments.
    """

    def __init__(
        self, plan: Plan, wiring: Sequence[Wiring], methods: Sequence[str], program: Program
    ) -> None:
        self.records = RecordArray(records.Group, len(wiring))
        self.value_nodes = [node for w in wiring for node in w.values]
        forms = [w.form for w in wiring]
        chosen = [METHODS[m] for m in methods]
        pieces = [program.pieces[form, m] for form, m in zip(forms, methods, strict=True)]
        states = np.array([form.states for form in forms], np.int64)
        values = np.array(
            [sum(plan.classes[plan.nodes[n].kind].values for n in w.values) for w in wiring], np.int64
        )
        lengths = {
            "x": 2 * states,
            "p": values,
            "absolute": states,
            "u": np.array([f.inputs * m.input_rows for f, m in zip(forms, chosen, strict=True)], np.int64),
            "work": np.array([p.work for p in pieces], np.int64),
        }
        self.sizes: dict[str, int] = {}
        offsets = {name: self._place(name, length) for name, length in lengths.items()}
        self.states = _spread(offsets["x"], states)
        self.values = _spread(offsets["p"], values)
        self.scales = _spread(offsets["absolute"], states)
        self.group_of_state = np.repeat(np.arange(len(wiring)), states)
        channels = np.array([form.states + len(form.published) for form in forms], np.int64)
        widths = np.array([m.width for m in chosen], np.int64)
        self.strides = HEADER + channels * widths
        self._read(wiring, widths)
        facts: dict[str, Sequence[float] | Integers] = {
            "n": states,
            "stride": self.strides,
            "width": widths,
            "contraction": [1.0] * len(forms),
            "inputs": [f.inputs for f in forms],
            "published": [len(f.published) for f in forms],
            "degree": [m.degree for m in chosen],
            "order": [m.error_order for m in chosen],
            "newton_tolerance": [m.newton_tolerance for m in chosen],
            "linear": [int(p.linear) for p in pieces],
            "step": [program.steps[m] for m in methods],
        }
        for name, fact in facts.items():
            self.records[name][: len(forms)] = fact
        for g, made in enumerate(pieces):
            for name, address in made.addresses.items():
                self.records[name][g] = address

    def _place(self, name: str, lengths: Integers) -> Integers:
        """Offsets, in doubles, of the groups' parts of one array; the records get them in bytes."""
        padded = -(-lengths // _LINE) * _LINE
        ends = np.cumsum(padded)
        offsets: Integers = ends - padded
        self.sizes[name] = int(ends[-1]) if len(ends) else 0
        self.records[name][: len(offsets)] = 8 * offsets
        return offsets

    def _read(self, wiring: Sequence[Wiring], widths: Integers) -> None:
        """Runs of inputs that come from one group, and each input's place in the segments it is read from."""
        runs: list[tuple[int, int, int]] = []
        places: list[int] = []
        for g, w in enumerate(wiring):
            owners = [owner for owner, _ in w.channels]
            self.records["channels"][g] = 8 * len(places)
            self.records["sources"][g] = 8 * len(records.Source.fields()) * len(runs)
            distinct = dict.fromkeys(owners)
            self.records["source_count"][g] = len(distinct)
            runs += [(owner, owners.index(owner), owners.count(owner)) for owner in distinct]
            places += [HEADER + channel * int(widths[owner]) for owner, channel in w.channels]
        self.sources = RecordArray(records.Source, len(runs))
        for name, column in zip(("group", "first", "count"), zip(*runs, strict=True), strict=False):
            self.sources[name][: len(runs)] = column
        self.places = np.array(places or [0], np.int64)


class Memory:
    """One run's memory: the records, with addresses, and the arrays they point to."""

    def __init__(self, layout: Layout) -> None:
        self.groups = layout.records.copy()
        self.sources = layout.sources.copy()
        self.arrays: dict[str, Floats] = {name: aligned(max(size, 1)) for name, size in layout.sizes.items()}
        addresses = {name: array.ctypes.data for name, array in self.arrays.items()}
        addresses["channels"] = layout.places.ctypes.data
        addresses["sources"] = self.sources.address
        for name, address in addresses.items():
            self.groups[name][:] += address


def _spread(offsets: Integers, lengths: Integers) -> Integers:
    """Positions offset, offset + 1, … of each group's numbers, all groups in a row."""
    starts = np.cumsum(lengths) - lengths
    positions: Integers = np.repeat(offsets - starts, lengths) + np.arange(int(lengths.sum()))
    return positions
