"""One run: sets up the kernel's memory, lets it work in short calls, and gathers what it leaves.

Between calls, each at most a few hundredths of a second, Python sees progress, interrupts and limits, and gives room to groups that need it.
"""

from __future__ import annotations

import ctypes
import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import choice, records
from hierc.runtime.columns import distinct, median
from hierc.runtime.elements import Elements
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.externs import Watch
from hierc.runtime.layout import Memory
from hierc.runtime.machine import callees
from hierc.runtime.machine.calls import CallForm
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.machine.forms import Wiring
from hierc.runtime.machine.program import Announce, Pieces
from hierc.runtime.machine.timing import PARTS
from hierc.runtime.pace import Pace
from hierc.runtime.status import Status
from hierc.runtime.switching import Reviews
from hierc.runtime.system import System
from hierc.runtime.track import Tracks
from hierc.runtime.trajectory import Trajectories
from hierc.runtime.wavefront import Wavefront

if TYPE_CHECKING:
    from hierc.runtime.run import Engine

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
#: A failure is blamed on the first element of a group that moves this part as fast as the fastest one.
_BLAMED = 0.1
#: Bytes of segments beyond which a run is stopped.
_MOST_BYTES = 4 << 30


@dataclass(frozen=True, slots=True)
class GroupSettings:
    """Numerical settings of a group, all decided."""

    method: str
    rtol: float
    atol: float
    max_step: float
    min_step: float
    free: bool = False  # whether the method was left to us, and may change


