"""The closing conditions of a mechanism and their derivatives over boxes of joint values and tool poses.

Bodies are placed from the base, and from the tool, by revolute, prismatic and fixed joints. Each other joint between
two placed bodies closes a loop: its conditions are numbers that are zero if it fits. Nothing here is taken from the
equations: joint values and tool poses are given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import interval_pose, intervals
from twin.proof.interval_pose import IntervalPose, cross
from twin.proof.intervals import Certainty, Intervals
from twin.proof.rigid_frame import joint_frames, rigid_frame

_PLACING = ("revolute", "prismatic", "fixed")
"""Types of joints that place a body."""

_ROWS = {"spherical": 3, "revolute": 5, "cylindrical": 4, "prismatic": 5, "fixed": 6, "free": 0}
"""Number of closing conditions of each type."""


@dataclass(frozen=True)
class PathStep:
    """A joint on the way from a root to a body.

    Attributes:
        before: pose of the joint frame in the previous frame.
        after: pose of the next frame in the moved joint frame.
        joint: number of the coordinate; -1 for a fixed joint.
        sign: 1 if the joint is passed from parent to child, else -1.
        turns: whether the coordinate is an angle.
    """

    before: IntervalPose
    after: IntervalPose
    joint: int
    sign: int
    turns: bool


@dataclass(frozen=True)
class FramePath:
    """The way from a root to a joint frame.

    Attributes:
        from_tool: whether the root is the tool frame, whose pose is given.
        joints: (pose of the joint frame in the previous frame, joint) of each joint with a coordinate.
        end: pose of the frame in the last joint frame.
        carrier: the same of the joint whose moved frame is the root, if this joint moves the root itself.
    """

    from_tool: bool
    joints: tuple[tuple[IntervalPose, PathStep], ...]
    end: IntervalPose
    carrier: tuple[IntervalPose, PathStep] | None = None

    @property
    def coordinates(self) -> set[int]:
        """Numbers of the coordinates that move the frame in its root."""
        steps = self.joints if self.carrier is None else (*self.joints, self.carrier)
        return {step.joint for _, step in steps}


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


@dataclass(frozen=True, eq=False)
class ToolBox:
    """Poses of the tool frame in base, for n boxes.

    Attributes:
        pose: the poses, with R (n, 3, 3) and p (n, 3).
    """

    pose: IntervalPose


@dataclass(eq=False)
class _Motion:
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
        tool = mechanism.frame(mechanism.tool)
        self._tool_body = tool.body
        self._T_tool_body = interval_pose.fixed(
            rigid_frame(tool.T_body_frame, f"{mechanism.name}: frame {mechanism.tool}")
        ).inverse()
        self._paths: dict[str, tuple[PathStep, ...]] = {mechanism.base: (), tool.body: ()}
        self._roots = {mechanism.base: mechanism.base, tool.body: tool.body}
        self._routes: dict[str, tuple[tuple[Joint, int], ...]] = {mechanism.base: (), tool.body: ()}
        self.names: list[str] = []
        closing = self._place(mechanism)
        joints = [mechanism.joint(name) for name in self.names]
        self.active = np.array([joint.active for joint in joints])
        placing = set(self.names)
        for joint in closing:
            if joint.active:
                raise TwinError(f"{mechanism.name}: the active joint {joint.name} closes a loop; nothing encloses it")
        self._limits = [joint for joint in mechanism.joints if joint.name not in placing and joint.cone is not None]
        self.closures = [self._closure(joint) for joint in closing if joint.type != "free"]

    @property
    def play(self) -> float:
        """Largest gap in m that tolerances can leave in a condition that follows from the others.

        Each of the two frames of each joint of a loop may be off by the tolerance along three axes.
        """
        most = 0
        for closure in self.closures:
            carried = sum(path.carrier is not None for path in (closure.first, closure.second))
            joints = len(closure.first.joints) + len(closure.second.joints) + carried + 1
            most = max(most, 2 * joints)
        return most * math.sqrt(3) * self.tolerance

    @property
    def groups(self) -> list[tuple[list[Closure], list[int]]]:
        """(closures, numbers of their coordinates) that share coordinates: at a given tool pose, each by itself."""
        found: list[tuple[list[Closure], set[int]]] = []
        for closure in self.closures:
            closures = [closure]
            numbers = set(closure.coordinates)
            apart = []
            for other in found:
                if other[1] & numbers:
                    closures = [*other[0], *closures]
                    numbers |= other[1]
                else:
                    apart.append(other)
            found = [*apart, (closures, numbers)]
        return [(closures, sorted(numbers)) for closures, numbers in found]

    def _place(self, mechanism: Mechanism) -> list[Joint]:
        """Place bodies from base and tool; return the joints that close loops."""
        pending = sorted(mechanism.joints, key=lambda joint: not joint.active)
        advanced = True
        while advanced:
            advanced = False
            for joint in list(pending):
                placed = {joint.parent, joint.child} & set(self._paths)
                if len(placed) != 1 or joint.type not in _PLACING:
                    continue
                self._extend(joint)
                pending.remove(joint)
                advanced = True
                break
        unplaced = {body.name for body in mechanism.bodies} - set(self._paths)
        for body in sorted(unplaced):
            if sum(body in (joint.parent, joint.child) for joint in mechanism.joints) > 1:
                raise TwinError(f"{mechanism.name}: no joint of known type places body {body} from base or tool")
        return [joint for joint in pending if not {joint.parent, joint.child} & unplaced]

    def _extend(self, joint: Joint) -> None:
        """Place the body at the other end of a joint."""
        number = -1
        if joint.type != "fixed":
            number = len(self.names)
            self.names.append(joint.name)
        first, second = self._frames(joint)
        turns = joint.type == "revolute"
        if joint.parent in self._paths:
            step = PathStep(first, second.inverse(), number, 1, turns)
            self._paths[joint.child] = (*self._paths[joint.parent], step)
            self._roots[joint.child] = self._roots[joint.parent]
            self._routes[joint.child] = (*self._routes[joint.parent], (joint, 1))
        else:
            step = PathStep(second, first.inverse(), number, -1, turns)
            self._paths[joint.parent] = (*self._paths[joint.child], step)
            self._roots[joint.parent] = self._roots[joint.child]
            self._routes[joint.parent] = (*self._routes[joint.child], (joint, -1))

    def route(self, body: str) -> tuple[bool, tuple[tuple[Joint, int], ...]]:
        """Return whether a body is placed from the tool, and its joints: each with 1 from parent to child, else -1."""
        return self._roots[body] == self._tool_body, self._routes[body]

    def _frames(self, joint: Joint) -> tuple[IntervalPose, IntervalPose]:
        """Return the frames of a joint on its parent and its child."""
        frames = joint_frames(self.mechanism.name, joint.name, joint.T_parent_joint, joint.T_child_joint)
        first, second = (replace(frame, p_radius=frame.p_radius + self.tolerance) for frame in frames)
        return interval_pose.fixed(first), interval_pose.fixed(second)

    def _closure(self, joint: Joint) -> Closure:
        """Return a joint between two placed bodies, with paths from their last common body."""
        first = self._paths[joint.parent]
        second = self._paths[joint.child]
        by_tool = [self._roots[body] == self._tool_body for body in (joint.parent, joint.child)]
        if by_tool[0] == by_tool[1]:
            shared = 0
            while shared < min(len(first), len(second)) and first[shared] is second[shared]:
                shared += 1
            first = first[shared:]
            second = second[shared:]
            by_tool = [False, False]
        ends = []
        for steps, from_tool, frame in zip((first, second), by_tool, self._frames(joint), strict=True):
            pose = self._T_tool_body if from_tool else interval_pose.identity()
            joints = []
            for step in steps:
                pose = pose.then(step.before)
                if step.joint >= 0:
                    joints.append((pose, step))
                    pose = step.after
                else:
                    pose = pose.then(step.after)
            ends.append(FramePath(from_tool, tuple(joints), pose.then(frame)))
        if joint.type == "spherical":
            ends = _in_carrier(ends[0], ends[1])
        return Closure(joint, ends[0], ends[1], intervals.exactly(self._resting_axes(joint, first, by_tool[0])))

    def _resting_axes(self, joint: Joint, first: Sequence[PathStep], from_tool: bool) -> Array:
        """Return the rotation of a joint's frame in the frame of the root where all coordinates are 0.

        In a loop of parallel axes, the condition along the axes is then a row by itself, which follows from the others.
        """
        if from_tool or joint.type == "spherical":
            return np.eye(3)
        pose = interval_pose.identity()
        for step in first:
            pose = pose.then(step.before).then(step.after)
        return pose.then(self._frames(joint)[0]).R.middle

    def residual(self, closures: Sequence[Closure], x: Intervals, tool: ToolBox) -> Intervals:
        """Return the closing conditions (n, rows), in m and as sines, at joint values (n, k) in m and rad."""
        found = []
        for closure in closures:
            first = self._moved(closure.first, x, tool)
            second = self._moved(closure.second, x, tool)
            found += _conditions(closure, first, second)
        return intervals.stack(found, -1)

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
            first = self._moved(closure.first, x, tool)
            second = self._moved(closure.second, x, tool)
            for column, number in enumerate(coordinates):
                if (number in first.axes) == (number in second.axes):
                    continue
                for i, entry in enumerate(_derivatives(closure, first, second, number)):
                    low[:, row + i, column] = entry.low
                    high[:, row + i, column] = entry.high
            row += _ROWS[closure.joint.type]
        return Intervals(low, high)

    def cones(self, x: Intervals, tool: ToolBox) -> list[tuple[Joint, Intervals]]:
        """Return the cosine (n,) of the angle between the two z axes of each ball joint that has a largest angle."""
        found = []
        for closure in self.closures:
            if closure.joint.cone is None:
                continue
            first = self._moved(closure.first, x, tool)
            second = self._moved(closure.second, x, tool)
            product = first.pose.R[..., 2] * second.pose.R[..., 2]
            found.append((closure.joint, intervals.total(product, -1)))
        return found

    def aligned(self, x: Intervals, tool: ToolBox) -> Certainty:
        """Return where (n,) no closing joint can be turned by half a turn, which its conditions do not show.

        The conditions are sines: they are zero too where the two z axes of a joint, or the y axes of one that cannot
        turn, are opposite.
        """
        found = np.ones(len(x), bool)
        for closure in self.closures:
            kind = closure.joint.type
            if kind == "spherical":
                continue
            first = self._moved(closure.first, x, tool).pose.R
            second = self._moved(closure.second, x, tool).pose.R
            found &= intervals.total(first[..., 2] * second[..., 2], -1) > 0.0
            if kind in ("prismatic", "fixed"):
                found &= intervals.total(first[..., 1] * second[..., 1], -1) > 0.0
        return found

    def _moved(self, path: FramePath, x: Intervals, tool: ToolBox) -> _Motion:
        """Return a frame at the end of a path, and how the coordinates move it."""
        motion = _Motion(interval_pose.identity())
        zero = intervals.exactly(np.zeros(3))
        pose = motion.pose
        if path.from_tool:
            pose = tool.pose
            for axis in range(3):
                direction = intervals.exactly(np.eye(3)[axis])
                motion.axes[len(self.names) + axis] = direction, None
                motion.axes[len(self.names) + 3 + axis] = direction, zero
        for before, step in path.joints:
            motion.follow(interval_pose.column(intervals.product(pose.R, before.p[..., None])))
            pose = pose.then(before)
            value = x[:, step.joint] * float(step.sign)
            axis = pose.R[..., 2] * float(step.sign)
            if step.turns:
                motion.axes[step.joint] = axis, zero
                pose = pose.turned(value)
            else:
                motion.follow(pose.R[..., 2] * value[:, None])
                motion.axes[step.joint] = axis, None
                pose = pose.shifted(value)
        motion.follow(interval_pose.column(intervals.product(pose.R, path.end.p[..., None])))
        motion.pose = pose.then(path.end)
        if path.carrier is not None:
            return _seen_from(motion, *path.carrier, x)
        return motion


def _in_carrier(first: FramePath, second: FramePath) -> list[FramePath]:
    """Return two paths whose root is the body that the first revolute joint of one of them moves.

    All further joints of that path then move in a frame that does not turn with the first one.
    """
    for own, other in ((first, second), (second, first)):
        if own.from_tool or not own.joints or not own.joints[0][1].turns:
            continue
        carried = [
            FramePath(False, own.joints[1:], own.end),
            FramePath(other.from_tool, other.joints, other.end, own.joints[0]),
        ]
        return carried if own is first else carried[::-1]
    return [first, second]


def _seen_from(motion: _Motion, before: IntervalPose, step: PathStep, x: Intervals) -> _Motion:
    """Return a frame as it is seen from a body that a revolute joint moves."""
    R = intervals.transposed(before.turned(x[:, step.joint] * float(step.sign)).R)

    def turned(vector: Intervals) -> Intervals:
        return interval_pose.column(intervals.product(R, vector[..., None]))

    seen = _Motion(IntervalPose(intervals.product(R, motion.pose.R), turned(motion.pose.p - before.p)))
    for number, (axis, lever) in motion.axes.items():
        seen.axes[number] = turned(axis), None if lever is None else turned(lever)
    # the joint turns the body, hence what is seen from it backwards
    axis = intervals.exactly(np.array([[0.0, 0.0, -float(step.sign)]]))
    seen.axes[step.joint] = axis, seen.pose.p
    return seen


def rows_of(closures: Sequence[Closure]) -> int:
    """Return the number of closing conditions."""
    return sum(_ROWS[closure.joint.type] for closure in closures)


def are_lengths(closures: Sequence[Closure]) -> list[bool]:
    """Return of each closing condition whether it is a length in m; the others are sines."""
    found = []
    for closure in closures:
        kind = closure.joint.type
        lengths = 2 if kind in ("cylindrical", "prismatic") else 3
        found += [i < lengths for i in range(_ROWS[kind])]
    return found


def _conditions(closure: Closure, first: _Motion, second: _Motion) -> list[Intervals]:
    """Return the numbers (n,) that are zero if a joint fits between its two frames."""
    kind = closure.joint.type
    d = second.pose.p - first.pose.p
    found = _along(closure, first, d)
    if kind != "spherical":
        found += _leaning(kind, first, second.pose.R[..., 2], second.pose.R[..., 1])
    return found


def _along(closure: Closure, first: _Motion, d: Intervals) -> list[Intervals]:
    """Return the conditions of a shift d (n, 3), or of its derivative.

    Where both origins must meet, they may be in a constant frame; a slide needs the frame of the joint.
    """
    kind = closure.joint.type
    if kind in ("cylindrical", "prismatic"):
        return [intervals.total(first.pose.R[..., i] * d, -1) for i in range(2)]
    if kind == "spherical":
        return [d[..., i] for i in range(3)]
    turned = intervals.product(d, closure.R_root)
    return [turned[..., i] for i in range(3)]


def _leaning(kind: str, first: _Motion, z: Intervals, y: Intervals) -> list[Intervals]:
    """Return the conditions of the second frame's z and y axes, or of their derivatives (n, 3)."""
    found = [intervals.total(first.pose.R[..., i] * z, -1) for i in range(2)]
    if kind in ("prismatic", "fixed"):
        found.append(intervals.total(first.pose.R[..., 0] * y, -1))
    return found


