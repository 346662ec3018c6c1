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

_DIFFERENCE_STEP = 1e-6
"""Step of the finite differences, in m and rad."""

_MAX_RESIDUAL = 1e-5
"""Residual in m and rad below which a solution is accepted; rounding of poses causes residuals of this size."""

_MAX_ITERATIONS = 30
"""Maximum number of Gauss-Newton steps from one starting point."""

_MIN_STEP = 1e-12
"""Largest entry, in m and rad, of a Gauss-Newton step after which the iteration has converged."""

_MAX_STEP = 0.5
"""Largest entry in m and rad of a Gauss-Newton step: longer ones leave the range where the linearisation holds."""

_DAMPING = 1e-12
"""Number added to the diagonal of the normal equations: a joint without influence would make them singular."""

_START_VALUES = (0.0, 1.3, -1.3)
"""Values of free joints from which a search starts, in rad or m: the middle, and about 75 degrees to both sides."""

_MAX_RESTARTS = 24
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


def chain_end(steps: Sequence[ChainStep], values: Sequence[Array | None], count: int) -> Array:
    """Return the poses (k, 4, 4) of the end of a chain relative to the start of the chain.

    `values` contains, for each step, the joint values (k,) in rad or m, or None for a step without a joint. `count` is
    k.
    """
    T_start_end = np.broadcast_to(np.eye(4), (count, 4, 4))
    for step, step_values in zip(steps, values, strict=True):
        T_start_end = T_start_end @ step.poses(step_values)
    return T_start_end


def solve_chain(steps: Sequence[ChainStep], known_values: Sequence[Array | None], goal: Array) -> list[Array | None]:
    """Compute the joint values (k,), in rad or m, for which the end of a chain has the poses `goal` (k, 4, 4).

    Joint values that are None in `known_values` are computed with Gauss-Newton for all keys at once, from zero. Keys
    that do not converge are restarted, by turns from the solution of the nearest key that converged and from values of
    `_START_VALUES`. If a goal cannot be reached, the best result is returned. The later comparison of poses detects the
    remaining error.
    """
    count = len(goal)
    free_steps = []
    for number, (step, step_values) in enumerate(zip(steps, known_values, strict=True)):
        if step_values is None and step.kind != "fixed":
            free_steps.append(number)
    if not free_steps:
        return list(known_values)
    q, errors = _gauss_newton(steps, known_values, free_steps, np.zeros((len(free_steps), count)), goal)
    # Only the first three free joints start elsewhere: they have more combinations than tries already.
    starts = iter(product(_START_VALUES, repeat=min(len(free_steps), 3)))
    for attempt in range(_MAX_RESTARTS):
        unsolved = errors > _MAX_RESIDUAL
        if not unsolved.any():
            break
        solved = np.flatnonzero(~unsolved)
        if len(solved) and attempt % 2 == 0:  # start from the nearest solved key, because a motion is continuous
            start_values = q[:, nearest_keys(solved, np.flatnonzero(unsolved))]
        else:
            start_values = np.zeros((len(free_steps), int(unsolved.sum())))
            start = next(starts, None)
            if start is None:
                break
            start_values[: len(start)] = np.array(start)[:, None]
        rows: list[Array | None] = []
        for step_values in known_values:
            rows.append(None if step_values is None else step_values[unsolved])
        new_q, new_errors = _gauss_newton(steps, rows, free_steps, start_values, goal[unsolved])
        better = new_errors < errors[unsolved]
        q[:, unsolved] = np.where(better, new_q, q[:, unsolved])
        errors[unsolved] = np.where(better, new_errors, errors[unsolved])
    joint_values = list(known_values)
    for row, number in enumerate(free_steps):
        joint_values[number] = q[row]
    return joint_values


def nearest_keys(solved: Array, keys: Array) -> Array:
    """Return for each of the indices `keys` (m,) the nearest of the increasing indices `solved` (k,), k at least 1.

    Of two that are equally near, the earlier one is returned.
    """
    following = np.searchsorted(solved, keys)
    later = solved[np.minimum(following, len(solved) - 1)]
    earlier = solved[np.maximum(following - 1, 0)]
    is_later_nearer = np.abs(later - keys) < np.abs(earlier - keys)
    return np.where(is_later_nearer, later, earlier)


def _gauss_newton(
    steps: Sequence[ChainStep], known_values: Sequence[Array | None], free_steps: list[int], q: Array, goal: Array
) -> tuple[Array, Array]:
    """Return (values (f, k) of the free joints after Gauss-Newton from q (f, k), residuals (k,) in m and rad)."""
    values = list(known_values)

    def residual(x: Array) -> Array:
        """Return the differences (k, 6) in position and rotation of the end of the chain from its goals."""
        for row, i in enumerate(free_steps):
            values[i] = x[row]
        T = chain_end(steps, values, x.shape[1])
        relative_rotation = np.swapaxes(goal[:, :3, :3], 1, 2) @ T[:, :3, :3]
        xyzw = poses.quaternion(
            relative_rotation
        )  # |vector part| = sin(angle / 2) increases up to 180 deg; sin(angle) does not
        sign = np.where(xyzw[:, 3:] < 0, -1.0, 1.0)
        turn = 2 * xyzw[:, :3] * sign
        shift = T[:, :3, 3] - goal[:, :3, 3]
        return np.concatenate([shift, turn], axis=1)

    unit = np.eye(len(free_steps))
    residuals = residual(q)
    for _ in range(_MAX_ITERATIONS):
        columns = []
        for j in range(len(free_steps)):
            shifted_residuals = residual(q + _DIFFERENCE_STEP * unit[:, j, None])
            columns.append((shifted_residuals - residuals) / _DIFFERENCE_STEP)
        J = np.stack(columns, axis=2)
        J_transposed = np.swapaxes(J, 1, 2)
        normal_matrix = J_transposed @ J + _DAMPING * unit
        newton_step = np.linalg.solve(normal_matrix, J_transposed @ residuals[..., None])[..., 0]
        size = np.abs(newton_step).max(axis=1, keepdims=True)
        shortened = newton_step * np.minimum(1.0, _MAX_STEP / np.maximum(size, 1e-30))  # 1e-30: not by zero
        q = q - shortened.T
        residuals = residual(q)
        if size.max() < _MIN_STEP:
            break
    return q, np.linalg.norm(residuals, axis=1)
