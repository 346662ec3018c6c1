"""The ways from the base, or from the tool, to the bodies of a mechanism and to the frames of its joints.

Bodies are placed joint by joint, by revolute, prismatic and fixed joints: from the base and from the tool, whose poses
are given. The coordinates of these joints are the unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import interval_pose
from twin.proof.interval_pose import IntervalPose
from twin.proof.rigid_frame import RigidFrame, joint_frames, rigid_frame

_PLACING = ("revolute", "prismatic", "fixed")
"""Types of joints that place a body."""


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
        moving = list(self.joints)
        if self.carrier is not None:
            moving.append(self.carrier)
        return {step.joint for _, step in moving}


class FramePaths:
    """The paths from base and tool to all bodies of a mechanism.

    Attributes:
        mechanism: the mechanism.
        tolerance: by how much each coordinate of the origin of each joint's frame may differ from its number, in m.
        names: joints whose coordinates are the unknowns, in order.
        closing: the joints that place no body, between two placed ones: each closes a loop.
    """

    def __init__(self, mechanism: Mechanism, tolerance: float) -> None:
        """Place the bodies.

        Raises:
            TwinError: no joint places a body, or a frame is no rotation but for rounding.
        """
        self.mechanism = mechanism
        self.tolerance = tolerance
        tool = mechanism.frame(mechanism.tool)
        self._tool_body = tool.body
        tool_frame = rigid_frame(tool.T_body_frame, f"{mechanism.name}: frame {mechanism.tool}")
        self._T_tool_body = interval_pose.fixed(tool_frame).inverse()
        self._steps: dict[str, tuple[PathStep, ...]] = {mechanism.base: (), tool.body: ()}
        self._roots = {mechanism.base: mechanism.base, tool.body: tool.body}
        self._routes: dict[str, tuple[tuple[Joint, int], ...]] = {mechanism.base: (), tool.body: ()}
        self.names: list[str] = []
        self.closing = self._place()

    def _place(self) -> list[Joint]:
        """Place bodies from base and tool; return the joints that close loops."""
        # active joints first: one that is left over closes a loop, and has no coordinate
        pending = sorted(self.mechanism.joints, key=lambda joint: not joint.active)
        joint = self._next_joint(pending)
        while joint is not None:
            self._extend(joint)
            pending.remove(joint)
            joint = self._next_joint(pending)
        holders_of: dict[str, int] = {}  # {body: number of its joints}
        for joint in self.mechanism.joints:
            for body in (joint.parent, joint.child):
                holders_of[body] = holders_of.get(body, 0) + 1
        unplaced = {body.name for body in self.mechanism.bodies} - set(self._steps)
        for body in sorted(unplaced):
            if holders_of.get(body, 0) > 1:
                raise TwinError(f"{self.mechanism.name}: no joint of known type places body {body} from base or tool")
        # a body that a single joint holds closes no loop
        return [joint for joint in pending if unplaced.isdisjoint((joint.parent, joint.child))]

    def _next_joint(self, pending: list[Joint]) -> Joint | None:
        """Return the first joint that places a body; None if there is none."""
        for joint in pending:
            placed = {joint.parent, joint.child} & set(self._steps)
            if len(placed) == 1 and joint.type in _PLACING:
                return joint
        return None

    def _extend(self, joint: Joint) -> None:
        """Place the body at the other end of a joint."""
        number = -1
        if joint.type != "fixed":
            number = len(self.names)
            self.names.append(joint.name)
        on_parent, on_child = self.frames(joint)
        turns = joint.type == "revolute"
        if joint.parent in self._steps:
            placed_body = joint.parent
            new_body = joint.child
            step = PathStep(on_parent, on_child.inverse(), number, 1, turns)
        else:
            placed_body = joint.child
            new_body = joint.parent
            step = PathStep(on_child, on_parent.inverse(), number, -1, turns)
        self._steps[new_body] = (*self._steps[placed_body], step)
        self._roots[new_body] = self._roots[placed_body]
        self._routes[new_body] = (*self._routes[placed_body], (joint, step.sign))

    def frames(self, joint: Joint) -> tuple[IntervalPose, IntervalPose]:
        """Return the frames of a joint on its parent and its child."""
        on_parent, on_child = joint_frames(self.mechanism.name, joint.name, joint.T_parent_joint, joint.T_child_joint)
        return self._widened(on_parent), self._widened(on_child)

    def _widened(self, frame: RigidFrame) -> IntervalPose:
        """Return the poses of a joint's frame whose origin may be off by the tolerance."""
        return interval_pose.fixed(replace(frame, p_radius=frame.p_radius + self.tolerance))

    def is_from_tool(self, body: str) -> bool:
        """Return whether a body is placed from the tool."""
        return self._roots[body] == self._tool_body

    def route(self, body: str) -> tuple[tuple[Joint, int], ...]:
        """Return the joints from the root to a body: each with 1 if it is passed from parent to child, else -1."""
        return self._routes[body]

    def to_joint(self, joint: Joint) -> tuple[FramePath, FramePath]:
        """Return the paths to a joint's frames on its parent and child, from the last body that both paths share."""
        steps, from_tool = self._from_shared_body(joint)
        on_parent, on_child = self.frames(joint)
        first = self._path(steps[0], from_tool[0], on_parent)
        second = self._path(steps[1], from_tool[1], on_child)
        if joint.type == "spherical":
            return in_carrier(first, second)
        return first, second

    def _from_shared_body(
        self, joint: Joint
    ) -> tuple[tuple[tuple[PathStep, ...], tuple[PathStep, ...]], tuple[bool, bool]]:
        """Return the steps to a joint's parent and child from the last body of both, and if each is from the tool."""
        first = self._steps[joint.parent]
        second = self._steps[joint.child]
        from_tool = (self.is_from_tool(joint.parent), self.is_from_tool(joint.child))
        if from_tool[0] != from_tool[1]:
            return (first, second), from_tool
        shared = 0
        while shared < min(len(first), len(second)) and first[shared] is second[shared]:
            shared += 1
        return (first[shared:], second[shared:]), (False, False)

    def _path(self, steps: tuple[PathStep, ...], from_tool: bool, frame: IntervalPose) -> FramePath:
        """Return the path along some steps to a frame on the last body."""
        pose = interval_pose.identity()
        if from_tool:
            pose = self._T_tool_body
        joints = []
        for step in steps:
            pose = pose.then(step.before)
            if step.joint >= 0:
                joints.append((pose, step))
                pose = step.after
            else:
                pose = pose.then(step.after)
        return FramePath(from_tool, tuple(joints), pose.then(frame))

    def resting_axes(self, joint: Joint) -> Array:
        """Return the rotation (3, 3) of a joint's frame on its parent where all coordinates are 0.

        It is that in the body from which `to_joint` begins; the identity if this is the tool.
        """
        (first, _), (from_tool, _) = self._from_shared_body(joint)
        if from_tool:
            return np.eye(3)
        pose = interval_pose.identity()
        for step in first:
            pose = pose.then(step.before).then(step.after)
        on_parent, _ = self.frames(joint)
        return pose.then(on_parent).R.middle


def in_carrier(first: FramePath, second: FramePath) -> tuple[FramePath, FramePath]:
    """Return two paths whose root is the body that the first revolute joint of one of them moves.

    All further joints of that path then move in a frame that does not turn with the first one.
    """
    for path, other_path in ((first, second), (second, first)):
        if path.from_tool or not path.joints or not path.joints[0][1].turns:
            continue
        shortened = FramePath(False, path.joints[1:], path.end)
        carried = FramePath(other_path.from_tool, other_path.joints, other_path.end, path.joints[0])
        if path is first:
            return shortened, carried
        return carried, shortened
    return first, second
