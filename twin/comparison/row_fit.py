"""The fit of a base frame, a tool frame and changed joints to rows of poses: T_row = X T(q) Y."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.side import PoseRows
from twin.comparison.tool_motion import FRAME_UNKNOWNS, ChainMotion, FixedMotion, JointChange, columns_of
from twin.core import spatial
from twin.core.spatial import Array

LEVER = 1.0 / ANGLE_PER_LENGTH
"""Length in m by which an angle in rad counts as much as a distance."""

_MAX_STEPS = 25
"""Maximum number of Gauss-Newton steps."""

_DIFFERENCE_STEP = 1e-6
"""Step of the unknowns in m and rad for derivatives by differences."""

_FIRST_DAMPING = 1e-9
"""Damping of the first step, relative to the largest diagonal element of the normal matrix."""

_SMALLEST_DAMPING = 1e-12
"""Damping below which it no longer changes a step."""

_LARGEST_DAMPING = 10.0
"""Damping above which steps no longer lead anywhere."""

_DAMPING_GROWTH = 30
"""Factor of the damping after a step that did not lower the remainder."""

_DAMPING_REDUCTION = 10
"""Divisor of the damping after a step that lowered it."""

_CONVERGED_SHARE = 1e-7
"""Part of the sum of squares that a step must remove, or the fit has ended."""

_RANK_RATIO = 1e-13
"""Size of a singular value of the normal matrix, relative to the largest, below which a direction is open."""

_TOOL_OFFSET = 0.1
"""Distance in m from the tool of points that are tried as the measured one, where rows have no rotations."""


@dataclass
class RowState:
    """Unknowns of a fit and its remainder.

    Attributes:
        signs: (joints,).
        changes: changed zeros and places.
        x: base (6), tool (6), then the values of the changes, see `tool_motion.columns_of`.
        free: (unknowns,) which of them are fitted.
        r: (rows * 3 or 6) remainder in units of the noise, or in m.
        J: its derivatives by the free unknowns.
    """

    signs: Array
    changes: tuple[JointChange, ...]
    x: Array
    free: NDArray[np.bool_]
    r: Array
    J: Array

    @property
    def sse(self) -> float:
        """Sum of the squares of the remainder."""
        return float(self.r @ self.r)


class RowFit:
    """The remainder of rows of poses, and the unknowns with which it is smallest.

    Attributes:
        rows: the rows.
        motion: the tool of the robot at the joint values of the rows.
        scale: standard deviation of a coordinate in m if the rows state it, else 1 m.
        lever: length in m by which an angle in rad counts as much as a distance.
    """

    def __init__(self, rows: PoseRows, motion: FixedMotion | ChainMotion, lever: float | None = None) -> None:
        """Take the lever in m; None: the ratio of both kinds of noise that the rows state, or else `LEVER`."""
        self.rows = rows
        self.motion = motion
        length, angle = rows.noise
        self.scale = length or 1.0
        self.lever = LEVER
        # stated noise weighs both kinds of numbers: each then has a standard deviation of 1
        if length is not None and angle is not None:
            self.lever = length / angle
        if lever is not None:
            self.lever = lever

    def shifts_and_turns(self, x: Array, signs: Array, changes: Sequence[JointChange]) -> tuple[Array, Array]:
        """Return the shifts (k, 3) in m and rotation vectors (k, 3) in rad from the computed to the stated poses."""
        zeros = np.zeros(self.motion.count)
        places: dict[int, Array] = {}
        for change, columns in columns_of(changes):
            if change.kind == "zero":
                zeros[change.joint] = x[columns.start]
            else:
                places[change.joint] = x[columns]
        X, Y = base_and_tool(x)
        T = X @ self.motion.poses(signs, zeros, places) @ Y
        shifts = T[:, :3, 3] - self.rows.T[:, :3, 3]
        if not self.rows.rotations:
            return shifts, np.zeros_like(shifts)
        turns = spatial.log_so3(np.swapaxes(self.rows.T[:, :3, :3], 1, 2) @ T[:, :3, :3])
        return shifts, turns

    def residual(self, x: Array, signs: Array, changes: Sequence[JointChange]) -> Array:
        """Return the remainder (rows * 3 or 6,) in units of `scale`; angles count by the lever."""
        shifts, turns = self.shifts_and_turns(x, signs, changes)
        values = [shifts.ravel()]
        if self.rows.rotations:
            values.append(self.lever * turns.ravel())
        return np.concatenate(values) / self.scale

    def refined(
        self, signs: Array, changes: tuple[JointChange, ...], x: Array, free: NDArray[np.bool_] | None = None
    ) -> RowState:
        """Return the unknowns after damped Gauss-Newton steps from x (unknowns,).

        `free` (unknowns,) are those that are fitted. None: all that the rows can determine.
        """
        if free is None:
            free = np.ones(len(x), bool)
            if not self.rows.rotations:
                free[6:9] = False  # positions do not depend on the rotation of the tool frame
        columns = np.flatnonzero(free)
        r = self.residual(x, signs, changes)
        damping = _FIRST_DAMPING
        J = self.derivatives(x, signs, changes, columns, r)
        for _ in range(_MAX_STEPS):
            gradient = J.T @ r
            normal = J.T @ J
            size = np.diag(normal).max() if len(columns) else 0.0
            damped = normal + damping * size * np.eye(len(columns))
            step = np.linalg.lstsq(damped, -gradient, rcond=_RANK_RATIO)[0]
            x_tried = x.copy()
            x_tried[columns] += step
            r_tried = self.residual(x_tried, signs, changes)
            before = float(r @ r)
            after = float(r_tried @ r_tried)
            if after < before:
                x = x_tried
                r = r_tried
                damping = max(damping / _DAMPING_REDUCTION, _SMALLEST_DAMPING)
                J = self.derivatives(x, signs, changes, columns, r)
                if before - after < _CONVERGED_SHARE * before:
                    break
            else:
                damping *= _DAMPING_GROWTH
                if damping > _LARGEST_DAMPING:
                    break
        return RowState(signs, changes, x, free, r, J)

    def derivatives(
        self, x: Array, signs: Array, changes: Sequence[JointChange], columns: NDArray[np.intp], r: Array
    ) -> Array:
        """Return the derivatives (rows * 3 or 6, columns) of the residual r by some unknowns, by differences."""
        J = np.zeros((len(r), len(columns)))
        for k, column in enumerate(columns):
            shifted = x.copy()
            shifted[column] += _DIFFERENCE_STEP
            J[:, k] = (self.residual(shifted, signs, changes) - r) / _DIFFERENCE_STEP
        return J

    def frames_alone(self, signs: Array) -> RowState:
        """Return the best fit of base and tool frame alone."""
        T = self.motion.poses(signs, np.zeros(self.motion.count), {})
        best: RowState | None = None
        for x in self._starts(T):
            state = self.refined(signs, (), x)
            if best is None or state.sse < best.sse:
                best = state
        assert best is not None
        return best

    def best_start(self, T: Array, signs: Array) -> Array:
        """Return the start with the smallest sum of absolute residuals for poses T (k, 4, 4) of the robot's tool."""
        starts = list(self._starts(T))
        # absolute, not squared: rows of a joint in another place must not outweigh those that fit
        sums = []
        for start in starts:
            r = self.residual(start, signs, ())
            sums.append(float(np.abs(r).sum()))
        return starts[int(np.argmin(sums))]

    def _starts(self, T: Array) -> Iterator[Array]:
        """Yield values (12,) of base and tool frame to begin with, for poses T (k, 4, 4) of the robot's tool."""
        yield np.zeros(FRAME_UNKNOWNS)  # frames that are not moved
        if self.rows.rotations:
            yield _from_relative_motions(T, self.rows.T)
            return
        # without rotations, the measured point in the tool frame is not known: some points around the tool are tried
        for p_tool_point in (np.zeros(3), *(_TOOL_OFFSET * np.eye(3)), *(-_TOOL_OFFSET * np.eye(3))):
            points = T[:, :3, :3] @ p_tool_point + T[:, :3, 3]
            # the rotations of the robot's tool are known: only base and point remain
            R, p = _nearest_motion(points, self.rows.T[:, :3, 3])
            yield np.concatenate([spatial.log_so3(R), p, np.zeros(3), p_tool_point])


