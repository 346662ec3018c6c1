"""Compute poses of a chain of joints from joint values, and unknown joint values from the pose of the chain's end.

For example, a track has no column for the rotation of a ball joint. The rotation is computed from the poses of the two
links. Then the centre of the ball joint and the links beyond the joint can be checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

_STEP = 1e-6
"""Step of the finite differences, in m and rad."""

_GOOD = 1e-5
"""Residual in m and rad below which a solution is accepted; rounding of poses causes residuals of this size."""

_TRIES = 24
"""Maximum number of starting points for keys at which the iteration did not converge."""


@dataclass(frozen=True)
class ChainStep:
    """One step of a chain: a fixed pose, followed by a joint.

    Attributes:
        fixed: pose (4, 4) of the joint in the frame of the previous step.
        kind: "turn" (about the axis), "slide" (along the axis) or "fixed" (no joint).
        axis: unit vector (3,) in the frame of the joint; None if "fixed".
        name: name of the joint.
    """

    fixed: Array
    kind: str = "fixed"
    axis: Array | None = None
    name: str = ""

    def poses(self, q: Array | None) -> Array:
        """Return poses of this step in the frame of the previous step: (k, 4, 4) for q (k,), or (4, 4) if q is None."""
        if self.kind == "fixed" or q is None or self.axis is None:
            return self.fixed
        if self.kind == "turn":
            return self.fixed @ poses.pose(poses.about(self.axis, q))
        direction = self.axis / np.linalg.norm(self.axis)
        return self.fixed @ poses.pose(None, np.asarray(q)[:, None] * direction)


def along(links: Sequence[ChainStep], q: Sequence[Array | None], count: int) -> Array:
    """Return the poses (k, 4, 4) of the end of a chain relative to the start of the chain.

    `q` contains, for each step, the joint values (k,) in rad or m, or None for a step without a joint. `count` is k.
    """
    T = np.broadcast_to(np.eye(4), (count, 4, 4))
    for link, value in zip(links, q, strict=True):
        T = T @ link.poses(value)
    return T


def fit(links: Sequence[ChainStep], given: Sequence[Array | None], goal: Array) -> list[Array | None]:
    """Compute the joint values (k,), in rad or m, for which the end of a chain has the poses `goal` (k, 4, 4).

    Joint values that are None in `given` are computed with Gauss-Newton for all keys at once. Keys that do not
    converge are restarted from the solution of a neighbouring key. If a goal cannot be reached, the best result is
    returned. The later comparison of poses detects the remaining error.
    """
    count = len(goal)
    free = []
    for i, (link, values) in enumerate(zip(links, given, strict=True)):
        if values is None and link.kind != "fixed":
            free.append(i)
    if not free:
        return list(given)
    q, errors = _descend(links, given, free, np.zeros((len(free), count)), goal)
    starts = iter(product((0.0, 1.3, -1.3), repeat=min(len(free), 3)))
    for attempt in range(_TRIES):
        unsolved = errors > _GOOD
        if not unsolved.any():
            break
        solved = np.flatnonzero(~unsolved)
        if len(solved) and attempt % 2 == 0:  # start from the nearest solved key, because a motion is continuous
            following = np.searchsorted(solved, np.flatnonzero(unsolved))
            nearest = solved[np.clip(following, 0, len(solved) - 1)]
            begin = q[:, nearest]
        else:
            begin = np.zeros((len(free), int(unsolved.sum())))
            start = next(starts, None)
            if start is None:
                break
            begin[: len(start)] = np.array(start)[:, None]
        rows = [None if values is None else values[unsolved] for values in given]
        tried, new_errors = _descend(links, rows, free, begin, goal[unsolved])
        better = new_errors < errors[unsolved]
        q[:, unsolved] = np.where(better, tried, q[:, unsolved])
        errors[unsolved] = np.where(better, new_errors, errors[unsolved])
    out = list(given)
    for row, i in enumerate(free):
        out[i] = q[row]
    return out


def _descend(
    links: Sequence[ChainStep], given: Sequence[Array | None], free: list[int], q: Array, goal: Array
) -> tuple[Array, Array]:
    """Return (values (f, k) of the free joints after Gauss-Newton from q (f, k), residuals (k,) in m and rad)."""
    values = list(given)

    def residual(x: Array) -> Array:
        """Return the differences (k, 6) in position and rotation of the end of the chain from its goals."""
        for row, i in enumerate(free):
            values[i] = x[row]
        T = along(links, values, x.shape[1])
        E = np.swapaxes(goal[:, :3, :3], 1, 2) @ T[:, :3, :3]
        xyzw = poses.quaternion(E)  # |vector part| = sin(angle / 2) increases up to 180 deg; sin(angle) does not
        sign = np.where(xyzw[:, 3:] < 0, -1.0, 1.0)
        turn = 2 * xyzw[:, :3] * sign
        shift = T[:, :3, 3] - goal[:, :3, 3]
        return np.concatenate([shift, turn], axis=1)

    unit = np.eye(len(free))
    r = residual(q)
    for _ in range(30):
        columns = []
        for j in range(len(free)):
            moved = residual(q + _STEP * unit[:, j, None])
            columns.append((moved - r) / _STEP)
        J = np.stack(columns, axis=2)
        J_transposed = np.swapaxes(J, 1, 2)
        A = J_transposed @ J + 1e-12 * unit  # a joint without influence would make A singular
        step = np.linalg.solve(A, J_transposed @ r[..., None])[..., 0]
        size = np.abs(step).max(axis=1, keepdims=True)
        shortened = step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-30))  # at most 0.5 rad or m
        q = q - shortened.T
        r = residual(q)
        if size.max() < 1e-12:
            break
    return q, np.linalg.norm(r, axis=1)
