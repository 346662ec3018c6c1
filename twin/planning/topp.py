"""Time-optimal motion along a path by TOPP-RA: a backward and a forward pass, with small problems solved exactly.

At each grid point, the unknowns are the squared rate x = (ds/dt)^2 and the squared rate y at the next grid point. An
acceleration limit gives two inequalities (rows) |p x + q y| <= 1 per grid interval, one for each end. The rows limit y
to a range whose width is concave and piecewise linear in x, so that Newton's method from above finds the largest x
exactly, in a few steps. The backward pass finds the largest rates from which the end can be reached at rest; the
forward pass chooses the largest possible y. Because limits are symmetric, rest is always possible, and the smallest x
is always 0.

Method: H. Pham, Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability analysis,
IEEE Trans. Robotics 34 (2018) 645-659; the two rows are their interpolation scheme.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from twin.core.errors import TimingError
from twin.core.spatial import Array

if TYPE_CHECKING:
    import casadi as ca

    from twin.codegen import Kernel

_LARGEST_SQUARED_RATE = 1e12
"""Maximum squared rate (ds/dt)^2 without a speed limit; the mean rate of the dimensionless problem is about 1."""

_LEAST_COEFFICIENT = 1e-24
"""Minimum coefficient of y, the squared rate at the next grid point.

Since y <= `_LARGEST_SQUARED_RATE`, a row changes by at most 1e-12.
"""

_ROOT_MARGIN = 1e-12
"""Fraction subtracted from each largest x, so that rounding cannot exceed the root."""

_BACKWARD_MARGIN = 1e-9
"""Fraction of the limits that the backward pass leaves unused, so that rounding cannot stop the forward pass."""

_ROW_TOLERANCE = 1e-6
"""Fraction by which a row of the result may exceed its limit; a larger excess is a failure."""

_MOST_NEWTON_STEPS = 100
"""Maximum number of Newton steps at a grid point; a few suffice, because the range is piecewise linear in x."""


def fastest(grid: Array, first: Array, second: Array, speed: Array) -> Array:
    """Return ds/dt (k,) at the grid points of the fastest motion from rest to rest.

    The problem is dimensionless: accelerations |first d2s/dt2 + second (ds/dt)^2| <= 1, a duration of the order of 1.

    Args:
        grid: (k,) values of the path parameter s, increasing.
        first: (m, k) derivatives of the m coordinates with respect to s, finite.
        second: (m, k) second derivatives with respect to s.
        speed: (m,) limits of |first ds/dt|.

    Raises:
        TimingError: no motion within the limits was found.
    """
    backward, forward = _passes(len(first))
    half = (0.5 / np.diff(grid))[None]
    arrays = (half, first[:, :-1], second[:, :-1], first[:, 1:], second[:, 1:])
    # the largest x from which the end can be reached
    (largest,) = backward(*arrays, carry=np.append(0.0, 1 / speed))
    # limit of y: the largest x at the next grid point, rest at the end
    limit = np.append(largest[:, 1:], [[0.0]], axis=1)
    x, excess = forward(*arrays, limit, carry=np.zeros(1))
    if not np.max(excess) <= _ROW_TOLERANCE:  # also if it is NaN
        raise TimingError(f"the acceleration limits cannot be met at s = {grid[np.argmax(excess)]:.4g}")
    return np.sqrt(np.append(0.0, x[0]))


@cache
def _passes(m: int) -> tuple[Kernel, Kernel]:
    """Return (backward pass, forward pass) as functions, for m coordinates."""
    import casadi as ca

    from twin.codegen import Kernel, Stage

    # half = 1 / (2 ds); first and second derivatives at both ends of the interval; inverse speed limits
    half = ca.SX.sym("half")
    x = ca.SX.sym("x")
    limit = ca.SX.sym("limit")
    d0 = ca.SX.sym("d0", m)
    dd0 = ca.SX.sym("dd0", m)
    d1 = ca.SX.sym("d1", m)
    dd1 = ca.SX.sym("dd1", m)
    inverse = ca.SX.sym("inverse", m)
    inputs = {"half": 1, "d0": m, "dd0": m, "d1": m, "dd1": m}
    arguments = [half, d0, dd0, d1, dd1]
    p = ca.vertcat(dd0 - d0 * half, -d1 * half)  # since d2s/dt2 = (y - x) / (2 ds)
    q = ca.vertcat(d0 * half, dd1 + d1 * half)
    q = ca.copysign(ca.fmax(ca.fabs(q), _LEAST_COEFFICIENT), q)

    top = 1 / ca.fmax(ca.mmax((d0 * inverse) ** 2), 1 / _LARGEST_SQUARED_RATE)
    width = (1 - _BACKWARD_MARGIN) / ca.fabs(q)
    start = ca.Function("start", [*arguments, inverse], [top, p / q, width])
    # Each row allows y from -width - slope x to width - slope x.
    slopes = ca.SX.sym("slope", 2 * m)
    widths = ca.SX.sym("width", 2 * m)
    uppers = []  # upper limits of y as lines (value, slope) over x
    lowers = []  # lower limits, with the opposite sign
    for slope, half_width in zip(ca.vertsplit(slopes), ca.vertsplit(widths), strict=True):
        uppers.append((half_width - slope * x, -slope))
        lowers.append((half_width + slope * x, slope))
    uppers.append((limit, ca.SX(0)))
    lowers.append((ca.SX(0), ca.SX(0)))
    above, above_slope = _least(uppers)
    below, below_slope = _least(lowers)
    room = above + below  # width of the range of y; it must not be negative
    root = x - room / (above_slope + below_slope)
    new = ca.if_else(room < 0, root * (1 - _ROOT_MARGIN), x)
    newton = ca.Function("newton", [x, slopes, widths, limit], [new, room < 0])
    backward = Kernel(
        [
            Stage(start, (*inputs, "inverse"), ("x", "slope", "width")),
            Stage(newton, ("x", "slope", "width", "limit"), ("x", "error"), _MOST_NEWTON_STEPS),
            Stage(ca.Function("keep", [x], [x]), ("x",), ("limit",)),
        ],
        inputs,
        ["limit"],
        carried={"limit": 1, "inverse": m},
        backwards=True,
    )

    bounds = (ca.copysign(1, q) - p * x) / q
    constant_lines = [(bound, ca.SX(0)) for bound in (*ca.vertsplit(bounds), limit)]
    largest_y, _ = _least(constant_lines)
    y = ca.fmax(largest_y, 0)
    excess = ca.mmax(ca.fabs(p * x + q * y)) - 1
    step = ca.Function("step", [*arguments, limit, x], [y, excess])
    forward = Kernel(
        [Stage(step, (*inputs, "limit", "x"), ("x", "excess"))],
        inputs | {"limit": 1},
        ["x", "excess"],
        carried={"x": 1},
    )
    return backward, forward


def _least(lines: list[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
    """Return (value, slope) of the line with the minimum value, by comparing lines (value, slope) in pairs."""
    import casadi as ca

    while len(lines) > 1:
        lower = []
        for (a, a_slope), (b, b_slope) in zip(lines[::2], lines[1::2], strict=False):
            slope = ca.if_else(a <= b, a_slope, b_slope)
            lower.append((ca.fmin(a, b), slope))
        # of an odd number of lines, the last one has no partner
        lines = lower + lines[2 * len(lower) :]
    return lines[0]
