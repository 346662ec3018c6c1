"""Compute the poses of those links of an instrument that can touch something, from the joint values of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.formula.flow import attach
from twin.kinematics import Kinematics
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel

_TURN = 0.1
"""Difference in rad between two values of the jaw's joint; the axes of the jaws are computed from the poses at both."""


@dataclass(frozen=True)
class Jaw:
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
        self.robot, self.effort = robot, effort
        tool = mechanism.frame(mechanism.tool)
        self.hand, self.T_hand_tool = mechanism.body(tool.body), tool.T_body_frame
        names = [j.name for j in mechanism.active]
        inward = _inward(robot, mechanism, tool.body)
        self.links = (self.hand, *(mechanism.body(j.parent) for j in inward))
        self.jaw = names.index(mechanism.auxiliary[0].name) if mechanism.auxiliary else -1
        self.jaws = _jaws(mechanism, tool.body, self.jaw) if self.jaw >= 0 else ()
        self._kin, self._q, self._tool = kin, np.zeros(len(names)), np.zeros(16)
        outward = T_world_base, spatial.inverse(tool.T_body_frame)
        chain = _chain(outward, [(names.index(j.name), j) for j in inward], len(names))
        if kin.closed_forward:
            self._tool, self._forward = attach(kin.program.forward.function, self._q)
        found, self._place = attach(chain, self._tool, self._q)
        self._found = found.reshape(len(self.links), 12)

    def place(self, q: Array) -> Array:
        """Return the poses of `links` in the World at joint values q (n,), as one row (12,) per link.

        A row has the position in m, then the rotation matrix row by row. The result is valid until the next call.
        """
        self._q[...] = q
        if self._kin.closed_forward:
            self._forward()
        else:
            self._tool[...] = self._kin.forward(q, self._tool.reshape(4, 4) if self._tool.any() else None).ravel()
        self._place()
        return self._found

    def poses(self, q: Array) -> list[Array]:
        """Return T_world_link (4, 4) of each of `links` at joint values q (n,)."""
        return [spatial.pose(row[3:].reshape(3, 3), row[:3]) for row in self.place(q)]


def _chain(outward: tuple[Array, Array], inward: Sequence[tuple[int, Joint]], n: int) -> ca.Function:
    """Return the function (T_base_tool (16), q (n)) -> positions and rotations (12 for each link) in the World.

    `outward`: (T_world_base, T_tool_hand). `inward`: (index in q, joint) of each joint, from the hand towards the base.
    """
    tool, q = ca.SX.sym("tool", 16), ca.SX.sym("q", n)
    T = ca.DM(outward[0]) @ ca.reshape(tool, 4, 4).T @ ca.DM(outward[1])
    out = []
    for index, joint in ((0, None), *inward):
        if joint is not None:
            c, s = ca.cos(q[index]), ca.sin(q[index])
            back = ca.blockcat([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            T = T @ ca.DM(joint.T_child_joint) @ back @ ca.DM(spatial.inverse(joint.T_parent_joint))
        out += [T[:3, 3], ca.vec(T[:3, :3].T)]
    return ca.Function("links", [tool, q], [ca.densify(ca.vertcat(*out))])


def _inward(robot: str, mechanism: Mechanism, body: str) -> list[Joint]:
    """Return the joints from the tool to the shaft (see `Gripper.links`), beginning with the joint of the tool."""
    path = mechanism.path(body)
    sliding = [i for i, j in enumerate(path) if j.type == "prismatic"]
    first = sliding[-1] + 2 if sliding else len(path)
    for joint in path[first:]:
        if joint.type != "revolute" or not joint.active:
            raise WorldError(
                f"'{robot}': {joint.name} moves link '{joint.child}'; between insertion and tool only active revolute "
                "joints are simulated in contact"
            )
    return list(path[first:][::-1])


def _jaws(mechanism: Mechanism, hand: str, index: int) -> tuple[Jaw, ...]:
    """Return the links that the jaw's joint turns relative to the hand, from two solutions of the reference model."""
    model = ReferenceModel(mechanism)
    q = np.array(mechanism.posture("home") if mechanism.postures else np.zeros(len(mechanism.active)), float)
    solved = []
    for value in (0.0, _TURN):
        q[index] = value
        solved.append(model.solve(q).link_poses)
    out = []
    for body in mechanism.bodies:
        shut, open_ = (spatial.inverse(poses[hand]) @ poses[body.name] for poses in solved)
        D = open_ @ spatial.inverse(shut)
        w = spatial.log_so3(D[:3, :3])
        angle = float(np.linalg.norm(w))
        if angle < 1e-6 or not any(j.name == mechanism.active[index].name for j in _carrying(mechanism, body.name)):
            continue
        p = np.linalg.lstsq(np.eye(3) - D[:3, :3], D[:3, 3], rcond=None)[0]
        out.append(Jaw(body, w / angle, p, angle / _TURN, shut))
    return tuple(out)


def grip_frame(mechanism: Mechanism) -> Array:
    """Return the pose (4, 4) of the frame of the closed jaws in the tool frame, measured on the meshes of the jaws.

    The origin is between the tips of the jaws, z points out of the jaws, and the jaws close along y.

    Raises:
        WorldError: the robot has no jaws.
    """
    tool = mechanism.frame(mechanism.tool)
    names = [j.name for j in mechanism.active]
    jaws = _jaws(mechanism, tool.body, names.index(mechanism.auxiliary[0].name)) if mechanism.auxiliary else ()
    if not jaws:
        raise WorldError(f"'{mechanism.name}' has no jaws that turn by an auxiliary joint")
    tips = []
    for jaw in jaws:
        p = np.concatenate([part.vertices for part in jaw.body.meshes]) @ jaw.T_hand_jaw[:3, :3].T
        off = p + jaw.T_hand_jaw[:3, 3] - jaw.point
        off -= np.outer(off @ jaw.axis, jaw.axis)
        tips.append(off[np.argmax(np.linalg.norm(off, axis=1))])
    tip = np.mean(tips, axis=0)
    z, x = tip / np.linalg.norm(tip), jaws[0].axis
    T_hand_grip = spatial.pose(np.column_stack([x, np.cross(z, x), z]), jaws[0].point + tip)
    return spatial.inverse(tool.T_body_frame) @ T_hand_grip


def _carrying(mechanism: Mechanism, body: str) -> list[Joint]:
    """Return the joints of the path to a body, and the joints coupled to them."""
    path = {j.name for j in mechanism.path(body)}
    tied = {n for c in mechanism.couplings if path & set(c.joints) for n in c.joints}
    return [j for j in mechanism.joints if j.name in path | tied]
