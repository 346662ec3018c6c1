"""The mechanism's side of a proof: bodies placed joint by joint with exact values, and the joints that must then fit.

Nothing here is taken from the equations: the values of the joints are given.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.body import Point
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import values
from twin.proof.drawing import LENGTH_TOLERANCE, Drawing
from twin.proof.transforms import Matrix, compose, identity, inverse, shifted, turn
from twin.proof.values import ExactValue, Value

ARM = 0.5
"""Distance in m at which differences of directions count."""


class ExactMechanism:
    """A mechanism whose numbers have exact forms.

    A body is represented by the frame of the first joint that holds it, or by this frame with its origin at a
    point of the body: by the one from which most joints and points are at lengths and angles of a drawing.

    Attributes:
        mechanism: the mechanism.
        drawing: the exact forms of its numbers.
        states: number k of states.
    """

    def __init__(self, mechanism: Mechanism, drawing: Drawing) -> None:
        self.mechanism = mechanism
        self.drawing = drawing
        self.states = drawing.states
        self._links: dict[tuple[str, bytes], Matrix] = {}
        self._frames: dict[str, Array] = {}
        for body in mechanism.bodies:
            self._frames[body.name] = self._reference(body.name)

    def link(self, body: str, T_body_frame: Array, what: str) -> Matrix:
        """Return the pose of a frame of a body, given in the frame of the CAD, in that which represents the body."""
        key = (body, T_body_frame.tobytes())
        if key not in self._links:
            T = spatial.inverse(self._frames[body]) @ T_body_frame
            self._links[key] = self.drawing.pose(T, f"{what} on {body}")
        return self._links[key]

    def point(self, body: str, p_body: Array, what: str) -> list[ExactValue]:
        """Return a point (3,) of a body, given in the frame of the CAD, in the frame that represents the body."""
        T = spatial.inverse(self._frames[body])
        return self.drawing.point(T[:3, :3] @ p_body + T[:3, 3], f"point {what} on {body}")

    def _reference(self, body: str) -> Array:
        """Return the frame that represents a body, in the frame of the CAD."""
        if body == self.mechanism.base:
            return np.eye(4)
        frames = []
        for joint in self.mechanism.joints:
            if body == joint.child:
                frames.append(joint.T_child_joint)
            elif body == joint.parent:
                frames.append(joint.T_parent_joint)
        references = frames[:1]
        points = []
        for point in self.mechanism.points:
            if point.body == body:
                points.append(point.p_body)
                at_point = np.array(references[0])
                at_point[:3, 3] = point.p_body
                references.append(at_point)
        best = np.eye(4)
        fewest = np.inf  # numbers of the body's joints and points without an exact form
        for reference in references:
            inverse_reference = spatial.inverse(reference)
            trial = self.drawing.fresh()
            for frame in frames:
                trial.steps(inverse_reference @ frame, body)
            for p in points:
                trial.point(inverse_reference[:3, :3] @ p + inverse_reference[:3, 3], body)
            if len(trial.unrecognised) < fewest:
                best = reference
                fewest = len(trial.unrecognised)
            if not fewest:
                break
        return best


def motion(joint: Joint, value: Value, states: int) -> Matrix:
    """Return the motion of a joint at the value of its coordinate: about z, or along z."""
    zero = values.constant(0.0, states)
    if joint.type == "revolute":
        return turn(values.angle(value), "z")
    if joint.type == "prismatic":
        return shifted([zero, zero, values.scalar(value)])
    return identity(states)


def transformed(T: Matrix, p: list[ExactValue]) -> list[ExactValue]:
    """Return a point (3,) of a body in the frame of its pose T."""
    coordinates = []
    for i in range(3):
        coordinate = T[i][3]
        for k in range(3):
            coordinate = values.total(coordinate, values.product(T[i][k], p[k]))
        coordinates.append(coordinate)
    return coordinates


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


def frames(exact: ExactMechanism, joint: Joint) -> tuple[Matrix, Matrix]:
    """Return the two frames of a joint, on its parent and on its child."""
    what = f"joint {joint.name}"
    first = exact.link(joint.parent, joint.T_parent_joint, what)
    return first, exact.link(joint.child, joint.T_child_joint, what)


def place(exact: ExactMechanism, joints: Mapping[str, Value], T_base_tool: Matrix | None) -> PlacedBodies:
    """Place bodies from the base, and from the tool if its pose is given, by joints with known values.

    Args:
        exact: the mechanism.
        joints: {joint: its value}; a joint without a value places no body.
        T_base_tool: pose of the tool frame; None if the joints determine it.
    """
    mechanism = exact.mechanism
    poses = {mechanism.base: identity(exact.states)}
    if T_base_tool is not None:
        tool = mechanism.frame(mechanism.tool)
        T_body_tool = exact.link(tool.body, tool.T_body_frame, f"frame {tool.name}")
        poses[tool.body] = compose(T_base_tool, inverse(T_body_tool))
    pending = list(mechanism.joints)
    advanced = True
    while advanced:
        advanced = False
        for joint in list(pending):
            placed = {joint.parent, joint.child} & set(poses)
            if len(placed) != 1 or not (joint.type == "fixed" or joint.name in joints):
                continue
            T_parent_joint, T_child_joint = frames(exact, joint)
            T_joint_child = inverse(T_child_joint)
            step = T_parent_joint
            if joint.type != "fixed":
                step = compose(step, motion(joint, joints[joint.name], exact.states))
            T_parent_child = compose(step, T_joint_child)
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


def judges(mechanism: Mechanism, joint: str, missing: Collection[str]) -> bool:
    """Return whether a wrong value of a joint can contradict the other joints and the pose of the tool.

    It can if the joint is in a loop of placed bodies, where the given pose of the tool closes one as well. A joint that
    only carries what hangs on it, or that holds a body of `missing`, is not judged.
    """
    edges = [(mechanism.base, mechanism.frame(mechanism.tool).body)]  # the given pose of the tool
    ends_of_joint: tuple[str, str] | None = None
    for candidate in mechanism.joints:
        ends = (candidate.parent, candidate.child)
        if set(ends) & set(missing):
            continue
        if candidate.name == joint:
            ends_of_joint = ends
        else:
            edges.append(ends)
    if ends_of_joint is None:
        return False
    parent, child = ends_of_joint
    reached = {parent}  # the bodies to which a way leads from the parent, without the joint itself
    count = 0
    while len(reached) > count:
        count = len(reached)
        for ends in edges:
            if reached & set(ends):
                reached |= set(ends)
    return child in reached


def slides(exact: ExactMechanism, placed: PlacedBodies) -> Iterator[tuple[str, str, list[ExactValue]]]:
    """Yield (body, sentence, numbers that are zero) of bodies between a slide and a ball joint, as a cannula.

    Such a body is not placed; the centre of its ball must be on the line along which it slides.
    """
    for name in placed.missing:
        joints = [joint for joint in exact.mechanism.joints if name in (joint.parent, joint.child)]
        types = sorted(joint.type for joint in joints)
        if types != ["prismatic", "spherical"]:
            continue
        slide, ball = sorted(joints, key=lambda joint: joint.type)
        carrier, T_carrier_slide = _other_end(slide, name)
        holder, T_holder_ball = _other_end(ball, name)
        if carrier not in placed.poses or holder not in placed.poses:
            continue
        T_base_slide = compose(placed.poses[carrier], exact.link(carrier, T_carrier_slide, f"joint {slide.name}"))
        T_base_ball = compose(placed.poses[holder], exact.link(holder, T_holder_ball, f"joint {ball.name}"))
        centre = compose(inverse(T_base_slide), T_base_ball)
        T_body_slide = exact.link(name, _own_end(slide, name), f"joint {slide.name}")
        T_body_ball = exact.link(name, _own_end(ball, name), f"joint {ball.name}")
        centre_on_body = compose(inverse(T_body_slide), T_body_ball)
        # along the slide, z, the centre may be anywhere
        x_difference = values.difference(centre[0][3], centre_on_body[0][3])
        y_difference = values.difference(centre[1][3], centre_on_body[1][3])
        yield name, f"{carrier} slides through the ball of {name} in {holder}", [x_difference, y_difference]


def point_in_base(exact: ExactMechanism, placed: PlacedBodies, point: Point) -> list[ExactValue] | None:
    """Return a point (3,) of the mechanism in base; None if nothing places it.

    A body that is not placed, as a cannula, still has the centre of its ball joint where the other body holds it.
    """
    if point.body in placed.poses:
        return transformed(placed.poses[point.body], exact.point(point.body, point.p_body, point.name))
    for joint in exact.mechanism.joints:
        if joint.type != "spherical" or point.body not in (joint.parent, joint.child):
            continue
        holder, T_holder_ball = _other_end(joint, point.body)
        centre = _own_end(joint, point.body)[:3, 3]
        if holder in placed.poses and np.abs(centre - point.p_body).max() <= LENGTH_TOLERANCE:
            T = compose(placed.poses[holder], exact.link(holder, T_holder_ball, f"joint {joint.name}"))
            return [T[0][3], T[1][3], T[2][3]]
    return None


def _other_end(joint: Joint, body: str) -> tuple[str, Array]:
    """Return the body at the other end of a joint, and the joint's frame there."""
    if joint.child == body:
        return joint.parent, joint.T_parent_joint
    return joint.child, joint.T_child_joint


