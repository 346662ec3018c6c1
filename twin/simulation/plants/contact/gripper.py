"""Compute the poses of those links of an instrument that can touch something, from the joint values of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.formula.evaluator import attach
from twin.kinematics import Kinematics
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel

_JAW_STEP = 0.1
"""Difference in rad between two values of the jaw's joint; the axes of the jaws are computed from the poses at both."""

_SMALLEST_TURN = 1e-6
"""Angle in rad below which a link does not turn with the jaw's joint."""


@dataclass(frozen=True)
class GripperJaw:
    """A jaw: a link that turns about an axis of the tool's body in proportion to the value of the jaw's joint.

    Attributes:
        body: the link.
        axis, point: (3,) direction of the axis, (3,) a point of the axis in m; both in the frame of the tool's body.
        ratio: angle about the axis divided by the value of the jaw's joint.
        T_hand_jaw: (4, 4) pose of the jaw in the frame of the tool's body at jaw value 0.
    """

    body: Body
    axis: Array
    point: Array
    ratio: float
    T_hand_jaw: Array


class Gripper:
    """An instrument: the body of the tool, its jaws, and the links from this body up to the shaft.

    Attributes:
        robot: name of the robot in the World.
        hand: body of the tool; it carries the jaws.
        links: links from `hand` towards the base, up to the shaft (the link that the first joint after the prismatic
            joint moves).
        jaws: the jaws; empty if the robot has no auxiliary joint.
        T_hand_tool: (4, 4) pose of the tool frame in the frame of `hand`.
        effort: largest torque in N m with which one jaw presses.
        jaw: index of the jaw's joint in q; -1 without jaws.
    """

    def __init__(
        self,
        robot: str,
        mechanism: Mechanism,
        kin: Kinematics,
        T_world_base: Array,
        effort: float,
    ) -> None:
        """Find the links and jaws of the robot.

        Args:
            robot: name of the robot in the World.
            mechanism: the robot's mechanism.
            kin: the robot's equations.
            T_world_base: (4, 4) pose of the robot's base.
            effort: largest torque in N m with which one jaw presses.

        Raises:
            WorldError: the effort is not positive, or a joint between shaft and tool is passive or not revolute.
        """
        if not effort > 0:
            raise WorldError(f"'{robot}': the torque of a jaw is {effort:g} N m; it must be above 0")
        self.robot = robot
        self.effort = effort
        tool = mechanism.frame(mechanism.tool)
        self.hand = mechanism.body(tool.body)
        self.T_hand_tool = tool.T_body_frame
        names = [joint.name for joint in mechanism.active]
        links = [self.hand]
        wrist_joints: list[tuple[int, Joint]] = []
        for joint in _wrist_joints(robot, mechanism, tool.body):
            links.append(mechanism.body(joint.parent))
            wrist_joints.append((names.index(joint.name), joint))
        self.links = tuple(links)
        self.jaw = -1
        self.jaws: tuple[GripperJaw, ...] = ()
        if mechanism.auxiliary:
            self.jaw = names.index(mechanism.auxiliary[0].name)
            self.jaws = jaws_of(mechanism, tool.body, self.jaw)
        self._kin = kin
        self._q = np.zeros(len(names))
        self._tool_values = np.zeros(16)
        T_tool_hand = spatial.inverse(tool.T_body_frame)
        chain = _chain(T_world_base, T_tool_hand, wrist_joints, len(names))
        # Both functions read and write these arrays in place, so that a tick allocates nothing.
        if kin.closed_forward:
            self._tool_values, self._forward = attach(kin.program.forward.function, self._q)
        link_values, self._compute_links = attach(chain, self._tool_values, self._q)
        self._link_rows = link_values.reshape(len(self.links), 12)

    def place(self, q: Array) -> Array:
        """Return the poses of `links` in the World at joint values q (n,), as one row (12,) per link.

        A row has the position in m, then the rotation matrix row by row. The result is valid until the next call.
        """
        self._q[...] = q
        if self._kin.closed_forward:
            self._forward()
        else:
            # The last pose is the start of the search, except in the first call, where there is none.
            start = self._tool_values.reshape(4, 4) if self._tool_values.any() else None
            self._tool_values[...] = self._kin.forward(q, start).ravel()
        self._compute_links()
        return self._link_rows

    def poses(self, q: Array) -> list[Array]:
        """Return T_world_link (4, 4) of each of `links` at joint values q (n,)."""
        poses = []
        for row in self.place(q):
            poses.append(spatial.pose(row[3:].reshape(3, 3), row[:3]))
        return poses


