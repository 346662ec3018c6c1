"""The links of an instrument that can touch something, and their poses from the joint values of the robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.model.mechanism import Body, Joint, Mechanism
from twin.reference import ReferenceModel

_TURN = 0.1
"""Change in rad of the jaw's joint by which the axes of the jaws are found."""


@dataclass(frozen=True)
class Jaw:
    """A jaw: a link that turns about an axis of the tool's body in proportion to the jaw's joint.

    Attributes:
        body: the link.
        axis, point: (3,) direction and a point in m of the axis, in the frame of the tool's body.
        ratio: angle about the axis per value of the jaw's joint.
        T_hand_jaw: (4, 4) pose in the tool's body at jaw value 0.
    """

    body: Body
    axis: Array
    point: Array
    ratio: float
    T_hand_jaw: Array


class Gripper:
    """An instrument: the body of the tool, the links between it and the insertion, and its jaws.

    Attributes:
        robot: name of the robot in the World.
        hand: body of the tool; it carries the jaws.
        links: links from the hand inwards, up to the one that the last prismatic joint of the path inserts.
        jaws: the jaws; empty if the robot has no auxiliary joint.
        T_hand_tool: (4, 4) pose of the tool frame in its body.
        effort: largest torque in N m with which one jaw presses.
        jaw: index of the jaw's joint in q; -1 without jaws.
    """

    def __init__(
        self,
        robot: str,
        mechanism: Mechanism,
        forward: Callable[[Array], Array],
        T_world_base: Array,
        effort: float,
    ) -> None:
        """Find the links.

        Args:
            robot: name of the robot in the World.
            mechanism: its mechanism.
            forward: q (n,) -> T_base_tool (4, 4).
            T_world_base: (4, 4) pose of its base.
            effort: largest torque in N m with which one jaw presses.

        Raises:
            WorldError: the effort is not positive, or a link between tool and insertion does not move by one joint.
        """
        if not effort > 0:
            raise WorldError(f"'{robot}': the torque of a jaw is {effort:g} N m; it must be above 0")
        self.robot, self.effort = robot, effort
        self._forward, self._T_world_base = forward, np.array(T_world_base, float)
        tool = mechanism.frame(mechanism.tool)
        self._T_tool_hand, self.T_hand_tool = spatial.inverse(tool.T_body_frame), tool.T_body_frame
        self.hand = mechanism.body(tool.body)
        names = [j.name for j in mechanism.active]
        inward = _inward(robot, mechanism, tool.body)
        self._inward = [
            (names.index(j.name), j.T_child_joint, spatial.inverse(j.T_parent_joint), np.eye(4)) for j in inward
        ]
        self.links = (self.hand, *(mechanism.body(j.parent) for j in inward))
        self.jaw = names.index(mechanism.auxiliary[0].name) if mechanism.auxiliary else -1
        self.jaws = _jaws(mechanism, tool.body, self.jaw) if self.jaw >= 0 else ()

    def poses(self, q: Array) -> list[Array]:
        """Return T_world_link (4, 4) of each of `links` at joint values q (n,)."""
        T = self._T_world_base @ self._forward(q) @ self._T_tool_hand
        out = [T]
        for i, T_child_joint, T_joint_parent, turned in self._inward:
            c, s = math.cos(q[i]), math.sin(q[i])
            turned[0, 0], turned[0, 1], turned[1, 0], turned[1, 1] = c, s, -s, c
            T = T @ T_child_joint @ turned @ T_joint_parent
            out.append(T)
        return out


def _inward(robot: str, mechanism: Mechanism, body: str) -> list[Joint]:
    """Return the joints between the tool and the link that the last prismatic joint inserts, the tool's joint first."""
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


def _carrying(mechanism: Mechanism, body: str) -> list[Joint]:
    """Return the joints of the path to a body, and the joints coupled to them."""
    path = {j.name for j in mechanism.path(body)}
    tied = {n for c in mechanism.couplings if path & set(c.joints) for n in c.joints}
    return [j for j in mechanism.joints if j.name in path | tied]