def base_and_tool(x: Array) -> tuple[Array, Array]:
    """Return base and tool frame (4, 4) of unknowns x, which begin with those of the two frames."""
    base = spatial.pose(spatial.exp_so3(x[:3]), x[3:6])
    tool = spatial.pose(spatial.exp_so3(x[6:9]), x[9:12])
    return base, tool


def _from_relative_motions(T: Array, target: Array) -> Array:
    """Return start values (12,) of base and tool frame with target = X T Y, for poses (k, 4, 4).

    From relative motions, as hand-eye calibration: target_i target_0^-1 = X (T_i T_0^-1) X^-1. The rotation of X maps
    rotation vectors onto each other, its shift is then a linear problem.
    """
    target_motions = target @ spatial.inverse(target[0])
    motions = T @ spatial.inverse(T[0])
    target_turns = spatial.log_so3(target_motions[:, :3, :3])
    turns = spatial.log_so3(motions[:, :3, :3])
    R = _nearest_rotation(target_turns.T @ turns)
    # R_target p + p_target = R p_motion + p for each pair of relative motions, with the shift p of X
    coefficients = (target_motions[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right_side = (motions[:, :3, 3] @ R.T - target_motions[:, :3, 3]).ravel()
    p = np.linalg.lstsq(coefficients, right_side, rcond=1e-9)[0]
    X = spatial.pose(R, p)
    Y = spatial.inverse(X @ T[0]) @ target[0]
    parts = [spatial.log_so3(R), p, spatial.log_so3(Y[:3, :3]), Y[:3, 3]]
    return np.concatenate(parts)


def _nearest_motion(points: Array, targets: Array) -> tuple[Array, Array]:
    """Return rotation (3, 3) and shift (3,) that bring points (k, 3) nearest to targets (k, 3)."""
    middle = points.mean(axis=0)
    target_middle = targets.mean(axis=0)
    R = _nearest_rotation((targets - target_middle).T @ (points - middle))
    return R, target_middle - R @ middle


def _nearest_rotation(covariance: Array) -> Array:
    """Return the rotation (3, 3) that turns vectors b nearest to vectors a, for their sum of a b^T (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(covariance)
    handedness = np.linalg.det(U @ Vt)  # -1 for a reflection, which no rigid motion is
    return U @ np.diag([1.0, 1.0, handedness]) @ Vt