def _derivatives(closure: Closure, first: _Motion, second: _Motion, number: int) -> list[Intervals]:
    """Return the derivatives of the conditions by a coordinate that moves one of the two frames.

    Seen from the first frame, a motion of it is the opposite motion of the second one.
    """
    kind = closure.joint.type
    own = number in first.axes
    axis, lever = (first if own else second).axes[number]
    if own:
        axis = -axis
    zero = intervals.exactly(np.zeros(3))
    if lever is None:
        move = axis
        turn_z = zero
        turn_y = zero
    else:
        if own and kind in ("cylindrical", "prismatic"):
            # these conditions are in the frame that moves: the vector to the other origin counts
            lever = lever + (second.pose.p - first.pose.p)
        move = cross(axis, lever)
        turn_z = cross(axis, second.pose.R[..., 2])
        turn_y = cross(axis, second.pose.R[..., 1])
    found = _along(closure, first, move)
    if kind != "spherical":
        found += _leaning(kind, first, turn_z, turn_y)
    return found


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
        if sizes[row] < _SMALLEST_PART:
            raise TwinError(f"the loops leave {len(unknowns) - len(rows)} of {len(unknowns)} joint values free")
        unit = remainder[row] / sizes[row]
        remainder = remainder - np.outer(remainder @ unit, unit)
        rows.append(row)
    return sorted(rows)


_SMALLEST_PART = 1e-6
"""Length of the part of a derivative, in m or without unit, below which a condition follows from the others."""
