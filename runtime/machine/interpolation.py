"""Interpolation in a table on a rectangular grid, in the dialect: one text for CPython and for machine code.

In: the grid, row by row (the last axis goes fastest), and for `CUBIC` its slopes; a point; the order of derivative along each axis, 0 or 1. Out: the
value. Outside the grid it is that of the nearest edge, which the table is told (`outside`), and the derivative across the edge is zero. NaN gives NaN.

The value is a sum over the corners of the cell around the point. Along one axis the weights are those of a step, of a line, or of a cubic Hermite
piece: two for the values at its ends, two for the slopes there. On several axes they are products, so `CUBIC` needs a plane of data for each set of
axes: plane 0 has the values, plane 1 their slopes along the last axis, plane 2 along the one before it, plane 3 the mixed slopes, and so on.
"""

from __future__ import annotations

from hierc.runtime.machine.dialect import Array, exact

HOLD, LINEAR, CUBIC = 0, 1, 2
#: Part of the grid by which a point may lie outside without a mark: a rounding error is no excursion.
SLACK = 1e-9


@exact
def interpolate(
    method: int,
    dimensions: int,
    points: int,
    sizes: Array[int],
    knots: Array[float],
    data: Array[float],
    orders: Array[int],
    x: Array[float],
    weights: Array[float],
    outside: Array[int],
) -> float:
    """The table's value or derivative at the point x. `weights` is room for 4 numbers an axis; `outside` has a mark below and one above each axis."""
    first = 0
    place = 0
    corners = 1
    for k in range(dimensions):
        last = first + sizes[k] - 1
        at = x[k]
        inside = 1.0
        slack = SLACK * (knots[last] - knots[first])
        if at < knots[first]:
            if at < knots[first] - slack:
                outside[2 * k] = 1
            at = knots[first]
            inside = 0.0
        elif at > knots[last]:
            if at > knots[last] + slack:
                outside[2 * k + 1] = 1
            at = knots[last]
            inside = 0.0
        low = interval(knots, first, last, at)
        width = knots[low + 1] - knots[low]
        s = (at - knots[low]) / width
        if method == HOLD:
            step_weights(s, orders[k], weights, 4 * k)
        elif method == LINEAR:
            line_weights(s, width, inside, orders[k], weights, 4 * k)
        else:
            cubic_weights(s, width, inside, orders[k], weights, 4 * k)
        place = place * sizes[k] + low - first
        first = last + 1
        corners = 2 * corners
    planes = 1
    if method == CUBIC:
        planes = corners
    total = 0.0
    for plane in range(planes):
        for corner in range(corners):
            weight = 1.0
            node = place
            stride = 1
            slopes = plane
            ends = corner
            for j in range(dimensions):
                k = dimensions - 1 - j
                weight = weight * weights[4 * k + 2 * (slopes % 2) + ends % 2]
                node = node + stride * (ends % 2)
                stride = stride * sizes[k]
                slopes = slopes // 2
                ends = ends // 2
            total = total + weight * data[plane * points + node]
    return total


@exact
def interval(knots: Array[float], first: int, last: int, at: float) -> int:
    """The knot at or before `at`, which lies between the first and the last knot; never the last."""
    low = first
    high = last
    while high - low > 1:
        middle = (low + high) // 2
        if at >= knots[middle]:
            low = middle
        else:
            high = middle
    return low


@exact
def step_weights(s: float, order: int, weights: Array[float], to: int) -> None:
    """The value at the knot before; at the last knot that of the knot itself."""
    after = s - s  # NaN stays
    if s >= 1.0:
        after = 1.0
    weights[to] = 1.0 - after
    weights[to + 1] = after
    if order == 1:
        weights[to] = 0.0
        weights[to + 1] = 0.0


@exact
def line_weights(s: float, width: float, inside: float, order: int, weights: Array[float], to: int) -> None:
    """The straight line between the ends."""
    weights[to] = 1.0 - s
    weights[to + 1] = s
    if order == 1:
        weights[to] = -inside / width
        weights[to + 1] = inside / width


@exact
def cubic_weights(s: float, width: float, inside: float, order: int, weights: Array[float], to: int) -> None:
    """The cubic with given values and slopes at the ends."""
    r = 1.0 - s
    weights[to] = (1.0 + 2.0 * s) * r * r
    weights[to + 1] = s * s * (3.0 - 2.0 * s)
    weights[to + 2] = width * s * r * r
    weights[to + 3] = -width * s * s * r
    if order == 1:
        rise = inside * (6.0 * s * r / width)
        weights[to] = -rise
        weights[to + 1] = rise
        weights[to + 2] = inside * (r * (1.0 - 3.0 * s))
        weights[to + 3] = inside * (s * (3.0 * s - 2.0))
