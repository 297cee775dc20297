"""The parameter vector: defaults, constants, and what users give by name.

A name stands for one element, `car[3].tau`, or for several, `car.tau` and `car[2..5].tau`: then a number (or an array of the parameter's own shape) goes
to each of them, and an array of the shape (elements, *shape) gives one to each. Where names overlap the one that means fewer elements holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.contract import Defaults, Parameter, Plan
from hierc.runtime.elements import expanded, index_table, numbered
from hierc.runtime.errors import SettingError
from hierc.runtime.paths import Catalogue, PathError, Selection

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_NAN = float("nan")
_FAULTS = (ZeroDivisionError, ValueError, OverflowError)


class ParameterValue(NamedTuple):
    """A parameter as it stands: its value in the declared unit; `structural` if it is built into the code.

    In an array of agents the values of all, one row an agent (before its own shape); `shown` is the name with the agents' indices, `car[1..100].tau`.
    """

    value: float | Floats
    unit: str | None
    doc: str
    structural: bool
    shown: str = ""
    shape: tuple[int, ...] = ()  # of a single agent's
    kind: str = "real"


class Parameters(dict[str, ParameterValue]):
    """All parameters by path, those of an array of agents together where their number is the same in all. What names some of them, such as
    `car[2..5].T`, is found too.
    """

    def __init__(self, plan: Plan, vector: Floats) -> None:
        self._plan, self._vector, self._known = plan, vector, catalogue(plan)
        names = (part for name in self._known.plain for part in self._known.regular(name))
        super().__init__({name: self._value(self._known.find(name)) for name in names})

    def __missing__(self, path: str) -> ParameterValue:
        try:
            selection = self._known.find(path)
        except PathError as error:
            raise KeyError(str(error)) from None
        if selection.subscripts is not None:
            raise KeyError(f"no parameter `{path}`: `{selection.name}` is found as a whole")
        return self._value(selection)

    def _value(self, selection: Selection) -> ParameterValue:
        p = self._plan.parameters[int(selection.named.entry[selection.chosen[0]])]
        numbers = self._vector[places(self._plan.parameters, selection)] / p.scale
        shape = selection.shape + p.shape
        value = numbers.reshape(shape) if shape else float(numbers[0, 0])
        return ParameterValue(value, p.unit, p.doc, p.structural, selection.shown, p.shape, p.kind)


def catalogue(plan: Plan) -> Catalogue:
    """The names of a plan's parameters."""
    entries = [(p.path, p.count, p.indices) for p in plan.parameters]
    return Catalogue("no parameter", entries, [p.shape for p in plan.parameters])


def parameter_vector(plan: Plan, given: Mapping[str, object]) -> Floats:
    """All parameters' scalars, in SI: those given by path, in their declared units, the others by their defaults.

    Raises SettingError naming a wrong one.
    """
    q = np.full(plan.parameter_count, _NAN)
    for first, count, numbers in plan.constants:
        q[first : first + count] = numbers if isinstance(numbers, tuple) else expanded(numbers, count)
    for places, array in _given(plan, given):
        q[places] = array
    values = q.tolist()
    try:
        plan.parameters_function(values)
    except _FAULTS as error:
        singles = [p.first + k for p in plan.parameters if not p.indices for k in range(math.prod(p.shape))]
        missing = next((entry for entry in singles if values[entry] != values[entry]), None)
        raise SettingError(_cannot_be_computed(plan, missing, error)) from None
    q = np.asarray(values, np.float64)
    for defaults in plan.defaults:
        _complete(plan, defaults, q)
    return q


def _cannot_be_computed(plan: Plan, entry: int | None, error: Exception) -> str:
    """What to say where a default has no value: whose it is."""
    for p in plan.parameters:
        size = math.prod(p.shape)
        if entry is not None and p.first <= entry < p.first + size * p.count:
            element = (entry - p.first) // size
            indices = [int(expanded(index, p.count)[element]) for index in p.indices]
            return f"the default of `{numbered(p.path, indices)}` cannot be computed: {error}"
    return f"the parameters of {plan.name} cannot be computed: {error}"


def _complete(plan: Plan, defaults: Defaults, q: Floats) -> None:
    """Give the parameters of a block their defaults. Elements that are given the same have the same."""
    entries = index_table(defaults.entries, defaults.count)
    rows = np.concatenate([q[index_table(defaults.given, defaults.count)], q[entries]], axis=1)
    known: dict[bytes, list[float]] = {}
    found = []
    given = len(defaults.given)
    for element, row in enumerate(rows):
        key = row.tobytes()
        if key not in known:
            numbers = row.tolist()
            known[key] = numbers[given:]
            try:
                defaults.function(numbers[:given], known[key])
            except _FAULTS as error:
                missing = next((k for k, v in enumerate(known[key]) if v != v), None)
                entry = None if missing is None else int(entries[element, missing])
                raise SettingError(_cannot_be_computed(plan, entry, error)) from None
        found.append(known[key])
    q[entries] = found


def _given(plan: Plan, given: Mapping[str, object]) -> list[tuple[Integers, Floats]]:
    """Places in the parameter vector, and what is given for them, particular names last."""
    if not given:
        return []
    known = catalogue(plan)
    found = []
    for path, value in given.items():
        try:
            selection = known.find(path)
        except PathError as error:
            raise SettingError(str(error)) from None
        if selection.subscripts is not None:
            raise SettingError(f"no parameter `{path}`: give `{selection.name}` as a whole")
        parameter = plan.parameters[int(selection.named.entry[selection.chosen[0]])]
        if parameter.structural:
            raise SettingError(
                f"`{path}` is built into the code of {plan.name}: give it when the model is loaded"
            )
        found.append((places(plan.parameters, selection), _checked(parameter, selection, value)))
    return sorted(found, key=lambda item: -len(item[0]))


def places(parameters: Sequence[Parameter], selection: Selection) -> Integers:
    """Where in the parameter vector the scalars of some elements stand: (elements, scalars of each)."""
    named = selection.named
    size = int(np.prod(parameters[named.entry[selection.chosen[0]]].shape, dtype=np.int64))
    firsts = np.array([p.first for p in parameters], np.int64)[named.entry[selection.chosen]]
    return np.asarray((firsts + size * named.row[selection.chosen])[:, None] + np.arange(size))


def _checked(parameter: Parameter, selection: Selection, value: object) -> Floats:
    """What is given for each of the elements, (elements, scalars of each), in SI."""
    name = selection.name
    try:
        if np.asarray(value).dtype.kind not in "biuf":
            raise TypeError
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(f"`{name}` is a number or an array of numbers, not {value!r}") from None
    if array.shape not in (parameter.shape, selection.shape + parameter.shape):
        one = "a number" if not parameter.shape else f"an array of shape {parameter.shape}"
        each = f", or {selection.shape + parameter.shape} for one each" if selection.shape else ""
        raise SettingError(f"`{name}` is {one}{each}; got shape {array.shape}")
    with np.errstate(over="ignore"):
        si = array * parameter.scale
    if not np.isfinite(si).all():
        raise SettingError(f"`{name}` must be finite, not {value!r}")
    if parameter.kind == "int" and not (array == np.round(array)).all():
        raise SettingError(f"`{name}` is an int, not {value!r}")
    if parameter.kind == "bool" and not np.isin(array, (0.0, 1.0)).all():
        raise SettingError(f"`{name}` is true or false, not {value!r}")
    size = int(np.prod(parameter.shape, dtype=np.int64))
    flat = si.reshape(-1, size)
    return np.asarray(np.broadcast_to(flat, (len(selection.chosen), size)))
