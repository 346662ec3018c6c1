"""Change the distance between two joints of one body without changing the CAD.

This module moves joint frames that were measured on the CAD (`twin.cad.lengths` measures faces). The meshes are not
changed. For comparison, the mechanism with the distances of the CAD is displayed as a ghost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import MM, UM
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

_COINCIDENT_DISTANCE = 1 * UM
"""Distance in m up to which two origins count as equal, so that there is no line through them."""


@dataclass(frozen=True)
class Distance:
    """Two joints of one body, and the distance in m between the origins of the two joint frames on this body."""

    body: str
    joint: str
    other: str
    distance: float


def distances(mechanism: Mechanism) -> list[Distance]:
    """Return the distances that `with_distance` can change: one for each pair of joints that share exactly one body.

    The order of the distances is the order of the joints in the mechanism.
    """
    distances_of_pairs = []
    for first, second in combinations(mechanism.joints, 2):
        shared = _shared_bodies(first, second)
        # Two joints between the same two bodies have two distances: to change that on one body would tear the other.
        if len(shared) == 1:
            between = _joint_frame_on(first, shared[0])[:3, 3] - _joint_frame_on(second, shared[0])[:3, 3]
            length = float(np.linalg.norm(between))
            if length > _COINCIDENT_DISTANCE:
                distances_of_pairs.append(Distance(shared[0], first.name, second.name, length))
    return distances_of_pairs


def with_distance(mechanism: Mechanism, joint: str, other: str, distance: float) -> Mechanism:
    """Return the mechanism with the frame of `joint` moved to a `distance` in m from the frame of `other`.

    Both joints have a frame on the body that they share. The frame of `joint` is shifted, without rotation, along the
    line through the origins of the two frames, until the origins are `distance` apart. If this line is oblique to the
    joint axes (two bores at different heights), the shift has a component along the axes; this component opens a planar
    loop (`Assembly.worst_gap`). A shift along the axis of a prismatic joint only changes the joint's zero position.

    Raises:
        MechanismError: a joint is unknown, the joints are the same, share no body or two bodies, the origins coincide,
            or the distance is not positive.
    """
    first = mechanism.joint(joint)
    second = mechanism.joint(other)
    shared = _shared_bodies(first, second)
    if joint == other or len(shared) != 1:
        what = f"share {' and '.join(shared)}"
        if joint == other:
            what = "are the same"
        elif not shared:
            what = "share no body"
        partners = sorted(_partners(mechanism, joint))
        raise MechanismError(
            f"{mechanism.name}: joints '{joint}' and '{other}' {what}, so they have no distance; "
            f"'{joint}' has a distance to: {', '.join(partners) or 'none'}"
        )
    where = f"{mechanism.name}: distance of '{joint}' from '{other}' on '{shared[0]}'"
    if not (np.isfinite(distance) and distance > _COINCIDENT_DISTANCE):
        raise MechanismError(
            f"{where}: {distance / MM:g} mm is not possible; give a length above {_COINCIDENT_DISTANCE / MM:g} mm"
        )
    T = _joint_frame_on(first, shared[0]).copy()
    origin = _joint_frame_on(second, shared[0])[:3, 3]
    line = T[:3, 3] - origin
    length = float(np.linalg.norm(line))
    if length <= _COINCIDENT_DISTANCE:
        raise MechanismError(
            f"{where}: the origins coincide ({length / UM:.3g} um) and define no line; choose other joints"
        )
    T[:3, 3] = origin + line * (distance / length)
    if first.parent == shared[0]:
        moved_joint = replace(first, T_parent_joint=T)
    else:
        moved_joint = replace(first, T_child_joint=T)
    joints = []
    for candidate in mechanism.joints:
        if candidate is first:
            candidate = moved_joint
        joints.append(candidate)
    return replace(mechanism, joints=tuple(joints))


def line_of(mechanism: Mechanism, distance: Distance) -> Array:
    """Return the unit vector (3,), in the frame of the body, along which `with_distance` moves the joint."""
    origin = _joint_frame_on(mechanism.joint(distance.other), distance.body)[:3, 3]
    line = _joint_frame_on(mechanism.joint(distance.joint), distance.body)[:3, 3] - origin
    return line / np.linalg.norm(line)


def kinematic_distances(mechanism: Mechanism) -> list[Distance]:
    """Return the distances that change a motion: of both joints, a joint that moves is at the joint or beyond it.

    Mounts of parts that do not move, such as a phantom on the base, have no such distance.
    """
    carries = {joint.name for joint in mechanism.loops}
    for joint in mechanism.joints:
        if joint.type == "fixed":
            continue
        carries.add(joint.name)
        for body in (joint.parent, joint.child):
            for before in mechanism.path(body):
                carries.add(before.name)
    return [pair for pair in distances(mechanism) if pair.joint in carries and pair.other in carries]


def _partners(mechanism: Mechanism, joint: str) -> set[str]:
    """Return the joints to which a joint has a distance."""
    partners = set()
    for pair in distances(mechanism):
        if pair.joint == joint:
            partners.add(pair.other)
        elif pair.other == joint:
            partners.add(pair.joint)
    return partners


def _shared_bodies(a: Joint, b: Joint) -> list[str]:
    """Return the bodies to which both joints are attached."""
    return sorted({a.parent, a.child} & {b.parent, b.child})


def _joint_frame_on(joint: Joint, body: str) -> Array:
    """Return T_body_joint (4, 4), the frame of a joint on one of its bodies."""
    if joint.parent == body:
        return joint.T_parent_joint
    return joint.T_child_joint