def _own_end(joint: Joint, body: str) -> Array:
    """Return the joint's frame on a body."""
    if joint.child == body:
        return joint.T_child_joint
    return joint.T_parent_joint


def conditions(exact: ExactMechanism, placed: PlacedBodies, joint: Joint, value: Value | None) -> Iterator[ExactValue]:
    """Yield the numbers that are zero if a joint fits between two placed bodies.

    The relative pose of the two joint frames must be the motion of the joint: a ball has its centre in the socket, a
    pin has its axis in the bore; if the value of the coordinate is given, it must be this value.
    """
    T_parent_joint, T_child_joint = frames(exact, joint)
    T_base_first = compose(placed.poses[joint.parent], T_parent_joint)
    T_base_second = compose(placed.poses[joint.child], T_child_joint)
    T = compose(inverse(T_base_first), T_base_second)
    if value is not None and joint.type in ("revolute", "prismatic"):
        T = compose(inverse(motion(joint, value, exact.states)), T)
        yield from deviations(T, identity(exact.states))
        return
    if joint.type == "free":
        return
    yield T[0][3]
    yield T[1][3]
    if joint.type in ("fixed", "revolute", "spherical"):
        yield T[2][3]
    one = values.constant(1.0, exact.states)
    if joint.type in ("revolute", "cylindrical", "prismatic", "fixed"):
        yield _at_arm(T[0][2])
        yield _at_arm(T[1][2])
        # a half turn has zeros there as well
        yield _at_arm(values.difference(T[2][2], one))
    if joint.type in ("prismatic", "fixed"):
        yield _at_arm(T[1][0])
        yield _at_arm(values.difference(T[0][0], one))


def deviations(A: Matrix, B: Matrix) -> Iterator[ExactValue]:
    """Yield the differences of the entries of two poses."""
    for i in range(3):
        for j in range(3):
            yield _at_arm(values.difference(A[i][j], B[i][j]))
        yield values.difference(A[i][3], B[i][3])


def _at_arm(entry: ExactValue) -> ExactValue:
    """Return a difference of directions whose real value is a distance in m."""
    return replace(entry, real=ARM * entry.real)
