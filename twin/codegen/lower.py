"""Replace functions for which processors have no instruction by branch-free CasADi expressions of supported operations.

The arc tangent is the rational approximation of the Cephes library (S. L. Moshier, atan.c), with an error of at most
one unit in the last place. The other inverse functions are computed from the arc tangent.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

_ABOVE = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_BELOW = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
_STEEP, _MIDDLE = 2.41421356237309504880, 0.66
"""Arguments above which the arc tangent is computed as a difference from pi/2 (`_STEEP`) or from pi/4 (`_MIDDLE`)."""

_LOST = 6.123233995736765886130e-17
"""Difference between pi/2 and its nearest double."""


@cache
def lowered() -> dict[int, ca.Function]:
    """Return {CasADi operation without a processor instruction: function of the same arguments that replaces it}."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    other = ca.sqrt((1 - a) * (1 + a))  # NaN for |a| > 1, as required
    return {
        ca.OP_ATAN2: ca.Function("atan2", [a, b], [_atan2(a, b)]),
        ca.OP_ATAN: ca.Function("atan", [a], [_atan2(a, ca.SX(1))]),
        ca.OP_ASIN: ca.Function("asin", [a], [_atan2(a, other)]),
        ca.OP_ACOS: ca.Function("acos", [a], [_atan2(other, a)]),
        ca.OP_TAN: ca.Function("tan", [a], [ca.sin(a) / ca.cos(a)]),
        ca.OP_HYPOT: ca.Function("hypot", [a, b], [ca.sqrt(a * a + b * b)]),
        ca.OP_SIGN: ca.Function("sign", [a], [ca.if_else(a > 0, 1, ca.if_else(a < 0, -1, a))]),
    }


def _atan2(y: ca.SX, x: ca.SX) -> ca.SX:
    high, wide = ca.fabs(y), ca.fabs(x)
    steep, middle = high > _STEEP * wide, high > _MIDDLE * wide
    above = ca.if_else(steep, -wide, ca.if_else(middle, high - wide, high))
    below = ca.if_else(steep, high, ca.if_else(middle, high + wide, wide))
    t = above / (below + (below == 0))
    z = t * t
    start = ca.if_else(steep, math.pi / 2, ca.if_else(middle, math.pi / 4, 0.0))
    rest = ca.if_else(steep, _LOST, ca.if_else(middle, _LOST / 2, 0.0))
    angle = start + (t + (t * (z * _horner(_ABOVE, z) / _horner(_BELOW, z)) + rest))
    angle = ca.if_else(ca.copysign(1, x) < 0, (math.pi - angle) + 2 * _LOST, angle)
    return ca.copysign(angle, y)


def _horner(coefficients: tuple[float, ...], z: ca.SX) -> ca.SX:
    y = ca.SX(coefficients[0])
    for c in coefficients[1:]:
        y = y * z + c
    return y
