"""Segments, the only interface between groups: each accepted step leaves one polynomial a channel, in theta = (t - t0)/h.

A segment is t0, t1, 1/h, h, then for each channel `width` coefficients, lowest power first. Readers do not know the writer's method.
"""

from __future__ import annotations

from hierc.runtime.machine.dialect import Array, Lanes, at, select
from hierc.runtime.records import Group

#: Doubles before the coefficients.
HEADER = 4


def sample(
    track: Array[float],
    shape: Array[int],
    times: Array[float],
    out: Array[float],
) -> None:
    """Evaluate a group's states at any times. `shape` holds its number of segments, stride, width, degree and states, and the number of times.

    A time at a knot belongs to the segment that ends there. `out` gets a row of states for each time.
    """
    last = shape[0] - 1
    stride = shape[1]
    width = shape[2]
    degree = shape[3]
    n = shape[4]
    k = 0
    for m in range(shape[5]):
        t = times[m]
        if t <= track[k * stride] or t > track[k * stride + 1]:
            low = 0
            high = last
            while low < high:
                middle = (low + high) // 2
                if track[middle * stride + 1] < t:
                    low = middle + 1
                else:
                    high = middle
            k = low
        piece = at(track, k * stride)
        theta = (t - piece[0]) * piece[2]
        for i in range(n):
            c = at(piece, HEADER + i * width)
            a = c[degree]
            q = degree - 1
            while q >= 0:
                a = a * theta + c[q]
                q -= 1
            out[m * n + i] = a


def segment(g: Group, k: int) -> Array[float]:
    """Segment number k, counted from the start of the run."""
    return at(g.track, (k - g.first) * g.stride)


def covered(g: Group, groups: Array[Group], end: float) -> bool:
    """Whether everything that g reads is known up to `end`."""
    for s in range(g.source_count):
        if groups[g.sources[s].group].t < end or groups[g.sources[s].group].count == 0:
            return False
    return True


def read_inputs(g: Group, groups: Array[Group], t: Lanes, low: float, high: float, u: Array[Lanes]) -> int:
    """Evaluate all inputs of g at the times t, which lie in [low, high], into u. `low` never decreases between calls.

    Returns the most segments of one source that [low, high] touches.
    """
    most = 0
    for s in range(g.source_count):
        source = g.sources[s]
        up = groups[source.group]
        k = source.cursor
        while k + 1 < up.count and segment(up, k)[1] <= low:
            k += 1
        source.cursor = k
        place = at(g.channels, source.first)
        into = at(u, source.first)
        piece = segment(up, k)
        evaluate(piece, up.degree, place, source.count, (t - piece[0]) * piece[2], into)
        while k + 1 < up.count and segment(up, k)[1] < high:
            k += 1
            piece = segment(up, k)
            blend(piece, up.degree, place, source.count, t, into)
        most = max(most, k - source.cursor + 1)
    return most


def evaluate(
    piece: Array[float], degree: int, place: Array[int], count: int, theta: Lanes, into: Array[Lanes]
) -> None:
    """Horner's rule for `count` channels."""
    for i in range(count):
        c = at(piece, place[i])
        a = theta * 0.0 + c[degree]
        q = degree - 1
        while q >= 0:
            a = a * theta + c[q]
            q -= 1
        into[i] = a


def blend(
    piece: Array[float], degree: int, place: Array[int], count: int, t: Lanes, into: Array[Lanes]
) -> None:
    """As `evaluate`, but only where t lies beyond the segment's start."""
    theta = (t - piece[0]) * piece[2]
    for i in range(count):
        c = at(piece, place[i])
        a = theta * 0.0 + c[degree]
        q = degree - 1
        while q >= 0:
            a = a * theta + c[q]
            q -= 1
        into[i] = select(t > piece[0], a, into[i])