def _chain(T_world_base: Array, T_tool_hand: Array, wrist_joints: Sequence[tuple[int, Joint]], n: int) -> ca.Function:
    """Return the function (T_base_tool (16), q (n)) -> positions and rotations (12 for each link) in the World.

    `wrist_joints`: (index in q, joint) of each joint between the links, from the hand towards the base.
    """
    tool = ca.SX.sym("tool", 16)
    q = ca.SX.sym("q", n)
    T = ca.DM(T_world_base) @ ca.reshape(tool, 4, 4).T @ ca.DM(T_tool_hand)
    # CasADi stores columns: the transpose gives the rotation row by row.
    values = [T[:3, 3], ca.vec(T[:3, :3].T)]
    for index, joint in wrist_joints:
        c = ca.cos(q[index])
        s = ca.sin(q[index])
        rotated_back = ca.blockcat([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        T_joint_parent = spatial.inverse(joint.T_parent_joint)
        T = T @ ca.DM(joint.T_child_joint) @ rotated_back @ ca.DM(T_joint_parent)
        values += [T[:3, 3], ca.vec(T[:3, :3].T)]
    return ca.Function("links", [tool, q], [ca.densify(ca.vertcat(*values))])


def _wrist_joints(robot: str, mechanism: Mechanism, body: str) -> list[Joint]:
    """Return the joints from the tool to the shaft (see `Gripper.links`), beginning with the joint of the tool.

    Raises:
        WorldError: one of them is passive or not revolute.
    """
    path = mechanism.path(body)
    first_wrist_joint = len(path)
    for i, joint in enumerate(path):
        if joint.type == "prismatic":
            first_wrist_joint = i + 2  # the joint after the prismatic one moves the shaft; the next one moves the wrist
    wrist = path[first_wrist_joint:]
    for joint in wrist:
        if joint.type != "revolute" or not joint.active:
            raise WorldError(
                f"'{robot}': {joint.name} moves link '{joint.child}'; between insertion and tool only active revolute "
                "joints are simulated in contact"
            )
    return list(reversed(wrist))


def jaws_of(mechanism: Mechanism, hand: str, index: int) -> tuple[GripperJaw, ...]:
    """Return the links that the jaw's joint turns relative to the hand, from two solutions of the reference model."""
    model = ReferenceModel(mechanism)
    q = np.zeros(len(mechanism.active))
    if mechanism.postures:
        q = np.array(mechanism.posture("home"), float)
    q[index] = 0.0
    closed = model.solve(q).link_poses
    q[index] = _JAW_STEP
    opened = model.solve(q).link_poses
    jaw_joint = mechanism.active[index].name
    jaws = []
    for body in mechanism.bodies:
        T_hand_closed = spatial.inverse(closed[hand]) @ closed[body.name]
        T_hand_open = spatial.inverse(opened[hand]) @ opened[body.name]
        T_motion = T_hand_open @ spatial.inverse(T_hand_closed)
        rotation = spatial.log_so3(T_motion[:3, :3])
        angle = float(np.linalg.norm(rotation))
        if angle < _SMALLEST_TURN or jaw_joint not in _carrying(mechanism, body.name):
            continue
        # the points of the axis do not move; their equation has rank 2, and its shortest solution is taken
        solution = np.linalg.lstsq(np.eye(3) - T_motion[:3, :3], T_motion[:3, 3], rcond=None)
        point = np.asarray(solution[0], float)
        jaws.append(GripperJaw(body, rotation / angle, point, angle / _JAW_STEP, T_hand_closed))
    return tuple(jaws)


def _carrying(mechanism: Mechanism, body: str) -> set[str]:
    """Return the names of the joints of the path to a body, and of the joints coupled to them."""
    path = {joint.name for joint in mechanism.path(body)}
    coupled: set[str] = set()
    for coupling in mechanism.couplings:
        if path.intersection(coupling.joints):
            coupled.update(coupling.joints)
    return path | coupled
