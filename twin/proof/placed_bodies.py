"""Bodies of a mechanism placed joint by joint with exact values: those of the joints, and the pose of the tool.

Nothing here is taken from the equations: the values are given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.model.body import Point
from twin.model.joint import Joint
from twin.proof import values
from twin.proof.drawing import LENGTH_TOLERANCE
from twin.proof.exact_mechanism import ExactMechanism, frame_on
from twin.proof.transforms import Matrix, compose, identity, inverse, shifted, turn
from twin.proof.values import ExactValue, Value


@dataclass(frozen=True)
class PlacedBodies:
    """Poses of bodies in base, and the joints that were not needed to place them.

    Attributes:
        poses: {body: pose of the frame that represents it}.
        closing: joints between placed bodies, whose conditions remain to be shown.
        missing: bodies that no joint with a known value reaches.
    """

    poses: dict[str, Matrix]
    closing: list[Joint]
    missing: list[str]

    def joint_frame(self, exact: ExactMechanism, joint: Joint, body: str) -> Matrix:
        """Return the frame of a joint on one of its two bodies, which is placed, in base."""
        return compose(self.poses[body], exact.joint_frame(joint, body))


def place_bodies(exact: ExactMechanism, joints: Mapping[str, Value], T_base_tool: Matrix | None) -> PlacedBodies:
    """Place bodies from the base, and from the tool if its pose is given, by fixed joints and those with known values.

    Args:
        exact: the mechanism.
        joints: {joint: its value}; the value of a ball or of a cylindrical joint places no body.
        T_base_tool: pose of the tool frame; None if the joints determine it.
    """
    mechanism = exact.mechanism
    poses = {mechanism.base: identity(exact.states)}
    if T_base_tool is not None:
        tool = mechanism.frame(mechanism.tool)
        T_body_tool = exact.frame(tool.body, tool.T_body_frame, f"frame {tool.name}")
        poses[tool.body] = compose(T_base_tool, inverse(T_body_tool))
    pending = list(mechanism.joints)
    advanced = True
    while advanced:
        advanced = False
        for joint in list(pending):
            placed = {joint.parent, joint.child} & set(poses)
            is_known = joint.type == "fixed" or (has_one_value(joint) and joint.name in joints)
            if len(placed) != 1 or not is_known:
                continue
            T_parent_joint = exact.joint_frame(joint, joint.parent)
            T_joint_child = inverse(exact.joint_frame(joint, joint.child))
            if joint.type != "fixed":
                T_parent_joint = compose(T_parent_joint, motion_at(joint, joints[joint.name], exact.states))
            T_parent_child = compose(T_parent_joint, T_joint_child)
            if joint.parent in poses:
                poses[joint.child] = compose(poses[joint.parent], T_parent_child)
            else:
                poses[joint.parent] = compose(poses[joint.child], inverse(T_parent_child))
            pending.remove(joint)
            advanced = True
    closing = []
    for joint in pending:
        if joint.parent in poses and joint.child in poses:
            closing.append(joint)
    missing = [body.name for body in mechanism.bodies if body.name not in poses]
    return PlacedBodies(poses, closing, missing)


def has_one_value(joint: Joint) -> bool:
    """Return whether one value says how a joint stands: it only turns, or only slides."""
    return joint.type in ("revolute", "prismatic")


def motion_at(joint: Joint, value: Value, states: int) -> Matrix:
    """Return the motion of a joint with one value (`has_one_value`) at this value: about z, or along z."""
    if joint.type == "revolute":
        return turn(values.angle(value), "z")
    zero = values.constant(0.0, states)
    return shifted([zero, zero, values.scalar(value)])


def other_body(joint: Joint, body: str) -> str:
    """Return the body at the other end of a joint."""
    if joint.child == body:
        return joint.parent
    return joint.child


def point_in_base(exact: ExactMechanism, placed: PlacedBodies, point: Point) -> list[ExactValue] | None:
    """Return a point (3,) of the mechanism in base; None if nothing places it.

    A body that is not placed, as a cannula, still has the centre of its ball joint where the other body holds it.
    """
    if point.body in placed.poses:
        return _transformed(placed.poses[point.body], exact.point(point.body, point.p_body, point.name))
    for joint in exact.mechanism.joints:
        if joint.type != "spherical" or point.body not in (joint.parent, joint.child):
            continue
        holder = other_body(joint, point.body)
        centre = frame_on(joint, point.body)[:3, 3]
        if holder in placed.poses and np.abs(centre - point.p_body).max() <= LENGTH_TOLERANCE:
            T_base_ball = placed.joint_frame(exact, joint, holder)
            return [T_base_ball[0][3], T_base_ball[1][3], T_base_ball[2][3]]
    return None


def _transformed(T: Matrix, p: list[ExactValue]) -> list[ExactValue]:
    """Return a point (3,) of a body in the frame of its pose T."""
    coordinates = []
    for i in range(3):
        coordinate = T[i][3]
        for k in range(3):
            coordinate = values.total(coordinate, values.product(T[i][k], p[k]))
        coordinates.append(coordinate)
    return coordinates
