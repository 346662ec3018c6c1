"""The closing conditions of a mechanism and their derivatives over boxes of joint values and tool poses.

A joint between two placed bodies (see `frame_paths`) closes a loop: its conditions are numbers that are zero if it
fits. Nothing here is taken from the equations: joint values and tool poses are given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import intervals
from twin.proof.frame_motion import MovedFrame, ToolBox, moved_frame
from twin.proof.frame_paths import FramePath, FramePaths
from twin.proof.interval_pose import cross
from twin.proof.intervals import Certainty, Intervals

_ROW_COUNTS = {"spherical": 3, "revolute": 5, "cylindrical": 4, "prismatic": 5, "fixed": 6, "free": 0}
"""Number of closing conditions of each type."""

_SMALLEST_REMAINDER = 1e-6
"""Length of the part of a derivative, in m or without unit, below which a condition follows from the others."""


@dataclass(frozen=True)
class Closure:
    """A joint that closes a loop.

    Attributes:
        joint: the joint.
        first, second: from the common root to the joint's frames on parent and child.
        R_root: rotation (3, 3) of the constant frame in which differences of positions are conditions.
    """

    joint: Joint
    first: FramePath
    second: FramePath
    R_root: Intervals

    @property
    def coordinates(self) -> set[int]:
        """Numbers of the coordinates in the loop."""
        return self.first.coordinates | self.second.coordinates


class ClosingConditions:
    """The closing conditions of a mechanism.

    Attributes:
        mechanism: the mechanism.
        names: joints whose coordinates are the unknowns, in order.
        active: (k,) whether a motor drives each of them.
        tolerance: by how much each coordinate of the origin of each joint's frame may differ from its number, in m.
        closures: the joints that close loops, in the order of the rows.
    """

    def __init__(self, mechanism: Mechanism, tolerance: float = 0.0) -> None:
        """Place the bodies.

        Args:
            mechanism: the mechanism.
            tolerance: by how much each coordinate of the origin of each joint's frame may differ from its number, in m.

        Raises:
            TwinError: a coupling, a free joint, a body that no joint places, or a frame that is no rotation but for
                rounding.
        """
        if mechanism.couplings:
            raise TwinError(
                f"{mechanism.name}: coupling {mechanism.couplings[0].name} between joints has no enclosure; only loops "
                "without couplings have one"
            )
        self.mechanism = mechanism
        self.tolerance = tolerance
        self._paths = FramePaths(mechanism, tolerance)
        self.names = self._paths.names
        self.active = np.array([mechanism.joint(name).active for name in self.names])
        self.closures: list[Closure] = []
        for joint in self._paths.closing:
            if joint.active:
                raise TwinError(f"{mechanism.name}: the active joint {joint.name} closes a loop; nothing encloses it")
            if joint.type != "free":
                self.closures.append(self._closure(joint))

    def _closure(self, joint: Joint) -> Closure:
        """Return a joint between two placed bodies, with paths from their last common body."""
        first, second = self._paths.to_joint(joint)
        R_root = np.eye(3)
        if joint.type != "spherical":
            # in a loop of parallel axes, the condition along the axes is then a row by itself, which follows from the
            # others
            R_root = self._paths.resting_axes(joint)
        return Closure(joint, first, second, intervals.exactly(R_root))

    @property
    def largest_redundant_gap(self) -> float:
        """Largest gap in m that tolerances can leave in a condition that follows from the others.

        Each of the two frames of each joint of a loop may be off by the tolerance along three axes.
        """
        most_frames = 0
        for closure in self.closures:
            joints = 1  # the closing one
            for path in (closure.first, closure.second):
                joints += len(path.joints)
                joints += path.carrier is not None
            most_frames = max(most_frames, 2 * joints)
        return most_frames * math.sqrt(3) * self.tolerance

    @property
    def groups(self) -> list[tuple[list[Closure], list[int]]]:
        """(closures, numbers of their coordinates) that share coordinates: at a given tool pose, each by itself."""
        # each closure joins all groups with which it shares a coordinate
        groups: list[tuple[list[Closure], set[int]]] = []
        for closure in self.closures:
            closures = [closure]
            numbers = set(closure.coordinates)
            separate_groups = []
            for group in groups:
                group_closures, group_numbers = group
                if group_numbers & numbers:
                    closures = [*group_closures, *closures]
                    numbers |= group_numbers
                else:
                    separate_groups.append(group)
            groups = [*separate_groups, (closures, numbers)]
        sorted_groups = []
        for closures, numbers in groups:
            sorted_groups.append((closures, sorted(numbers)))
        return sorted_groups

    def route(self, body: str) -> tuple[bool, tuple[tuple[Joint, int], ...]]:
        """Return whether a body is placed from the tool, and its joints: each with 1 from parent to child, else -1."""
        return self._paths.is_from_tool(body), self._paths.route(body)

    def residual(self, closures: Sequence[Closure], x: Intervals, tool: ToolBox) -> Intervals:
        """Return the closing conditions (n, rows), in m and as sines, at joint values (n, k) in m and rad."""
        conditions = []
        for closure in closures:
            first = moved_frame(closure.first, x, tool)
            second = moved_frame(closure.second, x, tool)
            conditions += _conditions(closure, first, second)
        return intervals.stack(conditions, -1)

    def jacobian(
        self, closures: Sequence[Closure], x: Intervals, tool: ToolBox, coordinates: Sequence[int]
    ) -> Intervals:
        """Return the derivatives (n, rows, columns) of `residual`.

        Columns: the coordinates with the given numbers; k to k + 5 are the tool's translation along, and rotation
        about, x, y and z of base, at the origin of the tool frame.
        """
        count = len(x)
        low = np.zeros((count, rows_of(closures), len(coordinates)))
        high = np.zeros_like(low)
        row = 0
        for closure in closures:
            first = moved_frame(closure.first, x, tool)
            second = moved_frame(closure.second, x, tool)
            for column, number in enumerate(coordinates):
                # a coordinate that moves both frames or none changes no condition
                if (number in first.axes) == (number in second.axes):
                    continue
                for i, entry in enumerate(_derivatives(closure, first, second, number)):
                    low[:, row + i, column] = entry.low
                    high[:, row + i, column] = entry.high
            row += _ROW_COUNTS[closure.joint.type]
        return Intervals(low, high)

    def cones(self, x: Intervals, tool: ToolBox) -> list[tuple[Joint, Intervals]]:
        """Return the cosine (n,) of the angle between the two z axes of each ball joint that has a largest angle."""
        cosines = []
        for closure in self.closures:
            if closure.joint.cone is None:
                continue
            first = moved_frame(closure.first, x, tool)
            second = moved_frame(closure.second, x, tool)
            cosines.append((closure.joint, _dot(first.pose.R[..., 2], second.pose.R[..., 2])))
        return cosines

    def aligned(self, x: Intervals, tool: ToolBox) -> Certainty:
        """Return where (n,) no closing joint can be turned by half a turn, which its conditions do not show.

        The conditions are sines: they are zero too where the two z axes of a joint, or the y axes of one that cannot
        turn, are opposite.
        """
        is_aligned = np.ones(len(x), bool)
        for closure in self.closures:
            kind = closure.joint.type
            if kind == "spherical":
                continue
            first = moved_frame(closure.first, x, tool).pose.R
            second = moved_frame(closure.second, x, tool).pose.R
            is_aligned &= _dot(first[..., 2], second[..., 2]) > 0.0
            if kind in ("prismatic", "fixed"):
                is_aligned &= _dot(first[..., 1], second[..., 1]) > 0.0
        return is_aligned


def rows_of(closures: Sequence[Closure]) -> int:
    """Return the number of closing conditions."""
    count = 0
    for closure in closures:
        count += _ROW_COUNTS[closure.joint.type]
    return count


def are_lengths(closures: Sequence[Closure]) -> list[bool]:
    """Return of each closing condition whether it is a length in m; the others are sines."""
    are_lengths_of_all = []
    for closure in closures:
        kind = closure.joint.type
        lengths = 3
        if kind in ("cylindrical", "prismatic"):
            lengths = 2  # their origins may differ along the axis
        sines = _ROW_COUNTS[kind] - lengths
        are_lengths_of_all += [True] * lengths + [False] * sines
    return are_lengths_of_all


def _conditions(closure: Closure, first: MovedFrame, second: MovedFrame) -> list[Intervals]:
    """Return the numbers (n,) that are zero if a joint fits between its two frames."""
    kind = closure.joint.type
    shift = second.pose.p - first.pose.p
    conditions = _offset_rows(closure, first, shift)
    if kind != "spherical":
        conditions += _axis_sines(kind, first, second.pose.R[..., 2], second.pose.R[..., 1])
    return conditions


def _offset_rows(closure: Closure, first: MovedFrame, shift: Intervals) -> list[Intervals]:
    """Return the conditions of a shift d (n, 3), or of its derivative.

    Where both origins must meet, they may be in a constant frame; a slide needs the frame of the joint.
    """
    kind = closure.joint.type
    if kind in ("cylindrical", "prismatic"):
        return [_dot(first.pose.R[..., 0], shift), _dot(first.pose.R[..., 1], shift)]
    if kind == "spherical":
        return _coordinates(shift)
    return _coordinates(intervals.product(shift, closure.R_root))


def _coordinates(vectors: Intervals) -> list[Intervals]:
    """Return x, y and z (n,) of vectors (n, 3)."""
    return [vectors[..., 0], vectors[..., 1], vectors[..., 2]]


def _dot(a: Intervals, b: Intervals) -> Intervals:
    """Return the scalar products (n,) of vectors (n, 3)."""
    return intervals.total(a * b, -1)


def _axis_sines(kind: str, first: MovedFrame, z: Intervals, y: Intervals) -> list[Intervals]:
    """Return the conditions of the second frame's z and y axes, or of their derivatives (n, 3)."""
    sines = [_dot(first.pose.R[..., 0], z), _dot(first.pose.R[..., 1], z)]
    if kind in ("prismatic", "fixed"):
        sines.append(_dot(first.pose.R[..., 0], y))
    return sines


