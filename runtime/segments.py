"""Segments, the only interface between groups: each accepted step leaves one polynomial a channel, in theta = (t - t0)/h.

A segment is t0, t1, 1/h, h, then for each channel `width` coefficients, lowest power first. Readers do not know the writer's method.
"""

from __future__ import annotations

from hierc.runtime.machine.dialect import Array, Lanes, acquire, at, release, select
from hierc.runtime.records import Group, Request

#: Doubles before the coefficients.
HEADER = 4


def sample(requests: Array[Request], shape: Array[int], times: Array[float], out: Array[float]) -> None:
    """Evaluate channels of groups at any times. `shape` holds the number of requests and of times.

    `out` gets a row of times for each channel, request by request.
    """
    row = 0
    for r in range(shape[0]):
        request = requests[r]
        curves(request, times, shape[1], at(out, row * shape[1]))
        row += request.channels


def curves(r: Request, times: Array[float], count: int, out: Array[float]) -> None:
    """Evaluate the channels of one group. A time at a knot belongs to the segment that ends there."""
    k = 0
    for m in range(count):
        t = times[m]
        if t <= r.track[k * r.stride] or t > r.track[k * r.stride + 1]:
            low = 0
            high = r.count - 1
            while low < high:
                middle = (low + high) // 2
                if r.track[middle * r.stride + 1] < t:
                    low = middle + 1
                else:
                    high = middle
            k = low
        piece = at(r.track, k * r.stride)
        theta = (t - piece[0]) * piece[2]
        for i in range(r.channels):
            c = at(piece, r.places[i])
            a = c[r.degree]
            q = r.degree - 1
            while q >= 0:
                a = a * theta + c[q]
                q -= 1
            out[i * count + m] = a


def segment(g: Group, k: int) -> Array[float]:
    """Segment number k, counted from the start of the run."""
    return at(g.track, (k - g.first) * g.stride)


def covered(g: Group, groups: Array[Group], end: float) -> bool:
    """Whether everything that g reads is known up to `end`."""
    for s in range(g.source_count):
        if groups[g.sources[s].group].t < end or groups[g.sources[s].group].count == 0:
            return False
    acquire()
    return True


def finish(g: Group) -> None:
    """End an accepted step, whose segment is in its place. Its end comes last: a reader in another thread that sees it sees the segment too."""
    g.previous = g.trial
    g.rejections = 0
    g.count += 1
    g.steps += 1
    release()
    g.t = g.end


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
