"""sin, cos and exp over lanes, in the dialect.

Argument reduction after Cody and Waite, with pi/2 (or log 2) in parts whose products with the quotient are exact; polynomials from fdlibm
(`k_sin.c`, `k_cos.c`) and the Taylor series. Within 2 ulp of the exact value, tested. Where one argument is too large for the reduction, all go to the C
library. Whether that is so is asked last, not first: so a sine and a cosine of the same argument share nearly all of their work.
"""

from __future__ import annotations

import math

from hierc.runtime.machine.dialect import (
    Lanes,
    any_lane,
    bit,
    each_lane,
    power_of_two,
    rare,
    select,
    standalone,
)

#: Adding this rounds a double of modest size to the nearest integer, which then stands in the lowest bits; subtracting it again gives the integer.
ROUND = 6755399441055744.0
TWO_OVER_PI = 0.63661977236758134308
#: Beyond this the three-part reduction loses bits.
LARGEST_ANGLE = 800000.0


def sin(x: Lanes) -> Lanes:
    """sin(x), lane by lane."""
    k = x * TWO_OVER_PI + ROUND
    y = quadrant(k, reduced(x, k - ROUND))
    if any_lane(abs(x) > LARGEST_ANGLE):
        y = sin_of_large(x)
    return y


def cos(x: Lanes) -> Lanes:
    """cos(x), lane by lane."""
    k = x * TWO_OVER_PI + ROUND
    y = quadrant(k + 1.0, reduced(x, k - ROUND))
    if any_lane(abs(x) > LARGEST_ANGLE):
        y = cos_of_large(x)
    return y


@rare
@standalone
def sin_of_large(x: Lanes) -> Lanes:
    """sin(x) from the C library."""
    return each_lane(math.sin, x)


@rare
@standalone
def cos_of_large(x: Lanes) -> Lanes:
    """cos(x) from the C library."""
    return each_lane(math.cos, x)


def reduced(x: Lanes, n: Lanes) -> Lanes:
    """x - n*pi/2, with pi/2 in three parts of 33 bits."""
    r = x - n * 1.57079632673412561417e00
    r = r - n * 6.07710050630396597660e-11
    return r - n * 2.02226624879595063154e-21


def quadrant(k: Lanes, r: Lanes) -> Lanes:
    """sin(r + n*pi/2) for |r| <= pi/4, where k is ROUND + n, so that n stands in its lowest bits."""
    y = select(bit(k, 0), cos_kernel(r), sin_kernel(r))
    return select(bit(k, 1), -y, y)


def sin_kernel(r: Lanes) -> Lanes:
    """sin(r) for |r| <= pi/4 (fdlibm k_sin.c)."""
    z = r * r
    p = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08
    p = p * z + 2.75573137070700676789e-06
    p = p * z - 1.98412698298579493134e-04
    p = p * z + 8.33333333332248946124e-03
    p = p * z - 1.66666666666666324348e-01
    return r + r * z * p


def cos_kernel(r: Lanes) -> Lanes:
    """cos(r) for |r| <= pi/4 (fdlibm k_cos.c)."""
    z = r * r
    p = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09
    p = p * z - 2.75573143513906633035e-07
    p = p * z + 2.48015872894767294178e-05
    p = p * z - 1.38888888888741095749e-03
    p = p * z + 4.16666666666666019037e-02
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + z * z * p)


def exp(x: Lanes) -> Lanes:
    """exp(x), lane by lane."""
    if any_lane(abs(x) > 700.0):
        return each_lane(math.exp, x)
    n = (x * 1.44269504088896338700 + ROUND) - ROUND
    r = x - n * 6.93147180369123816490e-01
    r = r - n * 1.90821492927058770002e-10
    p = 1.6059043836821613e-10 * r + 2.0876756987868099e-09
    p = p * r + 2.5052108385441719e-08
    p = p * r + 2.7557319223985891e-07
    p = p * r + 2.7557319223985893e-06
    p = p * r + 2.4801587301587302e-05
    p = p * r + 1.9841269841269841e-04
    p = p * r + 1.3888888888888889e-03
    p = p * r + 8.3333333333333333e-03
    p = p * r + 4.1666666666666667e-02
    p = p * r + 1.6666666666666667e-01
    p = p * r + 0.5
    # e^r = 1 + r + r^2 p, the large terms added last
    return power_of_two(n) * (1.0 + (r + r * r * p))