def _derivatives(closure: Closure, first: MovedFrame, second: MovedFrame, number: int) -> list[Intervals]:
    """Return the derivatives of the conditions by a coordinate that moves one of the two frames.

    Seen from the first frame, a motion of it is the opposite motion of the second one.
    """
    kind = closure.joint.type
    moves_first = number in first.axes
    if moves_first:
        axis, lever = first.axes[number]
        axis = -axis
    else:
        axis, lever = second.axes[number]
    zero = intervals.exactly(np.zeros(3))
    if lever is None:
        move = axis
        turn_z = zero
        turn_y = zero
    else:
        if moves_first and kind in ("cylindrical", "prismatic"):
            # these conditions are in the frame that moves: the vector to the other origin counts
            lever = lever + (second.pose.p - first.pose.p)
        move = cross(axis, lever)
        turn_z = cross(axis, second.pose.R[..., 2])
        turn_y = cross(axis, second.pose.R[..., 1])
    derivatives = _offset_rows(closure, first, move)
    if kind != "spherical":
        derivatives += _axis_sines(kind, first, turn_z, turn_y)
    return derivatives


def independent_rows(J: Array, unknowns: Sequence[int]) -> list[int]:
    """Return as many rows of a matrix (rows, columns) as there are unknowns, so that they determine the unknowns.

    Raises:
        TwinError: the conditions do not determine the unknowns.
    """
    # Gram and Schmidt with the row of the largest remainder first
    remainder = np.array(J[:, list(unknowns)], float)
    rows: list[int] = []
    for _ in unknowns:
        sizes = np.linalg.norm(remainder, axis=1)
        row = int(sizes.argmax())
        if sizes[row] < _SMALLEST_REMAINDER:
            raise TwinError(f"the loops leave {len(unknowns) - len(rows)} of {len(unknowns)} joint values free")
        unit = remainder[row] / sizes[row]
        remainder = remainder - np.outer(remainder @ unit, unit)
        rows.append(row)
    return sorted(rows)
