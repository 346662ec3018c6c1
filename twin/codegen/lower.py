"""Replace functions for which processors have no instruction by branch-free CasADi expressions of supported operations.

The arc tangent is the rational approximation of the Cephes library (S. L. Moshier, atan.c), with an error of at most
one unit in the last place. The other inverse functions are computed from the arc tangent.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

_NUMERATOR = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_DENOMINATOR = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
"""Coefficients of numerator and denominator of the arc tangent's approximation, highest power first."""

_STEEP = 2.41421356237309504880
"""Argument above which the arc tangent is computed as a difference from pi/2."""

_MIDDLE = 0.66
"""Argument above which the arc tangent is computed as a difference from pi/4."""

_REST_OF_HALF_PI = 6.123233995736765886130e-17
"""Difference between pi/2 and its nearest double."""


@cache
def lowered() -> dict[int, ca.Function]:
    """Return {CasADi operation without a processor instruction: function of the same arguments that replaces it}."""
    a = ca.SX.sym("a")
    b = ca.SX.sym("b")
    # the cosine of the angle with sine a, and the sine of the angle with cosine a; NaN for |a| > 1, as required
    cathetus = ca.sqrt((1 - a) * (1 + a))
    # the sum by which CasADi chooses a case would make 0 of -0
    sign = ca.copysign(ca.if_else(a > 0, 1, ca.if_else(a < 0, -1, a)), a)
    return {
        ca.OP_ATAN2: ca.Function("atan2", [a, b], [_atan2(a, b)]),
        ca.OP_ATAN: ca.Function("atan", [a], [_atan2(a, ca.SX(1))]),
        ca.OP_ASIN: ca.Function("asin", [a], [_atan2(a, cathetus)]),
        ca.OP_ACOS: ca.Function("acos", [a], [_atan2(cathetus, a)]),
        ca.OP_TAN: ca.Function("tan", [a], [ca.sin(a) / ca.cos(a)]),
        ca.OP_HYPOT: ca.Function("hypot", [a, b], [ca.sqrt(a * a + b * b)]),
        ca.OP_SIGN: ca.Function("sign", [a], [sign]),
    }


def _atan2(y: ca.SX, x: ca.SX) -> ca.SX:
    """Return atan2(y, x): the angle in the first quadrant, then its reflections by the signs of x and y."""
    height = ca.fabs(y)
    width = ca.fabs(x)
    # atan(h / w) is pi/2 + atan(-w / h), and pi/4 + atan((h - w) / (h + w)): the argument t is small in each case
    steep = height > _STEEP * width
    middle = height > _MIDDLE * width

    def by_slope(if_steep: ca.SX | float, if_middle: ca.SX | float, if_flat: ca.SX | float) -> ca.SX:
        return ca.if_else(steep, if_steep, ca.if_else(middle, if_middle, if_flat))

    numerator = by_slope(-width, height - width, height)
    denominator = by_slope(height, height + width, width)
    t = numerator / (denominator + (denominator == 0))  # 0 at the origin, instead of NaN
    z = t * t
    start = by_slope(math.pi / 2, math.pi / 4, 0.0)
    start_rest = by_slope(_REST_OF_HALF_PI, _REST_OF_HALF_PI / 2, 0.0)
    correction = t * (z * _horner(_NUMERATOR, z) / _horner(_DENOMINATOR, z)) + start_rest
    angle = start + (t + correction)  # small terms first
    # the sign bit, because the angle of (0, -0.0) is pi
    is_left = ca.copysign(1, x) < 0
    angle = ca.if_else(is_left, (math.pi - angle) + 2 * _REST_OF_HALF_PI, angle)
    return ca.copysign(angle, y)


def _horner(coefficients: tuple[float, ...], z: ca.SX) -> ca.SX:
    """Return the polynomial of z with these coefficients, highest power first."""
    y = ca.SX(coefficients[0])
    for coefficient in coefficients[1:]:
        y = y * z + coefficient
    return y
