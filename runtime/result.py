"""Results: what a run produced, by the names of the model.

In: a finished, failed or interrupted run (`Run`: its plan, the segments of every group, and `evaluate`). Out: values at the output times
and at any other, steps and counters of each group, files and plots. Nothing is computed before it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hierc.runtime.columns import median
from hierc.runtime.contract import Plan, Variable
from hierc.runtime.elements import Elements, expanded
from hierc.runtime.errors import SettingError
from hierc.runtime.families import ByGroup, FamilyStats, family_statistics
from hierc.runtime.observation import Variables
from hierc.runtime.paths import PathError, Selection
from hierc.runtime.status import Status
from hierc.runtime.trajectory import GroupTrajectory

if TYPE_CHECKING:
    from hierc.runtime.costs import Costs
    from hierc.runtime.verification import Verification

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Without an `interval`, results stand at this many equal parts of the run.
PARTS = 500
#: More output times than this are taken for a mistake in `interval`.
MOST_TIMES = 5_000_000
#: What the output times are called, here and in files.
TIME = "time"
#: By how much, relative to the times of the run, a time may lie outside: what rounding does to a time that was computed.
_ROUNDING = 1e-12


class Run(Protocol):
    """A run as the simulator hands it over."""

    @property
    def plan(self) -> Plan:
        """The model's tables."""

    @property
    def variables(self) -> Variables:
        """Its variables by name."""

    @property
    def start(self) -> float:
        """Where the run started, s."""

    @property
    def stop(self) -> float:
        """Where it was to stop, s."""

    @property
    def t_reached(self) -> float:
        """Up to where everything is known, s."""

    @property
    def status(self) -> Status:
        """How it ended."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What there was to say of it."""

    @property
    def groups(self) -> Sequence[GroupTrajectory]:
        """In cascade order."""

    @property
    def compiled(self) -> Elements:
        """The model's elements in groups as they were compiled, which may be others than those of the run."""

    @property
    def joined(self) -> Mapping[str, int]:
        """The places of the groups that others, by their names as the model has them, are part of."""

    def evaluate(self, names: Sequence[str], t: Floats) -> Mapping[str, Floats]:
        """Values of variables (len(t), *shape) by name at any times between start and t_reached."""


@dataclass(frozen=True, slots=True)
class GroupStats:
    """How one group was integrated. Step sizes are in s, NaN where there was no step."""

    method: str
    states: int
    steps: int
    rejected: int
    evaluations: int
    jacobians: int
    iterations: int  # of Newton's method
    step_min: float
    step_median: float
    step_max: float


