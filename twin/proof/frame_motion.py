"""A frame at the end of a path over boxes of joint values and tool poses, and how each coordinate moves it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.proof import interval_pose, intervals
from twin.proof.frame_paths import FramePath, PathStep
from twin.proof.interval_pose import IntervalPose
from twin.proof.intervals import Intervals


@dataclass(frozen=True, eq=False)
class ToolBox:
    """Poses of the tool frame in base, for n boxes.

    Attributes:
        pose: the poses, with R (n, 3, 3) and p (n, 3).
    """

    pose: IntervalPose


@dataclass(eq=False)
class MovedFrame:
    """A moved frame and how each coordinate moves it.

    Attributes:
        pose: pose of the frame in its root.
        axes: {coordinate: (direction (n, 3) of its axis, vector (n, 3) from the axis to the frame)}; no vector for a
            translation. The vector is the sum of the steps after the joint, because a difference of two positions
            would contain the widths of both.
    """

    pose: IntervalPose
    axes: dict[int, tuple[Intervals, Intervals | None]] = field(default_factory=dict)

    def follow(self, step: Intervals) -> None:
        """Add a step of the frame to the vectors."""
        for number, (axis, lever) in self.axes.items():
            if lever is not None:
                self.axes[number] = axis, lever + step


def moved_frame(path: FramePath, x: Intervals, tool: ToolBox) -> MovedFrame:
    """Return the frame at the end of a path, and how the coordinates move it.

    Args:
        path: the path.
        x: joint values (n, k) in m and rad.
        tool: poses of the tool; their translations and rotations are the coordinates k to k + 5.
    """
    frame = MovedFrame(interval_pose.identity())
    zero = intervals.exactly(np.zeros(3))
    pose = frame.pose
    if path.from_tool:
        pose = tool.pose
        coordinates = x.shape[1]
        for axis in range(3):
            direction = intervals.exactly(np.eye(3)[axis])
            frame.axes[coordinates + axis] = direction, None
            frame.axes[coordinates + 3 + axis] = direction, zero
    for before, step in path.joints:
        frame.follow(_turned_by(pose.R, before.p))
        pose = pose.then(before)
        value = x[:, step.joint] * float(step.sign)
        axis = pose.R[..., 2] * float(step.sign)
        if step.turns:
            frame.axes[step.joint] = axis, zero
            pose = pose.turned(value)
        else:
            frame.follow(pose.R[..., 2] * value[:, None])
            frame.axes[step.joint] = axis, None
            pose = pose.shifted(value)
    frame.follow(_turned_by(pose.R, path.end.p))
    frame.pose = pose.then(path.end)
    if path.carrier is not None:
        before, step = path.carrier
        return _seen_from(frame, before, step, x)
    return frame


def _turned_by(R: Intervals, vector: Intervals) -> Intervals:
    """Return vectors (n, 3) turned by rotations (n, 3, 3)."""
    return interval_pose.column(intervals.product(R, vector[..., None]))


def _seen_from(frame: MovedFrame, before: IntervalPose, step: PathStep, x: Intervals) -> MovedFrame:
    """Return a frame as it is seen from a body that a revolute joint moves; `before`: pose of this joint's frame."""
    R = intervals.transposed(before.turned(x[:, step.joint] * float(step.sign)).R)
    p = _turned_by(R, frame.pose.p - before.p)
    relative_frame = MovedFrame(IntervalPose(intervals.product(R, frame.pose.R), p))
    for number, (axis, lever) in frame.axes.items():
        turned_lever = None
        if lever is not None:
            turned_lever = _turned_by(R, lever)
        relative_frame.axes[number] = _turned_by(R, axis), turned_lever
    # the joint turns the body, hence what is seen from it backwards
    axis = intervals.exactly(np.array([[0.0, 0.0, -float(step.sign)]]))
    relative_frame.axes[step.joint] = axis, relative_frame.pose.p
    return relative_frame
