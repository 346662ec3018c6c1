"""Continuation along targets (joint values or tool poses): select the knots, and compute guesses between them."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index

_EVERY = 32
"""Maximum number of samples from one knot (a sample solved from the previous knot) to the next."""

_TRAVEL = 0.1
"""Maximum motion (m, rad) of the target between knots, so that interpolation stays in the assembly mode."""


def knots(targets: Array) -> Index:
    """Return the indices of the knots (samples that are solved in order): the first, the last, and some between."""
    if len(targets) < 2:
        return np.zeros(len(targets), np.intp)
    change = np.abs(np.diff(targets, axis=0))
    largest = change.reshape(len(targets) - 1, -1).max(axis=1, initial=0.0)
    travel = np.concatenate([[0.0], np.cumsum(largest)])
    last = len(targets) - 1
    at = [0]
    while at[-1] < last:
        k = at[-1]
        farthest = int(np.searchsorted(travel, travel[k] + _TRAVEL, side="right")) - 1
        # at least the next sample, even if the target jumps
        farthest = max(farthest, k + 1)
        at.append(min(k + _EVERY, farthest, last))
    return np.array(at)


def distance(a: Array, b: Array) -> float:
    """Return the distance of two targets in m or rad.

    The distance of joint values is the largest difference; the distance of poses is the larger of the translation and
    the rotation angle.
    """
    if a.ndim == 1:
        return float(np.abs(a - b).max(initial=0.0))
    turn = float(spatial.rotation_angle(a[:3, :3].T @ b[:3, :3]))
    shift = float(np.linalg.norm(a[:3, 3] - b[:3, 3]))
    return max(shift, turn)


def between(a: Array, b: Array, s: float) -> Array:
    """Return the target at fraction s from a to b; position and rotation of a pose are interpolated separately."""
    if s == 1:
        return b
    if a.ndim == 1:
        return a + s * (b - a)
    R_a = a[:3, :3]
    p_a = a[:3, 3]
    turn = spatial.log_so3(b[:3, :3] @ R_a.T)
    R = spatial.exp_so3(s * turn) @ R_a
    p = p_a + s * (b[:3, 3] - p_a)
    return spatial.pose(R, p)


def interpolate(at: Index, knots: Array, slopes: Array, count: int) -> Array:
    """Interpolate rows 0 to count - 1 by cubic Hermite polynomials through `knots` at rows `at` with `slopes`."""
    if len(at) < 2:
        return np.tile(knots, (count, 1))
    row = np.arange(count)
    i = np.clip(np.searchsorted(at, row, side="right") - 1, 0, len(at) - 2)
    width = (at[i + 1] - at[i])[:, None].astype(float)
    s = (row - at[i])[:, None] / width
    return spatial.cubic(s, knots[i], knots[i + 1], slopes[i] * width, slopes[i + 1] * width)
