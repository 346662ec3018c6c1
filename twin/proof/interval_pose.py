"""Poses of intervals: a rotation and a position, for many boxes at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.proof import intervals
from twin.proof.intervals import Intervals
from twin.proof.rigid_frame import RigidFrame


@dataclass(frozen=True, eq=False)
class IntervalPose:
    """Poses of a frame in another frame.

    Attributes:
        R: rotations (..., 3, 3).
        p: positions (..., 3) in m.
    """

    R: Intervals
    p: Intervals

    def then(self, other: IntervalPose) -> IntervalPose:
        """Return the poses of a frame whose pose in this frame is `other`."""
        return IntervalPose(intervals.product(self.R, other.R), self.point(other.p))

    def point(self, p: Intervals) -> Intervals:
        """Return points (..., 3) of this frame in the other one."""
        return column(intervals.product(self.R, p[..., None])) + self.p

    def turned(self, angle: Intervals) -> IntervalPose:
        """Return the poses after a rotation about z by angles (...) in rad."""
        c = intervals.cosine(angle)[..., None]
        s = intervals.sine(angle)[..., None]
        x = self.R[..., 0]
        y = self.R[..., 1]
        first = c * x + s * y
        second = c * y - s * x
        return IntervalPose(intervals.stack([first, second, self.R[..., 2]], -1), self.p)

    def shifted(self, distance: Intervals) -> IntervalPose:
        """Return the poses after a translation along z by distances (...) in m."""
        return IntervalPose(self.R, self.p + self.R[..., 2] * distance[..., None])

    def inverse(self) -> IntervalPose:
        """Return the inverse poses, of those in the intervals whose rotations are orthogonal."""
        R = intervals.transposed(self.R)
        return IntervalPose(R, -column(intervals.product(R, self.p[..., None])))


def column(matrix: Intervals) -> Intervals:
    """Return the only column (..., m) of matrices (..., m, 1)."""
    return matrix[..., 0]


def fixed(frame: RigidFrame) -> IntervalPose:
    """Return the pose of a frame of the CAD; it contains one whose rotation is orthogonal."""
    R = frame.T[:3, :3]
    p = frame.T[:3, 3]
    # a number without a radius is exact: `around` would widen it by a rounding
    rotation = intervals.exactly(R)
    if frame.R_radius > 0:
        rotation = intervals.around(R, frame.R_radius)
    position = intervals.exactly(p)
    if frame.p_radius.any():
        position = intervals.around(p, frame.p_radius)
    return IntervalPose(rotation, position)


def identity() -> IntervalPose:
    """Return the pose of a frame in itself."""
    return IntervalPose(intervals.exactly(np.eye(3)), intervals.exactly(np.zeros(3)))


def cross(a: Intervals, b: Intervals) -> Intervals:
    """Return the cross products (..., 3) of vectors."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return intervals.stack([x, y, z], -1)
