"""Values given from outside: parameters by path, from the command line or from Python.

In: paths with numbers or (nested) lists of them, in the declared units. Problems have no place: there is no text to point into.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from hierc.compiler import model
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.expression import Number
from hierc.compiler.resolve.errors import UnknownParameter
from hierc.compiler.shapes.values import Scalar, Shape, Value, type_text
from hierc.compiler.structure.errors import WrongValue
from hierc.compiler.suggest import did_you_mean_without, without_level

#: Values by path. `object`, because they are checked here.
Given = Mapping[str, object]


def outside_value(path: str, value: object, scalar: Scalar, shape: Shape, scale: float) -> Value:
    """`value` as a parameter of this type, in SI; `scale` is one of its declared unit. Raises Rejected (E911) if it does not fit."""
    found_shape, numbers = _flattened(value)
    wrong = found_shape != shape or numbers is None
    if numbers is None or wrong or not all(_fits(n, scalar, scale) for n in numbers):
        raise Rejected(
            WrongValue(None, name=path, wanted=f"`{type_text(scalar, shape)}`", given=f"`{value}`")
        )
    return Value(scalar, shape, tuple(Number(None, float(n) * scale) for n in numbers))


def _flattened(value: object) -> tuple[Shape, list[float] | None]:
    """The shape of a number or of nested lists, and its numbers row by row; None where the rows differ or something is no number."""
    if hasattr(value, "tolist"):
        value = value.tolist()  # an array
    if isinstance(value, bool | int | float):
        return (), [value] if abs(value) < float("inf") and abs(value) < 10**300 else None
    if not isinstance(value, Sequence) or isinstance(value, str):
        return (), None
    rows = [_flattened(item) for item in value]
    if not rows or any(shape != rows[0][0] for shape, _ in rows):
        return (), None
    numbers: list[float] = []
    for _, row in rows:
        if row is None:
            return (), None
        numbers += row
    return (len(rows), *rows[0][0]), numbers


def _fits(value: float, scalar: Scalar, scale: float) -> bool:
    if not abs(value * scale) < float("inf"):
        return False
    return (
        scalar == "real"
        or (scalar == "int" and value == int(value))
        or (scalar == "bool" and value in (0, 1))
    )


def check_given(parameters: Iterable[model.Parameter], given: Given) -> None:
    """Check names, types and shapes of values from outside. Raises ModelError with all that is wrong."""
    problems = Collector()
    known = {p.path: p for p in parameters}
    for path, value in given.items():
        parameter = known.get(path)
        if parameter is None:
            problems.add(
                UnknownParameter(
                    None, agent=None, name=path, candidates=tuple(known), advice=_advice(path, known)
                )
            )
            continue
        try:
            outside_value(path, value, parameter.scalar, parameter.shape, parameter.scale)
        except Rejected as rejection:
            problems.rejected(rejection)
    problems.stop_on_errors()


def _advice(path: str, known: Mapping[str, model.Parameter]) -> str | None:
    """What to give instead of one element of a vector, or by a path that goes through a level."""
    whole = known.get(path.partition("[")[0].strip())
    if whole is not None and whole.shape:
        kind, value = ("vector", "[…]") if len(whole.shape) == 1 else ("matrix", "[[…], …]")
        return f"give the whole {kind}: `{whole.path}={value}`"
    shorter = without_level(path, known)
    return did_you_mean_without(shorter) if shorter is not None else None
