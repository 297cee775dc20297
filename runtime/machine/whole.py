"""The right-hand side of a whole system in one call, for solvers that are not ours.

In: a `System` whose elements are all in one group. Out: `Derivatives`, called with a time and the states. Guaranteed: on finite numbers the very bits of
CPython (one lane, nothing contracted).
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.contract import Class
from hierc.runtime.files import cache_folder
from hierc.runtime.machine import callees
from hierc.runtime.machine.calls import Form
from hierc.runtime.machine.dialect import Array, aligned, at
from hierc.runtime.machine.forms import wire
from hierc.runtime.machine.program import cached, called_by, composed, description
from hierc.runtime.machine.unit import Loaded, Unit
from hierc.runtime.system import System

if TYPE_CHECKING:  # given by _object
    DX: int
    P: int
    V: int

    def rhs_fixed(t: float, u: Array[float], p: Array[float], v: Array[float]) -> None: ...
    def rhs(
        t: float, x: Array[float], u: Array[float], p: Array[float], dx: Array[float], v: Array[float]
    ) -> None: ...


Floats = NDArray[np.float64]


def whole(t: float, room: Array[float]) -> None:
    """Derivatives of the states at the beginning of `room`. There are no inputs, for which any array stands."""
    rhs_fixed(t, room, at(room, P), at(room, V))
    rhs(t, room, room, at(room, P), at(room, DX), at(room, V))


class Derivatives:
    """dx/dt (n,) at a time and states (n,). `evaluations` counts calls."""

    def __init__(self, system: System) -> None:
        """Raises ValueError where the elements are in several groups, or call a function back in Python."""
        wiring = wire(system.elements)
        if len(wiring) != 1 or len(wiring[0].places) != 1:
            raise ValueError("the elements are in several groups")
        form, p = wiring[0].form, system.values_of(wiring[0].values[0])
        address, saved, self._code, self._links = _machine_code(system.plan.classes, form)
        if self._links.called_back:
            raise ValueError("a function is called back in Python")
        n, values = system.size, 2 * system.size + saved
        self._room = aligned(values + len(p) + 1)
        self._x, self._dx = self._room[:n], self._room[n : 2 * n]
        self._room[values : values + len(p)] = p
        self._address = self._room.ctypes.data
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p)(address)
        self.evaluations = 0

    def __call__(self, t: float, x: Floats) -> Floats:
        self.evaluations += 1
        self._x[:] = x
        self._call(t, self._address)
        return self._dx.copy()


def _machine_code(classes: tuple[Class, ...], form: Form) -> tuple[int, int, Loaded, callees.Links]:
    """Address of the function, how many numbers it keeps between its halves, and what keeps it in memory."""
    text = description(classes, form, "whole")
    label = "w" + hashlib.sha256(text.encode()).hexdigest()[:16]
    make = functools.partial(_object, label, classes, form)
    facts, code = cached(cache_folder("objects"), text, make, None, "")
    loaded = Loaded([code])
    links = callees.Links(loaded)
    links.add(label, called_by(classes, form))
    return loaded.address(label), facts["saved"], loaded, links


def _object(label: str, classes: tuple[Class, ...], form: Form) -> tuple[dict[str, Any], Unit]:
    unit, composer = composed(label, classes, form, 1)
    names = {
        "DX": form.states,
        "V": 2 * form.states,
        "P": 2 * form.states + composer.saved,
        "rhs_fixed": composer.rhs_fixed,
        "rhs": composer.rhs,
    }
    unit.lower(whole, constants=names, export=label)
    return {"saved": composer.saved}, unit
