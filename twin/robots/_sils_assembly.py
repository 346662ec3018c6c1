"""Find all assemblies of the SILS robot for given carriages: each ball centre is on a circle about its rail.

The carriages fix the distance rho_i of each ball from its rail, and its position a_i along the rail. Three angles
alpha_i remain unknown, and the three sides of the platform determine them. DERIVED; no published equation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array

_SCANNED_ANGLES = 2048
"""Number of scanned angles alpha_1; two assemblies whose alpha_1 differ by less than 0.2 deg may both be missed."""

_BISECTIONS = 50
"""Number of halvings of an interval: a step of the grid, 3e-3 rad, is then below the rounding of an angle."""

_SIGMA = np.array([1.0, -1.0, 1.0])


def branches(q: Array, p: Mapping[str, float], variants: Mapping[str, str]) -> list[Array]:
    """Return the poses (4, 4) of all assemblies at q (6,) for a rigid platform, unsorted, not refined by Newton steps.

    Assemblies with a bar that leans inwards beyond its pivot (rho < l_0) are omitted, because they are unreachable.
    """
    if variants["eq2"] == "literal":
        return []  # for this variant, rho does not follow from the carriage gap in closed form
    L = p["l_1"] + p["l_2"]
    odd = q[0::2]
    even = q[1::2]
    h = _SIGMA * (even - odd) * L / (2 * p["l_1"])
    if np.any(h < 0) or np.any(h > L):
        return []
    a = (odd if variants["eq2"] == "printed" else even) - _SIGMA * h
    rho = p["l_0"] + np.sqrt(L**2 - h**2)
    # Circle i: centre o, and the directions of alpha = 0 and alpha = 90 deg.
    o = np.array([[0, 0, a[0]], [0, a[1], p["L_V"]], [0, p["L_H"], a[2]]])
    u = np.tile([1.0, 0.0, 0.0], (3, 1))
    v = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])

    def ball(i: int, angle: Array) -> Array:
        return o[i] + rho[i] * (np.cos(angle)[:, None] * u[i] + np.sin(angle)[:, None] * v[i])

    def meet(i: int, P: Array, sign: int) -> Array:
        """Return the angles (m,) of the points on circle i at distance l_p from P (m, 3): solution `sign`, or NaN."""
        w = P - o[i]
        # |circle point - P| = l_p is A cos(angle) + B sin(angle) = C.
        A = rho[i] * (w @ u[i])
        B = rho[i] * (w @ v[i])
        C = (np.sum(w * w, axis=1) + rho[i] ** 2 - p["l_p"] ** 2) / 2
        ratio = C / np.hypot(A, B)
        inside = np.abs(ratio) <= 1
        return np.where(inside, np.arctan2(B, A) + sign * np.arccos(np.where(inside, ratio, 0.0)), np.nan)

    def gap(alpha: Array, s2: int, s3: int) -> Array:
        """Return by how much the side S2 S3 is longer than l_p, in m; the other two sides are l_p."""
        S1 = ball(0, alpha)
        S2 = ball(1, meet(1, S1, s2))
        S3 = ball(2, meet(2, S1, s3))
        return np.linalg.norm(S2 - S3, axis=1) - p["l_p"]

    grid = np.linspace(-np.pi, np.pi, _SCANNED_ANGLES + 1)
    # At the edges of the range with solutions, the two sign branches meet. A root may be between the last grid angle
    # and such an edge, so the edges are added to the grid.
    grid = np.unique(np.concatenate([grid, _edges(grid, lambda x: np.isfinite(gap(x, 1, 1)))]))
    poses = []
    for s2 in (1, -1):
        for s3 in (1, -1):
            values = gap(grid, s2, s3)
            below = np.flatnonzero(values[:-1] * values[1:] < 0)
            roots = _bisect(lambda x, s2=s2, s3=s3: gap(x, s2, s3), grid[below], grid[below + 1])
            exact = grid[:-1][values[:-1] == 0]
            for alpha in np.concatenate([roots, exact]):
                S1 = ball(0, np.array([alpha]))
                S = np.vstack([S1, ball(1, meet(1, S1, s2)), ball(2, meet(2, S1, s3))])
                if np.isfinite(S).all():
                    poses.append(_platform(S))
    return poses


def _edges(grid: Array, inside) -> Array:
    """Return the angles at which `inside` changes between two grid points; `inside` is true at these angles."""
    flags = inside(grid)
    before = np.flatnonzero(flags[:-1] != flags[1:])
    inner = np.where(flags[before], grid[before], grid[before + 1])
    outer = np.where(flags[before], grid[before + 1], grid[before])
    for _ in range(_BISECTIONS):
        middle = (inner + outer) / 2
        is_inside = inside(middle)
        inner = np.where(is_inside, middle, inner)
        outer = np.where(is_inside, outer, middle)
    return inner


def _bisect(f, low: Array, high: Array) -> Array:
    """Return a root of `f` in each interval from `low` (n,) to `high` (n,), at whose ends its signs differ."""
    f_low = f(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        f_middle = f(middle)
        is_below = f_low * f_middle <= 0  # the root is in the lower half
        low = np.where(is_below, low, middle)
        high = np.where(is_below, middle, high)
        f_low = np.where(is_below, f_low, f_middle)
    return (low + high) / 2


def _platform(S: Array) -> Array:
    """Return the pose (4, 4) of a platform with ball centres S (3, 3): y from S1 to S3, x from S2."""
    E = S.mean(axis=0)
    y = (S[2] - S[0]) / np.linalg.norm(S[2] - S[0])
    x = (E - S[1]) / np.linalg.norm(E - S[1])
    return spatial.pose(np.column_stack([x, y, np.cross(x, y)]), E)
