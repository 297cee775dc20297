"""A generated module as one system of equations, in plain Python: parameters, initial values, right-hand side, Jacobian, observed variables.

This is the exact oracle of what the kernel integrates, and what users hand to other solvers. Where CPython raises on a domain error (1/0.0,
math.sqrt(-1.0)) the values concerned are NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime import ieee
from hierc.runtime.contract import Class, Parameter, Plan
from hierc.runtime.errors import SettingError

Floats = NDArray[np.float64]
_NAN = float("nan")
_FAULTS = (ZeroDivisionError, ValueError, OverflowError)
#: Stands for the discrete variables, of which there are none yet.
_NO_DISCRETE: list[float] = []


def order_parts(
    plan: Plan, wanted: Iterable[tuple[int, int]], inside: Callable[[int], bool]
) -> list[tuple[int, int]]:
    """Calls (node, part) that make the outs (node, out), in order: whatever a part reads from nodes that are `inside` comes before it."""
    calls: dict[tuple[int, int], None] = {}
    stack = [(node, _part_of(plan, node, out), False) for node, out in reversed(list(wanted))]
    while stack:
        node, part, ready = stack.pop()
        if (node, part) in calls:
            continue
        if ready:
            calls[node, part] = None
            continue
        stack.append((node, part, True))
        for source, kind, index in read_by(plan, node, part):
            if kind == "out" and inside(source):
                stack.append((source, _part_of(plan, source, index), False))
    return list(calls)


def _part_of(plan: Plan, node: int, out: int) -> int:
    parts = plan.classes[plan.nodes[node].kind].parts
    return next(k for k, part in enumerate(parts) if out in part.outs)


def read_by(plan: Plan, node: int, part: int) -> list[tuple[int, str, int]]:
    """Sources that one part of a node (-1: its right-hand side) may read."""
    sources = plan.nodes[node].sources
    if part < 0:
        return list(sources)
    return [sources[k] for k in plan.classes[plan.nodes[node].kind].parts[part].inputs]


@dataclass(frozen=True)
class System:
    """A plan with values for all its parameters. Vectors of states follow `state_names`: group by group, node by node."""

    plan: Plan
    parameters: Floats

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Nodes with states, in the order of the state vector."""
        return tuple(node for group in self.plan.groups for node in group.nodes)

    @cached_property
    def offsets(self) -> dict[int, int]:
        """Where each node's states begin in the state vector."""
        sizes = [len(self.kind(n).states) for n in self.order]
        return dict(zip(self.order, np.cumsum([0, *sizes]).tolist(), strict=False))

    @property
    def size(self) -> int:
        """Number of states."""
        return sum(len(self.kind(n).states) for n in self.order)

    @cached_property
    def values(self) -> tuple[list[float], ...]:
        """p of each node: what depends on parameters alone."""
        return tuple(
            self._filled(n, self.kind(n).fill, self.kind(n).values) for n in range(len(self.plan.nodes))
        )

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of all scalar states, as results and files have them; not those of variables elsewhere that only repeat a state."""
        names = [""] * self.size
        for v in sorted(self.plan.variables, key=lambda v: -v.path.count(".")):
            owner, dot, own = v.path.rpartition(".")
            for (node, what, index), place in zip(v.elements, np.ndindex(v.shape), strict=True):
                subscript = f"[{','.join(str(i + 1) for i in place)}]" if place else ""
                at_home = v.access != "read" and f"{self.plan.nodes[node].path}.".startswith(owner + dot)
                if what == "state" and at_home and own + subscript == self.kind(node).states[index]:
                    names[self.offsets[node] + index] = names[self.offsets[node] + index] or v.path + subscript
        return tuple(names)

    def state_at(self, k: int) -> tuple[str, str]:
        """Name of scalar state k of the state vector, and where its equation stands: `line 12`, `wheels.hier, line 12`; "" if that is not known."""
        node = next(n for n in reversed(self.order) if self.offsets[n] <= k and self.kind(n).states)
        kind, index = self.kind(node), k - self.offsets[node]
        line = f"line {kind.lines[index]}" if kind.lines[index] else ""
        return self.state_names[k] or kind.states[index], ", ".join(filter(None, (kind.file, line)))

    def nominal(self, node: int) -> list[float]:
        """Error scale of each state of a node."""
        kind = self.kind(node)
        result = [_NAN] * len(kind.states)
        _call(kind.nominal, self.values[node], result)
        return result

    def kind(self, node: int) -> Class:
        """The class of a node."""
        return self.plan.classes[self.plan.nodes[node].kind]

    def _filled(self, node: int, function: Callable[..., None], count: int) -> list[float]:
        result = [_NAN] * count
        _call(function, [float(self.parameters[k]) for k in self.plan.nodes[node].parameters], result)
        return result

    @cached_property
    def _calls(self) -> list[tuple[int, int]]:
        wanted = [(n, out) for n in range(len(self.plan.nodes)) for out in range(self.kind(n).outs)]
        return order_parts(self.plan, wanted, lambda _: True)

    def initial(self, t: float) -> Floats:
        """Initial values of all states."""
        x = np.full(self.size, _NAN)
        for _ in range(self.plan.start_passes):
            _, outs = self._outs(t, x)
            for node in range(len(self.plan.nodes)):
                kind = self.kind(node)
                own = [_NAN] * len(kind.states)
                if kind.states:
                    _call(kind.start, t, self._inputs(node, x, outs), self.values[node], own)
                    first = self.offsets[node]
                    x[first : first + len(own)] = own
                for part in range(len(kind.parts)):
                    self._evaluate(node, part, t, x, outs, own)
        return x

    def rhs(self, t: float, x: Sequence[float] | Floats) -> Floats:
        """Derivatives (n,) of the states x (n,)."""
        x = np.asarray(x, np.float64)
        states, outs = self._outs(t, x)
        result = np.full(self.size, _NAN)
        for node in self.order:
            kind = self.kind(node)
            dx = [_NAN] * len(kind.states)
            inputs = self._inputs(node, x, outs)
            _call(kind.rhs, t, states[node], inputs, _NO_DISCRETE, self.values[node], dx)
            first = self.offsets[node]
            result[first : first + len(dx)] = dx
        return result

    def jacobian(self, t: float, x: Sequence[float] | Floats) -> Floats:
        """d rhs/d x, shape (n, n), from the nodes' own derivatives by the chain rule."""
        return self.jacobian_of(self.order, t, x)

    def jacobian_of(self, nodes: Sequence[int], t: float, x: Sequence[float] | Floats) -> Floats:
        """d rhs/d x of some nodes' states by those states alone, in the order of `nodes`; x is the whole state vector."""
        x = np.asarray(x, np.float64)
        states, outs = self._outs(t, x)
        ends = np.cumsum([0, *(len(self.kind(n).states) for n in nodes)])
        places = dict(zip(nodes, ends.tolist(), strict=False))
        size = int(ends[-1])
        through: dict[tuple[int, int], Floats] = {}
        result = np.zeros((size, size))
        for node, part in [*self._calls, *((n, -1) for n in nodes)]:
            kind = self.kind(node)
            n = len(kind.states)
            entries = [_NAN] * len(kind.pattern)
            inputs = self._inputs(node, x, outs)
            _call(kind.jac, t, states.get(node, []), inputs, _NO_DISCRETE, self.values[node], entries)
            wanted = range(n) if part < 0 else [n + out for out in kind.parts[part].outs]
            rows = {row: np.zeros(size) for row in wanted}
            for (row, column), entry in zip(kind.pattern, entries, strict=True):
                if row not in rows:
                    continue
                source, what, index = (
                    (node, "state", column) if column < n else self.plan.nodes[node].sources[column - n]
                )
                if what == "out":
                    rows[row] += entry * through[source, index]
                elif source in places:
                    rows[row][places[source] + index] += entry
            for row, values in rows.items():
                if part < 0:
                    result[places[node] + row] = values
                else:
                    through[node, row - n] = values
        return result

    def observe(self, t: float, x: Floats, nodes: Iterable[int]) -> dict[int, list[float]]:
        """All observed variables of some nodes."""
        states, outs = self._outs(t, x)
        result = {}
        for node in nodes:
            kind = self.kind(node)
            result[node] = [_NAN] * kind.observed
            if kind.observe is not None:
                inputs = self._inputs(node, x, outs)
                _call(
                    kind.observe,
                    t,
                    states.get(node, []),
                    inputs,
                    _NO_DISCRETE,
                    self.values[node],
                    result[node],
                )
        return result

    def _outs(self, t: float, x: Floats) -> tuple[dict[int, list[float]], dict[int, list[float]]]:
        """Each node's states, and its outs."""
        states = self._states(x)
        outs = {n: [_NAN] * self.kind(n).outs for n in range(len(self.plan.nodes))}
        for node, part in self._calls:
            self._evaluate(node, part, t, x, outs, states.get(node, []))
        return states, outs

    def _states(self, x: Floats) -> dict[int, list[float]]:
        return {n: x[f : f + len(self.kind(n).states)].tolist() for n, f in self.offsets.items()}

    def _evaluate(
        self,
        node: int,
        part: int,
        t: float,
        x: Floats,
        outs: dict[int, list[float]],
        own: list[float],
    ) -> None:
        function = self.kind(node).parts[part].function
        _call(function, t, own, self._inputs(node, x, outs), _NO_DISCRETE, self.values[node], outs[node])

    def _inputs(self, node: int, x: Floats, outs: Mapping[int, list[float]]) -> list[float]:
        return [
            float(x[self.offsets[source] + index]) if what == "state" else outs[source][index]
            for source, what, index in self.plan.nodes[node].sources
        ]


