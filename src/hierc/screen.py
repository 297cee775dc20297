"""What `hierc` says on stderr: problems, the table of groups, progress.

Tables are plain text, so that a short run does not wait for rich; rich draws the progress bar of a long one, on a terminal.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from hierc.grammar.problems import Problem
    from hierc.runtime.comparison import Compared
    from hierc.runtime.costs import Costs
    from hierc.runtime.families import FamilyStats
    from hierc.runtime.verification import Verification

#: A run shorter than this, in s, shows no progress bar.
_PATIENCE = 0.4
#: Groups that a row of a table names; of more, the first two and the last.
SHOWN = 6


def plain(text: str) -> str:
    """Text that may hold names of a stranger's model: what a terminal would act on is shown by its code."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def say(text: str) -> None:
    """Talk. That nobody can hear it is no failure."""
    with suppress(OSError):
        print(plain(text), file=sys.stderr)  # noqa: T201


def show_problems(problems: Sequence[Problem], *, as_json: bool) -> None:
    """Problems for a reader on stderr, or as JSON on stdout."""
    from hierc.grammar.render import render, to_json

    if as_json:
        print(json.dumps({"problems": [to_json(problem) for problem in problems]}, indent=2))  # noqa: T201
        return
    print("\n\n".join(render(p, color=has_colors()) for p in problems), file=sys.stderr)  # noqa: T201 - safe to print
    errors = sum(problem.severity == "error" for problem in problems)
    if errors > 1:
        say(f"\n{errors} errors")


def has_colors() -> bool:
    """Whether stderr is a terminal whose user has not asked for plain text (https://no-color.org)."""
    return sys.stderr.isatty() and not os.environ.get("NO_COLOR")


def show_groups(families: Sequence[FamilyStats]) -> None:
    """The table of groups: how each was integrated, those of an array in one row."""
    several = any(f.groups > 1 for f in families)
    head = ["group", "method", "states", "steps", "rejected", "evaluations", "step min", "median", "max"]
    rows = [
        [
            f.name, ", ".join(f.methods), _states(f), str(f.steps), str(f.rejected), str(f.evaluations),
            duration(f.step_min), duration(f.step_median), duration(f.step_max),
        ]
        for f in families
    ]  # fmt: skip
    if several:  # what single groups of an array did, beside their sums
        head.insert(4, "each")
        for f, row in zip(families, rows, strict=True):
            row.insert(4, f"{f.steps_min}..{f.steps_max}" if f.groups > 1 else "")
    for line in aligned([head, *rows], left=2):
        say("  " + line)


def show_costs(found: Costs) -> None:
    """The table of costs: where the time of each group went, those of an array in one row, with the mean of each."""
    took = f"steps took {duration(found.seconds)}, as a run with timers tells; these took {duration(found.timers)}"
    say(f"{took} more")
    head = ["group", "method", "steps", "rejected", "evaluations", "flops"]
    head += ["rhs", "algebra", "inputs", "publishing", "rest", "all"]
    rows = [
        [g.name, ", ".join(g.methods), str(g.steps), str(g.rejected), str(g.evaluations), f"{g.flops:.3g}"]
        + [duration(s) for s in (g.rhs, g.algebra, g.inputs, g.publishing, g.rest, g.seconds)]
        for g in found.groups
    ]
    if any(g.groups > 1 for g in found.groups):
        head.append("each")
        for g, row in zip(found.groups, rows, strict=True):
            row.append(duration(g.seconds / g.groups) if g.groups > 1 else "")
    for line in aligned([head, *rows], left=2):
        say("  " + line)


def show_verification(found: Verification) -> None:
    """The table of errors: the worst state of each group, and when."""
    end = (
        ""
        if found.status.ok
        else f" up to {found.reached:.6g} s, where the second run ended: {found.status.message}"
    )
    say(f"verified by a run ten times tighter{end}")
    rows = [[g.name, f"{g.error:.2g}", g.state, duration(g.time)] for g in found.groups]
    for line in aligned([["group", "error/tolerance", "worst state", "at"], *rows], left=1):
        say("  " + line)


def _states(family: FamilyStats) -> str:
    each = " or ".join(map(str, family.states))
    return f"{family.groups} x {each}" if family.groups > 1 else each


def groupings(rows: Sequence[Compared]) -> str:
    """The table of groupings: what each takes beside the best, and its groups with their steps."""
    best = rows[0].measured if rows else None
    table = [["group", "predicted", "measured", "of the best", "groups (steps)"]]
    for row in rows:
        measured = "fails" if row.measured is None else duration(row.measured)
        ratio = "-" if row.measured is None or not best else f"{row.measured / best:.2f}"
        predicted = "-" if row.predicted is None else duration(row.predicted)
        each = [f"{name} ({steps})" for name, steps in zip(row.groups, row.steps, strict=True)]
        table.append([", ".join(row.kinds) or "-", predicted, measured, ratio, _some(each)])
    lines = [line.rstrip() for line in _columns(table)]
    failures = [f"fails: {row.failure}" for row in rows if row.failure]
    return "\n".join([*lines, *failures]) + "\n"


def _some(parts: Sequence[str]) -> str:
    """Parts of a list, or if they are many the first and last ones."""
    return ", ".join(parts if len(parts) <= SHOWN else [*parts[:2], f"{len(parts) - 3} more", parts[-1]])


def _columns(table: Sequence[Sequence[str]]) -> Iterable[str]:
    """Rows as lines: the first and the last column flush left, the others right."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for first, *middle, last in table:
        cells = [c.rjust(w) for c, w in zip(middle, widths[1:-1], strict=True)]
        yield "  ".join([first.ljust(widths[0]), *cells, last])


def aligned(rows: Sequence[Sequence[str]], *, left: int) -> Iterable[str]:
    """Rows as lines with columns of equal width; the first `left` columns flush left, the others right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            c.ljust(w) if i < left else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()


def duration(seconds: float) -> str:
    """A time with three digits and a unit: `1.25 ms`; `-` where there is none."""
    if not math.isfinite(seconds):
        return "-"
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")):
        if abs(seconds) >= 0.9995 * factor or seconds == 0:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds:.3g} s"


class Progress(AbstractContextManager["Progress"]):
    """A progress bar over simulated time, on stderr if that is a terminal, for runs that last."""

    def __init__(self, title: str, start: float, stop: float, *, shown: bool) -> None:
        self._title, self._start, self._stop = title, start, stop
        self._shown = shown and sys.stderr.isatty()
        self._since = time.monotonic()
        self._bar: Bar | None = None
        self._task: Any = None

    def __call__(self, t: float) -> None:
        """Tell how far the run is; called a few dozen times a second at most."""
        if not self._shown or time.monotonic() - self._since < _PATIENCE:
            return
        if self._bar is None:
            self._bar, self._task = self._begin()
        self._bar.update(self._task, completed=t - self._start, now=f"{t:.4g} of {self._stop:g} s")

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _begin(self) -> tuple[Bar, Any]:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
        from rich.text import Text

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.fields[now]}", markup=False),
            TimeRemainingColumn(),
        )
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        bar.start()
        title = Text(self._title).plain
        return bar, bar.add_task(title, total=self._stop - self._start, now="")
