"""The schedule: which group steps next. Compiled to machine code; see `machine`.

In a cascade nothing flows back, so a group may go ahead as soon as all that it reads is known to the end of its step, and the order of execution cannot
change any number. The run proceeds in windows: groups in cascade order, each stepping freely until it passes the window's end or has to wait for an
earlier one. A window never clips a step; its length is a count of steps of the fastest group, so that memory, not the result, depends on it.
"""

from __future__ import annotations

from hierc.runtime.machine.dialect import Array, invoke
from hierc.runtime.records import ACCEPTED, DONE, FULL, PAUSED, REVIEW, TOO_MANY, WAITING, Group, Run

#: Steps of the fastest group in a window.
WINDOW_STEPS = 64.0


def advance(run: Run, groups: Array[Group]) -> float:
    """Go on with a run until it is done, the budget is used up, or a group asks for Python's help. Returns a code of `records.py`."""
    while True:
        while run.group < run.groups:
            g = groups[run.group]
            while g.t < run.window:
                if run.budget <= 0:
                    return PAUSED
                run.budget -= 1
                outcome = hindrance(g)
                if outcome == ACCEPTED:
                    outcome = invoke(g.step, g, groups)
                if outcome == WAITING:
                    break
                if outcome != ACCEPTED:
                    return outcome
                run.moved = 1
            run.group += 1
        if run.window >= run.stop:
            return DONE
        run.window = next_window(run, groups)
        run.group = 0
        run.moved = 0


def hindrance(g: Group) -> float:
    """What keeps a group from taking a step, whatever its method; ACCEPTED where nothing does."""
    if g.count - g.first >= g.capacity:
        return FULL
    if g.steps >= g.most_steps:
        return TOO_MANY
    if g.steps >= g.review:
        return REVIEW
    return ACCEPTED


def next_window(run: Run, groups: Array[Group]) -> float:
    """End of the next window: later than the slowest group's time, by so many steps of the fastest.

    Where all who are behind the last window's end wait, nobody moves before those ahead of it do; so it is later than the first of those.
    """
    fastest = run.stop - run.window
    behind = run.stop
    ahead = run.stop
    for k in range(run.groups):
        g = groups[k]
        behind = min(behind, g.t)
        if g.t >= run.window:
            ahead = min(ahead, g.t)
        if g.h > 0.0:
            fastest = min(fastest, g.h)
    begin = max(behind, run.window)
    if run.moved == 0:
        begin = ahead
    return min(run.stop, begin + WINDOW_STEPS * fastest)
