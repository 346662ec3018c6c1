"""Compare the poses of a file at rest with the joints of the mechanism, which hold at any joint values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.joint_lines import ANGLE_TOL, LINE_TOL
from twin.exchange.audit.ledger import MECHANISM
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import JointLine, meeting_point
from twin.exchange.audit.pose_deviation import ROTATION_TOL, or_infinite
from twin.exchange.audit.poses import Array
from twin.exchange.audit.state_comparison import same_names
from twin.exchange.audit.value_text import quantity
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds

_REST_TOL = 2e-5
"""Maximum distance in m of two links at rest from the positions that their joint allows; see `usd.GAP_TOL`."""


def compare_joints(content: Content, truth: FileMechanism, source: str = MECHANISM) -> None:
    """Compare the poses of a file at rest with the joints of the mechanism, which hold at any joint values.

    `truth` may also be that of another file, `source`, in which all joints have places.
    """
    if not content.rest or kind_holds(content.format, Holds.JOINT_TREE) or not same_names(content.rest, truth.links):
        return
    links = {}
    for link, T in content.rest.items():
        links[link] = T[None]  # a motion with one key
    distances = {}
    angles = {}
    for joint in truth.joints:
        has_moved_trocar = truth.trocars & set(joint.names)  # each protocol has its own positions of trocars
        if {joint.parent, joint.child} <= set(links) and not has_moved_trocar:
            name = f"{joint.parent} to {joint.child}"  # fixed joints may have no name
            if joint.names:
                name = joint.names[0]
            distance, angles[name] = _deviation_from_joint(joint, links)
            if distance is not None:
                distances[name] = distance
    if not angles:
        return
    ledger = content.ledger
    ending = f"from any position that {source} allows."

    if distances:
        name = max(distances, key=lambda n: distances[n])
        worst = distances[name]
        check = f"rest: position at the joints of {source}"
        ledger.row(check, worst, "m", _REST_TOL, where=name, against=source)
        if worst > _REST_TOL:
            text = f"rest: the links of joint '{name}' are {quantity(worst, 'm')} {ending}"
            ledger.wrong("states.rest", text, name)

    name = max(angles, key=lambda n: angles[n])
    worst = angles[name]
    check = f"rest: rotation at the joints of {source}"
    ledger.row(check, worst, "rad", ROTATION_TOL, where=name, against=source)
    if worst > ROTATION_TOL:
        text = f"rest: the links of joint '{name}' are {np.degrees(worst):.4g} deg {ending}"
        ledger.wrong("states.rest", text, name)
    ledger.placed |= source == MECHANISM


def _deviation_from_joint(joint: FileJoint, links: Mapping[str, Array]) -> tuple[float | None, float]:
    """Return the largest distance (m) and angle (rad) of a joint's two links from the positions that it allows.

    The distance is None if the joint has no point whose positions are known to be on a line or a plane, such as two
    turns that do not meet, or a turn that swings the slide after it.
    """
    assert joint.T is not None
    zero = links[joint.parent] @ joint.T  # the child at zero
    T = poses.inverse(zero) @ links[joint.child]
    R = T[:, :3, :3]
    to_child = poses.inverse(joint.T)
    lines = []
    for line in joint.motions:
        lines.append(line.transformed(to_child))
    turns = []
    for line in lines:
        if line.kind == "turn":
            turns.append(line)
    # Two or more turns allow most rotations: nothing can be said of the angle.
    angle = 0.0
    if len(turns) == 1:
        axis = turns[0].direction
        angle = float(np.linalg.norm(R @ axis - axis, axis=1).max())
    elif not turns:
        unturned = np.broadcast_to(np.eye(3), R.shape)
        angle = float(poses.angle(R, unturned).max())
    point = _unturned_point(turns)
    if point is None or _swings_slide(lines):
        return None, or_infinite(angle)
    shift = R @ point + T[:, :3, 3] - point
    for direction in _slide_directions(lines):
        along = np.sum(shift * direction, axis=1, keepdims=True)
        shift = shift - along * direction
    return or_infinite(np.linalg.norm(shift, axis=1).max()), or_infinite(angle)


def _unturned_point(turns: Sequence[JointLine]) -> Array | None:
    """Return a point (3,) in m that turns do not move, because it is on all of their lines; None without one."""
    if not turns:
        return np.zeros(3)
    # First the point as the file states it: the meeting point of parallel turns is an arbitrary one.
    for point in (turns[0].point, meeting_point(turns)):
        distances = []
        for line in turns:
            moment = np.cross(line.direction, point - line.point)
            distances.append(np.linalg.norm(moment))
        if max(distances) <= LINE_TOL:
            return point
    return None


def _swings_slide(lines: Sequence[JointLine]) -> bool:
    """Return whether a turn changes the direction of a slide after it, from the parent outwards."""
    turns: list[JointLine] = []
    for line in lines:
        if line.kind == "turn":
            turns.append(line)
            continue
        for turn in turns:
            if np.linalg.norm(np.cross(turn.direction, line.direction)) > ANGLE_TOL:
                return True
    return False


def _slide_directions(lines: Sequence[JointLine]) -> list[Array]:
    """Return unit vectors (3,), at right angles to each other, that span the directions of all slides."""
    directions: list[Array] = []
    for line in lines:
        if line.kind != "slide":
            continue
        remainder = line.direction
        for direction in directions:
            remainder = remainder - (remainder @ direction) * direction
        size = np.linalg.norm(remainder)
        if size > ANGLE_TOL:  # else it is a direction of the slides before
            directions.append(remainder / size)
    return directions
