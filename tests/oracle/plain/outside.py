"""Tables and external functions, for the interpreter: interpolation by its own formulas, and the text of Python modules run with its own numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hierc.grammar import tree
from plain import si

#: Where files and modules are.
HERE = Path(__file__).parents[1]

Grid = Mapping[tuple[Fraction, ...], Fraction]


@cache
def _grid(file: str) -> Grid:
    """The values of a table by their points, in declared units."""
    found: dict[tuple[Fraction, ...], Fraction] = {}
    for line in (HERE / "data" / file).read_text(encoding="utf-8").splitlines():
        words = line.partition("#")[0].split(",")
        if words[-1].strip() and words[-1].strip()[-1].isdigit():
            *point, value = (Fraction(word.strip()) for word in words)
            found[tuple(point)] = value
    return found


def table(item: tree.Table, args: Sequence[Any], real: Callable[[Any], Any]) -> Any:
    """A table's value, all in SI."""

    def scaled(number: Fraction, unit: tree.Unit | None) -> Any:
        size = 1 if unit is None else si.size(unit.text)
        exact = number * size if isinstance(size, Fraction) else float(number) * size
        return real(float(exact))  # a number in SI is rounded once

    grid = {
        tuple(scaled(k, p.unit) for k, p in zip(point, item.params, strict=True)): scaled(value, item.unit)
        for point, value in _grid(item.file).items()
    }
    return _along(item.method.text, grid, [real(x) for x in args])


def _along(method: str, grid: Mapping[tuple[Any, ...], Any], at: Sequence[Any]) -> Any:
    """One axis after the other, the last first: the order means nothing, but for `cubic` on several, which is not asked for."""
    if not at:
        return grid[()]
    *outer, x = at
    lines: dict[tuple[Any, ...], list[tuple[Any, Any]]] = {}
    for (*rest, knot), value in grid.items():
        lines.setdefault(tuple(rest), []).append((knot, value))
    return _along(method, {rest: _line(method, sorted(line), x) for rest, line in lines.items()}, outer)


def _line(method: str, line: Sequence[tuple[Any, Any]], x: Any) -> Any:
    """The value at x of what goes through some points."""
    knots, values = [k for k, _ in line], [v for _, v in line]
    if np.isnan(x) or x <= knots[0]:
        return x if np.isnan(x) else values[0]
    if x >= knots[-1]:
        return values[-1]
    k = next(k for k in range(len(line) - 1) if x < knots[k + 1])
    (a, left), (b, right) = line[k], line[k + 1]
    if method == "hold":
        return left
    if method == "linear":
        return left + (right - left) * (x - a) / (b - a)
    p, q = _slope(line, k), _slope(line, k + 1)
    rise = (right - left) / (b - a)
    # Newton's form of the cubic with these values and slopes.
    bend = (rise - p) / (b - a)
    twist = (p + q - 2 * rise) / (b - a) ** 2
    return left + (x - a) * (p + (x - a) * (bend + (x - b) * twist))


def _slope(line: Sequence[tuple[Any, Any]], k: int) -> Any:
    """The slope of PCHIP at a point: inside, a weighted harmonic mean of those beside it; at an end, that of a parabola, held back."""
    h = [b[0] - a[0] for a, b in pairwise(line)]
    d = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(line)]
    if len(d) == 1:
        return d[0]
    if 0 < k < len(d):
        if d[k - 1] * d[k] <= 0:
            return d[0] * 0
        near, far = 2 * h[k] + h[k - 1], h[k] + 2 * h[k - 1]
        return (near + far) / (near / d[k - 1] + far / d[k])
    (h0, h1), (d0, d1) = ((h[0], h[1]), (d[0], d[1])) if k == 0 else ((h[-1], h[-2]), (d[-1], d[-2]))
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return d0 * 0
    return 3 * d0 if d0 * d1 < 0 and abs(slope) > 3 * abs(d0) else slope


_MATH = SimpleNamespace(cos=np.cos, sin=np.sin, tanh=np.tanh)


@cache
def _module(name: str) -> dict[str, Any]:
    """What a module defines, with numpy's functions for those of `math`."""
    text = (HERE / f"{name}.py").read_text(encoding="utf-8").replace("import math\n", "")
    names: dict[str, Any] = {"math": _MATH}
    exec(compile(text, name, "exec"), names)
    return names


def external(item: tree.Extern, args: Sequence[Any], real: Callable[[Any], Any]) -> Any:
    """The value of an external function, all in SI."""
    module, _, name = item.target.partition(":")
    given = [real(x) / real(si.declared(p.unit)) for x, p in zip(args, item.params, strict=True)]
    return real(_module(module)[name](*given)) * real(si.declared(item.unit))
