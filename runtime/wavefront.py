"""Several threads: blocks of consecutive groups, each a window of time behind the one before it.

In a cascade nothing flows back, so a block may work on one window while the block before it works on the next. What a group does depends on nothing but
what it reads, which is there or not yet; so neither threads nor windows change a bit of any result. A reader in another thread sees a step's end only
after its segment (`segments.finish`, `segments.covered`), and memory grows only while no thread runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager

import numpy as np

from hierc.runtime import records
from hierc.runtime.layout import Memory
from hierc.runtime.machine.dialect import RecordArray
from hierc.runtime.pace import Pace

#: Steps of the fastest group in the first window.
_FIRST_STEPS = 16.0
#: How many steps a block's work on a window should take: long beside waking a thread, short beside a run worth threads.
_FEW, _MANY = 4_000, 16_000
#: Cost of a step beside that of one of its states.
_STEP = 15.0


class Wavefront(AbstractContextManager["Wavefront"]):
    """The groups of a run under way, from where `run` stands on, in as many blocks as `threads`."""

    def __init__(
        self, memory: Memory, count: int, run: RecordArray, advance: Callable[[int, int], float], threads: int
    ) -> None:
        self._groups, self._count, self._run, self._advance = memory.groups, count, run, advance
        self._stop = float(run["stop"][0])
        self._bounds = _bounds(memory.groups, count, threads)
        blocks = len(self._bounds) - 1
        for b in range(1, blocks):
            memory.separate(*self._bounds[b : b + 2])
        self._runs = [RecordArray(records.Run, 1) for _ in range(blocks)]
        self._paces = [Pace() for _ in range(blocks)]
        self._ends = [float(run["window"][0])]
        self._length, self._steps = 0.0, 0  # of the last window, and all until it began
        self._done = [0] * blocks  # windows of each block
        for b in range(blocks):
            self._begin_window(b)
        self._pool = ThreadPoolExecutor(max(blocks - 1, 1), "hierc")

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def attempt(self) -> float:
        """Let every block that may go on make some step attempts; returns what the kernel would, the group concerned in `run`.

        Where several blocks have something to say, the first of them is heard, and the others say it again.
        """
        if self._done[0] == len(self._ends) and self._ends[-1] < self._stop:
            self._add_window()
        blocks = [b for b in range(len(self._runs)) if self._may_go_on(b)]
        others = [self._pool.submit(self._work, b) for b in blocks[1:]]
        try:
            outcomes = [self._work(blocks[0])]
        finally:  # Ctrl-C comes here; no thread may be left in the memory of a run that is over
            wait(others)
        outcomes += [other.result() for other in others]
        answer = records.PAUSED
        for b, outcome in reversed(list(zip(blocks, outcomes, strict=True))):
            if outcome == records.DONE:
                self._done[b] += 1
                self._begin_window(b)
            elif outcome != records.PAUSED:
                answer = outcome
                self._run["group"][0] = self._runs[b]["group"][0]
        finished = self._ends[-1] >= self._stop and self._done[-1] == len(self._ends)
        return records.DONE if finished and answer == records.PAUSED else answer

    def _may_go_on(self, b: int) -> bool:
        """Whether a block has a window to work on that the block before it has left."""
        return self._done[b] < (len(self._ends) if b == 0 else self._done[b - 1])

    def _work(self, b: int) -> float:
        self._runs[b]["budget"][0] = self._paces[b].budget
        began = time.perf_counter()
        outcome = self._advance(self._runs[b].address, self._groups.address)
        if outcome == records.PAUSED:
            self._paces[b].learn(time.perf_counter() - began)
        return outcome

    def _begin_window(self, b: int) -> None:
        run, number = self._runs[b], self._done[b]
        if number < len(self._ends):
            run["stop"][0] = run["window"][0] = self._ends[number]
            run["group"][0], run["groups"][0] = self._bounds[b], self._bounds[b + 1]

    def _add_window(self) -> None:
        groups, end = self._groups, self._ends[-1]
        steps = int(groups["count"][: self._count].sum())
        each = (steps - self._steps) / len(self._runs)
        self._steps = steps
        if self._length == 0.0:
            sizes = groups["h"][: self._count]
            self._length = _FIRST_STEPS * float(sizes[sizes > 0.0].min(initial=self._stop - end))
        else:
            self._length *= 2.0 if each < _FEW else 0.5 if each > _MANY else 1.0
        behind = max(end, float(groups["t"][: self._count].min()))
        following = min(self._stop, behind + self._length)
        if following <= end:  # below the spacing of doubles
            following = min(self._stop, float(np.nextafter(end, np.inf)))
            self._length *= 2.0
        self._ends.append(following)
        self._begin_window(0)


def _bounds(groups: RecordArray, count: int, blocks: int) -> list[int]:
    """The first group of each block, and after the last: blocks of equal work, as far as the steps so far tell."""
    sizes = groups["h"][:count]
    typical = float(np.median(sizes[sizes > 0.0])) if (sizes > 0.0).any() else 1.0
    rates = np.clip(typical / np.where(sizes > 0.0, sizes, typical), 0.01, 100.0)
    work = np.cumsum(rates * (_STEP + groups["n"][:count] + groups["inputs"][:count]))
    inner = np.searchsorted(work, work[-1] * np.arange(1, blocks) / blocks) + 1
    return sorted({0, *np.minimum(inner, count).tolist(), count})
