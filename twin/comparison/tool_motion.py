"""Tool poses of a robot at the joint values of rows, with changed signs, zeros and places of its joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from twin.comparison.coupled_motion import followers_of
from twin.comparison.side import ONE_COORDINATE_KINDS, RobotSide, joint_motion
from twin.comparison.tool_path import path_to_tool
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array

FRAME_UNKNOWNS = 12
"""Number of unknowns of base and tool frame: for each a rotation vector in rad, then a shift in m."""


class JointChange(NamedTuple):
    """A change of a joint: of its zero, or of its place on its parent link.

    Attributes:
        kind: "zero" (1 value in m or rad) or "place" (6 values: a rotation vector in rad, then a shift in m).
        joint: number of the joint on the path from the base to the tool.
    """

    kind: Literal["zero", "place"]
    joint: int

    @property
    def size(self) -> int:
        """Number of its values."""
        return 6 if self.kind == "place" else 1


def columns_of(changes: Sequence[JointChange]) -> Iterator[tuple[JointChange, slice]]:
    """Yield each change with the columns of its values in the unknowns, which begin with those of the two frames."""
    start = FRAME_UNKNOWNS
    for change in changes:
        yield change, slice(start, start + change.size)
        start += change.size


class FixedMotion:
    """The tool poses (k, 4, 4) of a robot with loops at the rows, whose joints cannot be changed."""

    count = 0

    def __init__(self, Ts_base_tool: Array) -> None:
        self._Ts_base_tool = Ts_base_tool

    def poses(self, signs: Array, zeros: Array, places: Mapping[int, Array]) -> Array:
        """Return T_base_tool (k, 4, 4); there is no joint to which the changes could belong."""
        return self._Ts_base_tool


class ChainMotion:
    """The joints from the base to the tool, whose signs, zeros and places can be changed.

    Attributes:
        side: the robot.
        path: the joints, the first on the base.
        count: their number.
        has_values: (count,) whether the rows have values of a joint: only then it has a sign and a zero.
    """

    def __init__(self, side: RobotSide, q: Array) -> None:
        """Take the joint values q (k, driven joints) of the rows, NaN where the rows have none.

        Raises:
            TwinError: a joint of the path has several coordinates.
        """
        self.side = side
        self.path = path_to_tool(side)
        self.count = len(self.path)
        self.has_values = np.zeros(self.count, bool)
        self._displacements = np.zeros((len(q), self.count))
        self._motions_without_zero: dict[tuple[int, float], Array] = {}
        self._T_base_tool_drawn = side.frames[side.tool][1]
        values = _stated_values(side, q)
        states = np.zeros((len(q), len(side.axes)))
        for i, axis in enumerate(side.axes):
            states[:, i] = values.get(axis.name, axis.drawn)
        coupled = followers_of(side)
        for k, axis in enumerate(self.path):
            if axis.kind not in ONE_COORDINATE_KINDS:
                raise TwinError(
                    f"{side.label}: joint '{axis.name}' has several coordinates: rows of poses cannot hold it"
                )
            if axis.name in values:
                self._displacements[:, k] = values[axis.name] - axis.drawn
                self.has_values[k] = True
                continue
            i = side.index(axis.name)
            if i in coupled:
                ratios, offset = coupled[i]
                self._displacements[:, k] = states @ ratios + offset - axis.drawn
        self._joint_frames: list[Array] = []
        for axis in self.path:
            across = spatial.unit_across(axis.direction)
            self._joint_frames.append(spatial.frame_from_axes(axis.direction, across))

    def place_motion(self, joint: int, values: Array) -> Array:
        """Return the motion (4, 4) of a joint on its parent link.

        `values` (6,) are a rotation vector in rad and a shift in m, both in the frame of the joint.
        """
        frame = self._joint_frames[joint]
        R = spatial.exp_so3(frame @ values[:3])
        point = self.path[joint].point
        return spatial.pose(R, point - R @ point + frame @ values[3:])

    def poses(self, signs: Array, zeros: Array, places: Mapping[int, Array]) -> Array:
        """Return T_base_tool (k, 4, 4).

        Args:
            signs: (count,) 1 or -1.
            zeros: (count,) in m or rad.
            places: {number of a joint: values (6,) as in `place_motion`}.
        """
        T = np.broadcast_to(np.eye(4), (len(self._displacements), 4, 4))
        for k in range(self.count):
            if k in places:
                T = T @ self.place_motion(k, places[k])
            T = T @ self._joint_motions(k, float(signs[k]), float(zeros[k]))
        return T @ self._T_base_tool_drawn

    def _joint_motions(self, joint: int, sign: float, zero: float) -> Array:
        """Return the motions (k, 4, 4) of a joint; those without a zero are kept, as they are needed most often."""
        displacements = self._displacements[:, joint]
        if zero:
            return joint_motion(self.path[joint], sign * displacements + zero)
        key = (joint, sign)
        if key not in self._motions_without_zero:
            self._motions_without_zero[key] = joint_motion(self.path[joint], sign * displacements)
        return self._motions_without_zero[key]


def _stated_values(side: RobotSide, q: Array) -> dict[str, Array]:
    """Return {driven joint: its values (k,)} of the joints of which the rows q (k, driven joints) have all values."""
    stated = {}
    for i, name in enumerate(side.driven_joints):
        if np.isfinite(q[:, i]).all():
            stated[name] = q[:, i]
    return stated
