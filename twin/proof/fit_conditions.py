"""Numbers that are zero if joints fit between placed bodies, and the joints about which such numbers say something."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import values
from twin.proof.exact_mechanism import ExactMechanism
from twin.proof.placed_bodies import PlacedBodies, has_one_value, motion_at, other_body
from twin.proof.transforms import Matrix, compose, identity, inverse
from twin.proof.values import ExactValue, Value

ARM = 0.5
"""Distance in m at which differences of directions count."""


def fit_conditions(
    exact: ExactMechanism, placed: PlacedBodies, joint: Joint, value: Value | None
) -> Iterator[ExactValue]:
    """Yield the numbers that are zero if a joint fits between two placed bodies.

    The relative pose of the two joint frames must be the motion of the joint: a ball has its centre in the socket, a
    pin has its axis in the bore; if the value of the coordinate is given, it must be this value.
    """
    T_base_first = placed.joint_frame(exact, joint, joint.parent)
    T_base_second = placed.joint_frame(exact, joint, joint.child)
    T = compose(inverse(T_base_first), T_base_second)  # of the frame on the child in that on the parent
    if value is not None and has_one_value(joint):
        T = compose(inverse(motion_at(joint, value, exact.states)), T)
        yield from pose_differences(T, identity(exact.states))
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


def cannula_conditions(exact: ExactMechanism, placed: PlacedBodies) -> Iterator[tuple[str, str, list[ExactValue]]]:
    """Yield (body, sentence, numbers that are zero) of bodies between a slide and a ball joint, as a cannula.

    Such a body is not placed; the centre of its ball must be on the line along which it slides.
    """
    for name in placed.missing:
        joints = [joint for joint in exact.mechanism.joints if name in (joint.parent, joint.child)]
        types = sorted(joint.type for joint in joints)
        if types != ["prismatic", "spherical"]:
            continue
        slide, ball = sorted(joints, key=lambda joint: joint.type)
        carrier = other_body(slide, name)
        holder = other_body(ball, name)
        if carrier not in placed.poses or holder not in placed.poses:
            continue
        T_base_slide = placed.joint_frame(exact, slide, carrier)
        T_base_ball = placed.joint_frame(exact, ball, holder)
        centre = compose(inverse(T_base_slide), T_base_ball)
        T_body_slide = exact.joint_frame(slide, name)
        T_body_ball = exact.joint_frame(ball, name)
        centre_on_body = compose(inverse(T_body_slide), T_body_ball)
        # along the slide, z, the centre may be anywhere
        x_difference = values.difference(centre[0][3], centre_on_body[0][3])
        y_difference = values.difference(centre[1][3], centre_on_body[1][3])
        yield name, f"{carrier} slides through the ball of {name} in {holder}", [x_difference, y_difference]


def pose_differences(A: Matrix, B: Matrix) -> Iterator[ExactValue]:
    """Yield the differences of the entries of two poses."""
    for i in range(3):
        for j in range(3):
            yield _at_arm(values.difference(A[i][j], B[i][j]))
        yield values.difference(A[i][3], B[i][3])


def _at_arm(entry: ExactValue) -> ExactValue:
    """Return a difference of directions whose real value is a distance in m."""
    return replace(entry, real=ARM * entry.real)


def is_judged_by_others(mechanism: Mechanism, joint: str, missing: Collection[str]) -> bool:
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