class Result:
    """Values, steps and counters of one run.

    `r["cart.x"]` is an array over `r.t`; a vector has shape (len(r.t), n), an element is named `plan.p[1]`. `r("cart.x", t)` is the value
    at a number or an array of times. Names are those of the model, private variables included, and `time`. In an array of agents
    `r["car[3].x"]` is that of one, `r["car.x"]` of all, with shape (len(r.t), N), and `r["car[2..5].x"]` of some. Values are in the
    declared units; the arrays cannot be written to, as they are shared.
    """

    def __init__(
        self,
        run: Run,
        *,
        interval: float | None = None,
        settings: Mapping[str, object],
        params: Mapping[str, object],
    ) -> None:
        self._run = run
        self._catalogue = run.variables.catalogue
        #: Output times, s: every `interval` from the start, and the end.
        self.t: Floats = _shared(output_times(run.start, run.t_reached, interval))
        self._values: dict[str, Floats] = {TIME: self.t}
        #: The settings the run used, defaults included.
        self.settings: Mapping[str, object] = settings
        #: The parameters that were set for this run, by path.
        self.params: Mapping[str, object] = params
        #: Where the time went, where that was asked for.
        self.costs: Costs | None = None
        #: The error as a tighter run shows it, where that was asked for.
        self.verification: Verification | None = None
        #: Where groups were joined as that was predicted to cost less: how many times as fast as with groups as written.
        self.gain: float | None = None

    @property
    def model(self) -> str:
        """Name of the model."""
        return self._run.plan.name

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self._run.status

    @property
    def warnings(self) -> tuple[str, ...]:
        """What there was to say of the run: tables used outside their grids, slow externs."""
        return self._run.warnings

    @property
    def start(self) -> float:
        """Time the run started at, s."""
        return self._run.start

    @property
    def stop(self) -> float:
        """Time the run was to stop at, s."""
        return self._run.stop

    @property
    def t_reached(self) -> float:
        """Last time, s, up to which everything is known: the stop time unless the run failed or was interrupted."""
        return self._run.t_reached

    @property
    def names(self) -> tuple[str, ...]:
        """Paths of all variables, private ones included, in text order; in an array of agents each stands for all of them."""
        return tuple(self._catalogue.plain)

    @property
    def recorded(self) -> tuple[str, ...]:
        """What files and plots show: the experiment's `record`, else every `write` variable. All have a shape: where arrays differ in size, with indices."""
        chosen = self._run.plan.experiment.record
        if not chosen:
            return self._written(self._catalogue.plain)
        found: dict[str, None] = {}
        for name in chosen:
            every = name.endswith(".*")
            found |= dict.fromkeys(
                self._written(self._catalogue.below(name[:-2])) if every else self._catalogue.regular(name)
            )
        return tuple(found)

    def _written(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those that name `write` variables."""
        regular = (part for name in names for part in self._catalogue.regular(name))
        return tuple(name for name in regular if self._variable(self._catalogue.find(name)).access == "write")

    def _variable(self, selection: Selection) -> Variable:
        """What all elements of a selection have in common: one of their variables."""
        return self._run.plan.variables[int(selection.named.entry[selection.chosen[0]])]

    @property
    def units(self) -> dict[str, str | None]:
        """Declared unit of every variable, None where it has none."""
        variables = self._run.plan.variables
        return {name: variables[self._catalogue.entries(name)[0]].unit for name in self.names}

    def unit(self, name: str) -> str | None:
        """Declared unit of a variable, or of an element of it. Raises KeyError for an unknown name."""
        return "s" if name == TIME else self._variable(self._find(name)).unit

    @property
    def _elements(self) -> Elements:
        return self._run.variables.elements

    @cached_property
    def stats(self) -> Mapping[str, GroupStats]:
        """Counters and step sizes of each group, in cascade order. Raises KeyError for an unknown group, or several.

        Where groups were joined, the name of one of them gives those of the whole.
        """
        states = self._elements.group_states
        groups = self._run.groups
        return ByGroup(self._elements, lambda g: _statistics(groups[g], int(states[g])), self._run.joined)

    @cached_property
    def families(self) -> tuple[FamilyStats, ...]:
        """The same, the groups of an array together."""
        return family_statistics(self._elements, self._run.groups)

    def steps(self, group: str) -> tuple[Floats, Floats]:
        """Start times and sizes, s, of the steps a group took. Raises KeyError for an unknown group."""
        knots = ByGroup(self._elements, lambda g: self._run.groups[g].knots, self._run.joined)[group]
        return knots[:-1], np.diff(knots)

    def __getitem__(self, name: str) -> Floats:
        """Values at the output times: (len(t),), or (len(t), n) for a vector. Raises KeyError for an unknown name."""
        if name == TIME:
            return self.t
        selection = self._find(name)
        self._fetch([selection])
        return self._select(self._values[selection.name], selection)

    def __contains__(self, name: object) -> bool:
        try:
            return isinstance(name, str) and (name == TIME or bool(self._find(name)))
        except KeyError:
            return False

    @overload
    def __call__(self, name: str, t: float) -> float | Floats: ...

    @overload
    def __call__(self, name: str, t: ArrayLike) -> Floats: ...

    def __call__(self, name: str, t: ArrayLike) -> float | Floats:
        """Value of a variable at any time, or at an array of times, by dense output.

        A scalar variable at one time gives a float, otherwise an array of shape (*t.shape, *variable.shape). Raises KeyError for an
        unknown name and ValueError for times outside the run, by more than rounding.
        """
        times = self._inside(np.asarray(t, dtype=np.float64))
        values: Floats = times.ravel()
        if name != TIME:
            selection = self._find(name)
            found = np.asarray(self._run.evaluate([selection.name], values)[selection.name])
            values = self._select(found, selection)
        values = values.reshape(times.shape + values.shape[1:])
        return float(values) if values.ndim == 0 else values

    def _inside(self, times: Floats) -> Floats:
        """The times, those that rounding has put outside the run moved to its ends. Raises ValueError."""
        slack = _ROUNDING * max(abs(self.start), abs(self.t_reached))
        outside = ~((times >= self.start - slack) & (times <= self.t_reached + slack))
        if outside.any():
            t = float(times[outside][0])
            raise ValueError(
                f"t = {t!r} s is outside the run, which goes from {self.start!r} to {self.t_reached!r} s"
            )
        return np.clip(times, self.start, self.t_reached)

    def fetch(self, names: Iterable[str]) -> None:
        """Compute variables at the output times at once, which is quicker than one by one. Raises KeyError for an unknown name."""
        self._fetch([self._find(name) for name in names if name != TIME])

    def _fetch(self, selections: Iterable[Selection]) -> None:
        missing = list(dict.fromkeys(s.name for s in selections if s.name not in self._values))
        if missing:
            found = self._run.evaluate(missing, self.t)
            self._values.update({name: _shared(np.asarray(found[name])) for name in missing})

    def columns(self, names: Iterable[str] | None = None) -> dict[str, Floats]:
        """One array over `t` a scalar, arrays and vectors split into their elements: what a table shows (default: what is recorded) beside `time`."""
        table: dict[str, Floats] = {}
        for selection in self._chosen(names).values():
            values = self._select(self._values[selection.name], selection)
            if values.ndim == 1:
                table[selection.names[0] + _subscript(_from_zero(selection.subscripts or ()))] = values
                continue
            indices = list(product(*map(range, values.shape[1 + len(selection.shape) :])))
            rows = values.reshape(len(values), len(selection.chosen), len(indices))
            for k, element in enumerate(selection.names):
                for cell, index in enumerate(indices):
                    place = _from_zero(selection.subscripts) if selection.subscripts else index
                    table[element + _subscript(place)] = rows[:, k, cell]
        return table

    def _chosen(self, names: Iterable[str] | None) -> dict[str, Selection]:
        """The variables that stand beside `time` in a file, computed at once."""
        asked = self.recorded if names is None else names
        chosen = {name: self._find(name) for name in asked if name != TIME}
        self._fetch(chosen.values())
        return chosen

    def panels(self) -> dict[str, list[str]]:
        """The recorded names by their group as written (or its array), whatever groups the run had; what belongs to none stands under the model's name."""
        written = self._run.compiled
        families = list(dict.fromkeys(f.name.replace("[]", "") for f in written.families))
        found: dict[str, list[str]] = {title: [] for title in [*families, self.model]}
        for name in self.recorded:
            home = self._home(self._find(name))
            found[self.model if home is None else home.replace("[]", "")].append(name)
        return {title: names for title, names in found.items() if names}

    def _home(self, selection: Selection) -> str | None:
        """The name of the groups as written that a variable is in; None where it belongs to none."""
        written = self._run.compiled
        variable = self._variable(selection)
        if not variable.elements:
            return None
        row = int(selection.named.row[selection.chosen[0]])
        element = int(expanded(variable.elements[0][0], variable.count)[row])
        home = int(written.home[element])
        return None if home < 0 else written.families[int(written.family[home])].name

    def to_csv(self, path: str | Path, names: Iterable[str] | None = None) -> None:
        """Write a table: a column `time` and one a scalar (default: what is recorded). Raises OSError, KeyError."""
        from hierc.runtime.writers import write_csv

        write_csv(Path(path), self.t, self.columns(names))

    def to_npz(self, path: str | Path, names: Iterable[str] | None = None) -> None:
        """Write arrays `time` and one a variable, named by their paths, for `numpy.load`. Raises OSError, KeyError."""
        from hierc.runtime.writers import write_npz

        write_npz(Path(path), self.t, {name: self[name] for name in self._chosen(names)})

    def plot(self, path: str | Path | None = None, names: Iterable[str] | None = None) -> object:
        """Draw what is recorded, by group, or `names`, with an axis for each unit; returns the figure.

        With a path it is also written, as `.png`, `.pdf` or `.svg`.

        Needs matplotlib. Raises ImportError without it, KeyError, OSError, ValueError for another kind of file.
        """
        from hierc.runtime.plotting import draw

        return draw(self, None if path is None else Path(path), None if names is None else list(names))

    def __repr__(self) -> str:
        end = "" if self.status.ok else f", {self.status.message}"
        return f"<Result of {self.model}: {self.start:g} to {self.t_reached:g} s, {len(self.t)} times, {len(self.names)} variables{end}>"

    def _find(self, name: str) -> Selection:
        """The variable that a name means. Raises KeyError."""
        try:
            selection = self._catalogue.find(name)
        except PathError as error:
            raise KeyError(str(error)) from None
        subscripts = selection.subscripts
        if subscripts is None:
            return selection
        shape = self._variable(selection).shape
        if len(subscripts) != len(shape) or not all(
            1 <= i <= n for i, n in zip(subscripts, shape, strict=True)
        ):
            size = "is a number" if not shape else f"has the shape {list(shape)}; indices start at 1"
            raise KeyError(f"no element `{name}`: `{selection.name}` {size}")
        return selection

    @staticmethod
    def _select(values: Floats, selection: Selection) -> Floats:
        """The scalar that a name's subscripts choose, of each element."""
        if selection.subscripts is None:
            return values
        index: tuple[Any, ...] = (..., *(i - 1 for i in selection.subscripts))
        return np.asarray(values[index])


class SimulationError(Exception):
    """A run ended before its stop time. `result` holds everything up to the last time at which all groups are known."""

    def __init__(self, result: Result) -> None:
        self.result = result
        super().__init__(result.status.message)


class Interrupted(KeyboardInterrupt):
    """The user stopped a run. `result` holds everything up to the last time at which all groups are known."""

    def __init__(self, result: Result) -> None:
        self.result = result
        super().__init__(result.status.message)


def output_times(start: float, stop: float, interval: float | None) -> Floats:
    """`start`, every `interval` after it, and `stop`; 500 equal parts without an interval. Raises SettingError."""
    if stop <= start:
        return np.array([start], dtype=np.float64)
    check_interval(start, stop, interval)
    if interval is None:
        return np.linspace(start, stop, PARTS + 1, dtype=np.float64)
    ratio = (stop - start) / interval
    whole = round(ratio) if abs(ratio - round(ratio)) < 1e-9 * max(ratio, 1.0) else int(ratio) + 1
    times: Floats = start + interval * np.arange(whole + 1, dtype=np.float64)
    times[-1] = stop
    return times


def check_interval(start: float, stop: float, interval: float | None) -> None:
    """Refuse an impossible interval between output times. Raises SettingError."""
    if interval is None:
        return
    if not interval > 0:
        raise SettingError(f"the output interval must be a positive number, not {interval!r}")
    ratio = (stop - start) / interval
    if ratio > MOST_TIMES:
        raise SettingError(
            f"an output interval of {interval!r} s gives {ratio:.3g} output times; the most is {MOST_TIMES}"
        )


def _statistics(group: GroupTrajectory, states: int) -> GroupStats:
    sizes = np.diff(group.knots)
    low, middle, high = (sizes.min(), median(sizes), sizes.max()) if len(sizes) else (np.nan, np.nan, np.nan)
    return GroupStats(
        method=group.method,
        states=states,
        steps=int(group.stats.get("steps", len(sizes))),
        rejected=int(group.stats.get("rejected", 0)),
        evaluations=int(group.stats.get("evaluations", 0)),
        jacobians=int(group.stats.get("jacobians", 0)),
        iterations=int(group.stats.get("iterations", 0)),
        step_min=float(low),
        step_median=float(middle),
        step_max=float(high),
    )


def _shared(values: Floats) -> Floats:
    """The same values, for reading only."""
    view = values.view()
    view.flags.writeable = False
    return view


def _from_zero(subscripts: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(i - 1 for i in subscripts)


def _subscript(index: tuple[int, ...]) -> str:
    return f"[{','.join(str(i + 1) for i in index)}]" if index else ""
