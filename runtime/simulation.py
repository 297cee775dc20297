"""One run: sets up the kernel's memory, lets it work in short calls, and gathers what it leaves.

Between calls, each at most a few hundredths of a second, Python sees progress, interrupts and limits, and gives room to groups that need it.
"""

from __future__ import annotations

import ctypes
import functools
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice, records
from hierc.runtime.contract import Plan
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.externs import Watch
from hierc.runtime.layout import Memory
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.machine.program import Announce
from hierc.runtime.methods.catalogue import METHODS
from hierc.runtime.status import Status
from hierc.runtime.system import System
from hierc.runtime.track import Track
from hierc.runtime.trajectory import GroupTrajectory

if TYPE_CHECKING:
    from hierc.runtime.run import Engine

Floats = NDArray[np.float64]
#: What one call of the kernel should take, s.
_SLICE = 0.02
#: Segments a group has room for at first.
_ROOM = 256
#: Bytes of segments beyond which a run is stopped.
_MOST_BYTES = 4 << 30
_COUNTERS = ("steps", "rejected", "evaluations", "iterations", "jacobians", "factorizations", "failures")


@dataclass(frozen=True, slots=True)
class GroupSettings:
    """Numerical settings of one group, all decided."""

    method: str
    rtol: float
    atol: float
    max_step: float
    min_step: float