def of_group(settings: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The settings for all with those that a group has of its own, whose rtol is its atol too, unless it has one."""
    return {**settings, **({"atol": own["rtol"]} if "rtol" in own else {}), **own}


@dataclass(frozen=True)
class Settings:
    """Those of all groups: the distinct ones, and which each group has, by place."""

    distinct: tuple[GroupSettings, ...]
    of: Integers

    def __getitem__(self, place: int) -> GroupSettings:
        """The settings of one group."""
        return self.distinct[int(self.of[place])]

    @cached_property
    def numbers(self) -> Floats:
        """rtol, atol, max_step, min_step of each group: (4, groups)."""
        rows = [(s.rtol, s.atol, s.max_step, s.min_step) for s in self.distinct]
        return np.array(rows, np.float64).reshape(-1, 4).T[:, self.of]

    @property
    def tried(self) -> Settings:
        """The same, with the favourite method where the choice is left to us."""
        methods = (choice.FAVOURITE if s.method == choice.AUTO else s.method for s in self.distinct)
        distinct = tuple(replace(s, method=m) for s, m in zip(self.distinct, methods, strict=True))
        return Settings(distinct, self.of)

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """The method of each group."""
        names = [s.method for s in self.distinct]
        return tuple([names[k] for k in self.of.tolist()])


class Simulation:
    """A run under way, from the states `initial` (n,) on. `groups` and `run` are the kernel's memory; arrays they point to are kept here."""

    def __init__(
        self,
        engine: Engine,
        system: System,
        settings: Settings,
        initial: Floats,
        start: float,
        stop: float,
        announce: Announce | None = None,
    ) -> None:
        self.engine, self.system, self.wiring, self.settings = engine, system, engine.wiring, settings
        self.start, self.stop = start, stop
        self.elements: Elements = engine.elements
        self.program = engine.program(settings.methods, announce)
        self.layout = engine.layout(settings.methods)
        self.memory = Memory(self.layout)
        self.groups = self.memory.groups
        self.initial = initial
        self._fill(self.memory.block)
        count = self.elements.groups
        self.tracks = Tracks(self.layout.rooms)
        self.groups["track"][:count] = self.tracks.addresses
        #: Ticks and calls of each part of each group's steps, where the engine has timers.
        self.clocks: Integers | None = np.zeros((count, len(PARTS), 2), np.int64) if engine.timed else None
        if self.clocks is not None:
            each = self.clocks.strides[0] * np.arange(count)
            self.groups["clocks"][:count] = self.clocks.ctypes.data + each
        self.run = RecordArray(records.Run, 1)
        self.run["stop"][0], self.run["groups"][0] = stop, count
        # The first window lets every group take one step; later ones count steps.
        self.run["window"][0] = np.nextafter(start, stop)
        prototype = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
        self._advance: Callable[[int, int], float] = prototype(self.program.advance)
        self._reviews = Reviews(settings.methods)
        self._pace = Pace()
        #: The step under way when an extern failed: its group, where that group stood, how many segments it had.
        self._abandoned = (0, start, 0)
        self._failed: ExternError | None = None

    def _fill(self, block: Floats) -> None:
        """Put the run's own numbers in their places."""
        layout, groups, count = self.layout, self.groups, self.elements.groups
        block[layout.states] = self.initial
        block[layout.values] = self.system.all_values[layout.wanted]
        nominal = self.system.nominal
        if not (nominal > 0.0).all():
            name, place = self.system.state_at(int(np.argmin(nominal > 0.0)))
            raise SettingError(f"the `nominal` of `{name}` ({place}) must be positive")
        rtol, atol, groups["max_step"][:count], groups["min_step"][:count] = self.settings.numbers
        block[layout.scales] = atol[layout.group_of_state] * nominal
        groups["t"][:], groups["stop"][:] = self.start, self.stop
        groups["rtol"][:count], groups["floor"][:count] = rtol, atol
        watched = [s.free and s.method in choice.EXPLICIT for s in self.settings.distinct]
        groups["watched"][:count] = np.array(watched, np.int64)[self.settings.of]

    def advance(
        self,
        progress: Callable[[float], None] | None = None,
        most_steps: int | None = None,
        threads: int = 1,
    ) -> Status:
        """Go on until the stop, a failure, or Ctrl-C. Returns how it ended. Functions that are called in Python have one thread only."""
        if most_steps is not None:
            self.groups["most_steps"][:] = most_steps
        if threads > 1 and not self.program.links.called_back:
            with Wavefront(self.memory, self.elements.groups, self.run, self._advance, threads) as wavefront:
                return self._go_on(wavefront.attempt, progress)
        return self._go_on(self._slice, progress)

    def _go_on(self, attempt: Callable[[], float], progress: Callable[[float], None] | None) -> Status:
        try:
            if self._failed is not None:  # when the run was tried out
                raise self._failed
            while True:
                outcome = attempt()
                if outcome == records.DONE:
                    return Status("DONE", f"reached {self.stop:g} s")
                if outcome == records.FULL:
                    if not self._grow(int(self.run["group"][0])):
                        return Status(
                            "OUT_OF_MEMORY",
                            "the trajectory needs more memory than a run may use; stop earlier or loosen rtol",
                        )
                elif outcome == records.REVIEW:
                    self._reviews.review(self, int(self.run["group"][0]))
                elif outcome != records.PAUSED and not self._withdraws(outcome):
                    return self._failure(self._caught_up(outcome))
                if progress is not None:
                    progress(float(self.groups["t"].min()))
        except ExternError as error:
            status = Status("EXTERN_FAILED", f"just after t = {self._abandoned[1]:.9g} s {error}")
            self._caught_up(records.NOT_FINITE)
            return status
        except KeyboardInterrupt:
            return Status("INTERRUPTED", f"interrupted at {self.reached:.6g} s")

    def _withdraws(self, outcome: float) -> bool:
        """Whether the group that cannot go on only tried its method: it goes on with the one before."""
        failed = outcome in (records.TOO_SMALL, records.NOT_FINITE)
        return failed and self._reviews.withdraw(self, int(self.run["group"][0]))

    def _caught_up(self, outcome: float) -> float:
        """Bring the other groups to where the failed one stands, so that all that can be known is kept.

        One that fails on the way sets the mark lower. It is the one that failed, too, unless it reads the other; returned is the outcome of the one
        that did, whose number is then in `run`.
        """
        failed = int(self.run["group"][0])
        found = outcome
        self.groups["review"][:], self.groups["watched"][:] = np.iinfo(np.int64).max, 0
        with suppress(ExternError):
            while outcome not in (records.DONE, records.PAUSED, records.FULL):
                latest = int(self.run["group"][0])
                if not self._reads(latest, failed):
                    failed, found = latest, outcome
                mark = self.groups["t"][latest]
                self.groups["stop"][:] = mark
                self.run["stop"][0], self.run["window"][0], self.run["group"][0] = mark, mark, 0
                outcome = self._slice()
                while outcome == records.PAUSED or (
                    outcome == records.FULL and self._grow(int(self.run["group"][0]))
                ):
                    outcome = self._slice()
        self.run["group"][0] = failed
        return found

    def _reads(self, reader: int, other: int) -> bool:
        """Whether a group reads another one, itself or through others."""
        owners, counts = self.memory.sources["group"], self.groups["source_count"]
        firsts = np.cumsum(counts) - counts
        known, new = {reader}, [reader]
        while new:
            g = new.pop()
            above = set(owners[firsts[g] : firsts[g] + counts[g]].tolist()) - known
            known |= above
            new += above
        return other in known - {reader}

    def attempt(self, steps: int) -> float:
        """Let the kernel make so many step attempts; returns its outcome. What it does depends on nothing but their number.

        Raises ExternError, with the step under way undone, where an extern that is called back fails.
        """
        self.run["budget"][0] = steps
        if not self.program.links.called_back:
            return self._advance(self.run.address, self.groups.address)
        try:
            with Watch(self._abandon).over():
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
        outcome = self.attempt(self._pace.budget)
        if outcome == records.PAUSED:
            self._pace.learn(time.perf_counter() - began)
        return outcome

    def _grow(self, g: int) -> bool:
        """Twice the room for a group's segments; False where that is too much."""
        if self.tracks.bytes + self.tracks.array(g).nbytes > _MOST_BYTES:
            return False
        self.tracks.grow(g)
        self.groups["track"][g] = self.tracks.addresses[g]
        self.groups["capacity"][g] *= 2
        return True

    @property
    def reached(self) -> float:
        """The last time up to which all groups are known (all of it where there is nothing to integrate)."""
        count = self.elements.groups
        return float(self.groups["t"][:count].min()) if count else self.stop

    def trajectories(self) -> Trajectories:
        """The segments of all groups so far."""
        methods, last = self._reviews.methods, self.groups.copy()
        return Trajectories(self.elements, self.initial, self.program, self.tracks, methods, last)

    def learn(self, cohorts: Iterable[tuple[Wiring, Integers]]) -> list[list[choice.Probe]]:
        """What the steps so far tell of some groups of each wiring."""
        trajectories = self.trajectories()
        return [[self._probe(w, g, trajectories) for g in places.tolist()] for w, places in cohorts]

    def _probe(self, wiring: Wiring, g: int, trajectories: Trajectories) -> choice.Probe:
        sizes = trajectories.table(g)[:, 3]
        step = median(sizes[len(sizes) // 2 :]) if len(sizes) else self.stop - self.start
        return self.probe(wiring, g, step, self.program.pieces[wiring.form, self.settings[g].method])

    def probe(self, wiring: Wiring, g: int, step: float, pieces: Pieces) -> choice.Probe:
        """What decides about a group's method, of its typical step under these pieces."""
        classes = self.elements.plan.classes
        return choice.Probe(
            step=step,
            spectral_radius=functools.partial(self._spectral_radius, g),
            states=wiring.form.states,
            flops=sum(classes[c.kind].flops for c in wiring.form.calls if c.part < 0),
            updates=pieces.updates,
            entries=pieces.entries,
            linear=pieces.linear,
            tolerance=self.settings[g].rtol,
            calls=self._calls_of_python(wiring.form.calls),
        )

    def _calls_of_python(self, calls: Sequence[CallForm]) -> int:
        """How many functions are called in Python where these calls are made once."""
        if not self.program.links.called_back:
            return 0
        kinds = [(self.elements.plan.classes[c.kind], c.part) for c in calls]
        made = (kind.rhs if part < 0 else kind.parts[part].function for kind, part in kinds)
        return sum(callees.calls_of_python(function) for function in made)

    def _spectral_radius(self, g: int) -> float:
        """Largest |eigenvalue| of a group's Jacobian at the start and now."""
        nodes = self.elements.nodes_of(g)
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
        if self.elements.plan.externs:  # one that is compiled in has no exceptions: plain Python has them
            self._abandoned = (g, t, int(self.groups["count"][g]))
            self.system.jacobian_of(self.elements.nodes_of(g), t, self._states_at(t, g))
        if not self.elements.group_states[g]:
            return self._failure_of_channel(g, outcome, t)
        state, place, finite = self._culprit(g)
        where = f"group `{self.elements.group_name(g)}`, state `{state}`" + (f" ({place})" if place else "")
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

    def _failure_of_channel(self, g: int, outcome: float, t: float) -> Status:
        """Why a group without states could not go on."""
        name, least = self.elements.group_name(g), self.settings[g].min_step
        if outcome == records.NOT_FINITE:
            return Status("NOT_FINITE", f"`{name}` is not a number just after t = {t:.9g} s")
        return Status(
            "STEP_TOO_SMALL",
            f"at t = {t:.9g} s group `{name}` needs a step smaller than its `min_step` of {least:g} s",
        )

    def _too_many(self, g: int, most: int) -> Status:
        name = self.elements.group_name(g)
        t = float(self.groups["t"][g])
        return Status("TOO_MANY_STEPS", f"group `{name}` took {most} steps and is only at t = {t:.6g} s")

    def _culprit(self, g: int) -> tuple[str, str, bool]:
        """Name and place of the state that failed, and whether it is finite there: the first whose derivative is not.

        Else the largest relative derivative of the first element that comes near the largest of all: what reads that one may move even faster.
        """
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
        speeds = np.abs(dx[own]) / (1.0 + np.abs(x[own]))
        offsets = self.elements.offsets[self.elements.nodes_of(g)] - own.start
        firsts = distinct(offsets[offsets < len(speeds)])
        fastest = np.maximum.reduceat(speeds, firsts)
        k = int(firsts[np.argmax(fastest >= _BLAMED * fastest.max())])
        last = int(np.append(firsts, len(speeds))[np.searchsorted(firsts, k, "right")])
        return *self.system.state_at(own.start + k + int(np.argmax(speeds[k:last]))), True

    def _slice_of(self, g: int) -> slice:
        """Where a group's states stand in the state vector."""
        first, last = self.elements.group_offsets[g : g + 2].tolist()
        return slice(first, last)

    def _states_at(self, t: float, g: int) -> Floats:
        """All states at the time of group g; later groups as far as they are known."""
        x = self.memory.block[self.layout.states]
        ahead = (self.groups["t"] > t)[self.layout.group_of_state]
        ahead[self._slice_of(g)] = False
        if ahead.any():
            positions = np.flatnonzero(ahead)
            x[positions] = self.trajectories().states(positions, np.array([t]))[0]
        return x


def tighten(
    elements: Elements, wiring: Sequence[Wiring], per_edge: float, floor: float
) -> tuple[list[float], Integers]:
    """Factors on the tolerances, `per_edge` for each reading edge to the furthest reader, at least `floor`; which of them each group has.

    A group without states only passes on what it reads: the edges to and from it count as one.
    """
    factors = [1.0]
    while factors[-1] > floor:
        factors.append(max(per_edge ** len(factors), floor))
    depth = np.zeros(elements.groups, np.int64)
    settled = False
    while not settled:
        before = depth.copy()
        for w in wiring:
            further = np.minimum(depth[w.places] + (w.form.states > 0), len(factors) - 1)
            np.maximum.at(depth, w.owners, np.broadcast_to(further[:, None], w.owners.shape))
        settled = bool((depth == before).all())
    return factors, depth