def _call(function: Callable[..., None], *args: Any) -> None:
    """Call a generated function; what it could not compute is NaN."""
    try:
        function(*args)
    except _FAULTS:
        ieee.call(function, *args)


def parameter_vector(plan: Plan, given: Mapping[str, object]) -> Floats:
    """All parameters' scalars, in SI: those given by path, in their declared units, the others by their defaults.

    Raises SettingError naming a wrong one.
    """
    q = np.full(plan.parameter_count, _NAN)
    by_path = {p.path: p for p in plan.parameters}
    for path, value in given.items():
        if path not in by_path:
            raise SettingError(_unknown(path, by_path))
        parameter = by_path[path]
        if parameter.structural:
            raise SettingError(
                f"`{path}` is built into the code of {plan.name}: give it when the model is loaded"
            )
        array = _checked(parameter, value)
        q[parameter.first : parameter.first + array.size] = array.ravel()
    values = q.tolist()
    try:
        plan.parameters_function(values)
    except _FAULTS as error:
        raise SettingError(f"the parameters of {plan.name} cannot be computed: {error}") from None
    return np.asarray(values, np.float64)


def _checked(parameter: Parameter, value: object) -> Floats:
    try:
        if np.asarray(value).dtype.kind not in "biuf":
            raise TypeError
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(f"`{parameter.path}` is a number or an array of numbers, not {value!r}") from None
    if array.shape != parameter.shape:
        shape = "a number" if not parameter.shape else f"an array of shape {parameter.shape}"
        raise SettingError(f"`{parameter.path}` is {shape}; got shape {array.shape}")
    with np.errstate(over="ignore"):
        si = array * parameter.scale
    if not np.isfinite(si).all():
        raise SettingError(f"`{parameter.path}` must be finite, not {value!r}")
    if parameter.kind == "int" and not (array == np.round(array)).all():
        raise SettingError(f"`{parameter.path}` is an int, not {value!r}")
    if parameter.kind == "bool" and not np.isin(array, (0.0, 1.0)).all():
        raise SettingError(f"`{parameter.path}` is true or false, not {value!r}")
    return si


def _unknown(path: str, known: Iterable[str]) -> str:
    import difflib

    close = difflib.get_close_matches(path, list(known), n=1)
    return f"no parameter `{path}`" + (f"; did you mean `{close[0]}`?" if close else "")