class Simulation:
    """A run under way. `groups` and `run` are the kernel's memory; arrays they point to are kept here."""

    def __init__(
        self,
        engine: Engine,
        system: System,
        settings: Sequence[GroupSettings],
        start: float,
        stop: float,
        announce: Announce | None = None,
    ) -> None:
        self.system, self.wiring, self.settings = system, engine.wiring, settings
        self.start, self.stop = start, stop
        self.plan: Plan = system.plan
        methods = [s.method for s in settings]
        self.program = engine.program(methods, announce)
        self.layout = engine.layout(methods)
        self.memory = Memory(self.layout)
        self.groups = self.memory.groups
        self.initial = system.initial(start)
        self._fill(self.memory.arrays)
        self.tracks = [Track(_ROOM * int(stride)) for stride in self.layout.strides]
        self.groups["track"][: len(settings)] = [track.address for track in self.tracks]
        self.run = RecordArray(records.Run, 1)
        self.run["stop"][0], self.run["groups"][0] = stop, len(settings)
        # The first window lets every group take one step; later ones count steps.
        self.run["window"][0] = np.nextafter(start, stop)
        prototype = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
        self._advance: Callable[[int, int], float] = prototype(self.program.advance)
        self._budget = 64
        self._watch = Watch(self._abandon)
        #: The step under way when an extern failed: its group, where that group stood, how many segments it had.
        self._abandoned = (0, start, 0)
        self._failed: ExternError | None = None

    def _fill(self, arrays: dict[str, Floats]) -> None:
        """Put the run's own numbers in their places."""
        layout, groups, count = self.layout, self.groups, len(self.settings)
        arrays["x"][layout.states] = self.initial
        arrays["p"][layout.values] = [v for node in layout.value_nodes for v in self.system.values[node]]
        nominal = np.array([w for node in self.system.order for w in self.system.nominal(node)])
        if not (nominal > 0.0).all():
            name, place = self.system.state_at(int(np.argmin(nominal > 0.0)))
            raise SettingError(f"the `nominal` of `{name}` ({place}) must be positive")
        atol = np.array([s.atol for s in self.settings])
        arrays["absolute"][layout.scales] = atol[layout.group_of_state] * nominal
        groups["most_steps"][:] = np.iinfo(np.int64).max
        groups["t"][:], groups["stop"][:], groups["capacity"][:] = self.start, self.stop, _ROOM
        groups["floor"][:count] = atol
        groups["rtol"][:count] = [s.rtol for s in self.settings]
        groups["max_step"][:count] = [s.max_step for s in self.settings]
        groups["min_step"][:count] = [s.min_step for s in self.settings]

    def advance(
        self, progress: Callable[[float], None] | None = None, most_steps: int | None = None
    ) -> Status:
        """Go on until the stop, a failure, or Ctrl-C. Returns how it ended."""
        if most_steps is not None:
            self.groups["most_steps"][:] = most_steps
        try:
            if self._failed is not None:  # when the run was tried out
                raise self._failed
            while True:
                outcome = self._slice()
                if outcome == records.DONE:
                    return Status("DONE", f"reached {self.stop:g} s")
                if outcome == records.FULL:
                    if not self._grow(int(self.run["group"][0])):
                        return Status(
                            "OUT_OF_MEMORY",
                            "the trajectory needs more memory than a run may use; stop earlier or loosen rtol",
                        )
                elif outcome != records.PAUSED:
                    status = self._failure(outcome)
                    self._catch_up()
                    return status
                if progress is not None:
                    progress(float(self.groups["t"].min()))
        except ExternError as error:
            status = Status("EXTERN_FAILED", f"just after t = {self._abandoned[1]:.9g} s {error}")
            self._catch_up()
            return status
        except KeyboardInterrupt:
            return Status("INTERRUPTED", f"interrupted at {self.reached:.6g} s")

    def _catch_up(self) -> None:
        """Bring the other groups to where the failed one stands, so that all that can be known is kept. One that fails on the way sets the mark lower."""
        outcome = records.NOT_FINITE
        with suppress(ExternError):
            while outcome not in (records.DONE, records.PAUSED, records.FULL):
                mark = self.groups["t"][int(self.run["group"][0])]
                self.groups["stop"][:] = mark
                self.run["stop"][0], self.run["window"][0], self.run["group"][0] = mark, mark, 0
                outcome = self._slice()
                while outcome == records.PAUSED or (
                    outcome == records.FULL and self._grow(int(self.run["group"][0]))
                ):
                    outcome = self._slice()

    def attempt(self, steps: int) -> float:
        """Let the kernel make so many step attempts; returns its outcome. What it does depends on nothing but their number.

        Raises ExternError, with the step under way undone, where an extern that is called back fails.
        """
        self.run["budget"][0] = steps
        if not self.program.links.called_back:
            return self._advance(self.run.address, self.groups.address)
        try:
            with self._watch.over():
                return self._advance(self.run.address, self.groups.address)
        except (ExternError, KeyboardInterrupt) as error:
            g, t, count = self._abandoned
            self.groups["t"][g], self.groups["count"][g], self.run["group"][0] = t, count, g
            self._failed = error if isinstance(error, ExternError) else None
            raise

    def _abandon(self) -> None:
        """An extern failed: the kernel is to return after the step under way."""
        g = int(self.run["group"][0])
        self._abandoned = (g, float(self.groups["t"][g]), int(self.groups["count"][g]))
        self.run["budget"][0] = 0

    def _slice(self) -> float:
        """One call of the kernel, its budget adapted to the time calls take."""
        began = time.perf_counter()
        outcome = self.attempt(self._budget)
        spent = time.perf_counter() - began
        if outcome == records.PAUSED:
            self._budget = int(min(max(self._budget * _SLICE / max(spent, 1e-6), 16), self._budget * 8))
        return outcome

    def _grow(self, g: int) -> bool:
        """Twice the room for a group's segments; False where that is too much."""
        track = self.tracks[g]
        if sum(t.array.nbytes for t in self.tracks) + track.array.nbytes > _MOST_BYTES:
            return False
        track.grow(2 * len(track.array))
        self.groups["track"][g] = track.address
        self.groups["capacity"][g] *= 2
        return True

    @property
    def reached(self) -> float:
        """The last time up to which all groups are known (all of it where there is nothing to integrate)."""
        return float(self.groups["t"][: len(self.wiring)].min()) if self.wiring else self.stop

    def trajectories(self) -> tuple[GroupTrajectory, ...]:
        """The segments of all groups so far."""
        result = []
        first = 0
        for g, wiring in enumerate(self.wiring):
            n, method = wiring.form.states, METHODS[self.settings[g].method]
            count, stride = int(self.groups["count"][g]), int(self.groups["stride"][g])
            table = self.tracks[g].array[: count * stride].reshape(count, stride)
            stats = {name: int(self.groups[name][g]) for name in _COUNTERS}
            result.append(
                GroupTrajectory(
                    name=self.plan.groups[g].name,
                    method=method.name,
                    degree=method.degree,
                    width=method.width,
                    table=table,
                    reached=float(self.groups["t"][g]),
                    initial=self.initial[first : first + n],
                    stats=stats,
                    program=self.program,
                )
            )
            first += n
        return tuple(result)

    def learn(self) -> list[choice.Probe]:
        """What the steps so far tell of each group."""
        trajectories = self.trajectories()
        probes = []
        for g, (trajectory, wiring) in enumerate(zip(trajectories, self.wiring, strict=True)):
            sizes = np.diff(trajectory.knots)
            pieces = self.program.pieces[wiring.form, self.settings[g].method]
            probes.append(
                choice.Probe(
                    step=float(np.median(sizes[len(sizes) // 2 :])) if len(sizes) else self.stop - self.start,
                    spectral_radius=functools.partial(self._spectral_radius, g),
                    states=wiring.form.states,
                    flops=sum(self.plan.classes[c.kind].flops for c in wiring.form.calls if c.part < 0),
                    updates=pieces.updates,
                    entries=pieces.entries,
                    linear=pieces.linear,
                    tolerance=self.settings[g].rtol,
                )
            )
        return probes

    def _spectral_radius(self, g: int) -> float:
        """Largest |eigenvalue| of a group's Jacobian at the start and now."""
        nodes = self.plan.groups[g].nodes
        times = (self.start, self.reached)
        return choice.spectral_radius(
            [self.system.jacobian_of(nodes, t, self._states_at(t, g)) for t in times]
        )

    # ---- failures -------------------------------------------------------------------------------

    def _failure(self, outcome: float) -> Status:
        g = int(self.run["group"][0])
        if outcome == records.TOO_MANY:
            return self._too_many(g, int(self.groups["most_steps"][g]))
        t, h = float(self.groups["t"][g]), float(self.groups["trial"][g])
        if self.plan.externs:  # one that is compiled in has no exceptions: plain Python has them
            self._abandoned = (g, t, int(self.groups["count"][g]))
            self.system.jacobian_of(self.plan.groups[g].nodes, t, self._states_at(t, g))
        state, place, finite = self._culprit(g)
        where = f"group `{self.plan.groups[g].name}`, state `{state}`" + (f" ({place})" if place else "")
        if not finite:
            return Status(
                "NOT_FINITE",
                f"the derivative of `{state}` is not a number just after t = {t:.9g} s ({where})",
            )
        least = self.settings[g].min_step
        if h <= least:
            return Status(
                "STEP_TOO_SMALL",
                f"at t = {t:.9g} s {where} needs a step smaller than its `min_step` of {least:g} s",
            )
        return Status(
            "STEP_TOO_SMALL",
            f"at t = {t:.9g} s the step of {where} had to become smaller than {h:.3g} s: "
            "its derivative jumps or grows without bound there",
        )

    def _too_many(self, g: int, most: int) -> Status:
        name = self.plan.groups[g].name
        t = float(self.groups["t"][g])
        return Status("TOO_MANY_STEPS", f"group `{name}` took {most} steps and is only at t = {t:.6g} s")

    def _culprit(self, g: int) -> tuple[str, str, bool]:
        """Name and place of the state that failed: one whose derivative is not finite there, else the largest relative derivative."""
        t = float(self.groups["t"][g])
        x = self._states_at(t, g)
        own = self._slice_of(g)
        dx = self.system.rhs(t, x)
        ahead = 1e-6 * (float(self.run["stop"][0]) - self.start)
        later = x.copy()
        later[own] += ahead * np.nan_to_num(dx[own])
        for state, slope in ((x, dx), (later, self.system.rhs(t + ahead, later))):
            bad = ~np.isfinite(slope[own]) | ~np.isfinite(state[own])
            if bad.any():
                return *self.system.state_at(own.start + int(np.argmax(bad))), False
        k = int(np.argmax(np.abs(dx[own]) / (1.0 + np.abs(x[own]))))
        return *self.system.state_at(own.start + k), True

    def _slice_of(self, g: int) -> slice:
        """Where a group's states stand in the state vector."""
        first = sum(w.form.states for w in self.wiring[:g])
        return slice(first, first + self.wiring[g].form.states)

    def _states_at(self, t: float, g: int) -> Floats:
        """All states at the time of group g; later groups as far as they are known."""
        parts = [np.asarray(tr(np.array([min(t, tr.knots[-1])])))[0] for tr in self.trajectories()]
        x = np.concatenate(parts)
        own = self._slice_of(g)
        current = (ctypes.c_double * (own.stop - own.start)).from_address(int(self.groups["x"][g]))
        x[own] = np.ctypeslib.as_array(current)
        return x


def tighten(plan: Plan, wiring: Sequence[Wiring], per_edge: float, floor: float) -> list[float]:
    """Factors on the tolerances: `per_edge` for each reading edge to the furthest reader, at least `floor`."""
    depth = [0] * len(wiring)
    for g in reversed(range(len(wiring))):
        for upstream, _ in wiring[g].channels:
            depth[upstream] = max(depth[upstream], depth[g] + 1)
    return [max(per_edge**d, floor) for d in depth]
