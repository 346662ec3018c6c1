"""Compare the lines of two joints, seen from each other, between a file and a mechanism at sampled states.

They do not depend on the frames of the links.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from twin.exchange.audit.file_joints import ONE_COORDINATE, FileJoint
from twin.exchange.audit.joint_assignment import base_link, rigid_parts, single_joints
from twin.exchange.audit.ledger import MECHANISM
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.audit.pose_deviation import or_infinite
from twin.exchange.audit.poses import Array
from twin.exchange.audit.sampled_states import SampledStates
from twin.exchange.audit.value_text import quantity

LINE_TOL = 5e-6
"""Maximum difference in m between distances of two joint lines that agree; formats store single precision."""

ANGLE_TOL = 1e-5
"""Maximum difference between cosines of angles of two joint lines that agree."""

_PARALLEL_SINE = 1e-4
"""Sine of the angle of two lines below which they are parallel: their common normal is only rounding."""


@dataclass(frozen=True)
class JointPair:
    """Two joints of a file: the largest difference to those of the mechanism, over all states.

    The differences are infinite if a number of the file is not finite: such joints agree with none.

    Attributes:
        first, second: names of the joints in the file.
        distance: difference of the distances of the two lines in m; 0 if one of the joints is a slide.
        cosine: difference of the cosines of their angles.
        file_value, mechanism_value: the distances in m, or the angles in deg if only these differ, at the state of the
            difference.
        rigid: whether both joints are on one rigid part, so that zero positions have no influence.
        separation: places from the first to the second among the compared joints, in the order of their assignment.
    """

    first: str
    second: str
    distance: float
    cosine: float
    file_value: float
    mechanism_value: float
    rigid: bool
    separation: int

    @property
    def names(self) -> str:
        """Names of both joints."""
        return f"{self.first}, {self.second}"

    @property
    def share(self) -> float:
        """Difference divided by the tolerance."""
        return max(self.distance / LINE_TOL, self.cosine / ANGLE_TOL)

    def text(self) -> str:
        """Return the difference as a sentence."""
        if not np.isfinite(self.share):
            return (
                f"the axes of joints '{self.first}' and '{self.second}' cannot be compared with {MECHANISM}: a number "
                "of their poses in the file is not finite."
            )
        if self.distance > LINE_TOL:
            return (
                f"the axes of joints '{self.first}' and '{self.second}' are {_length_text(self.file_value)} apart; in "
                f"{MECHANISM} they are {_length_text(self.mechanism_value)} apart."
            )
        return (
            f"the axes of joints '{self.first}' and '{self.second}' are at {self.file_value:.5g} deg; in {MECHANISM} "
            f"they are at {self.mechanism_value:.5g} deg."
        )


def _length_text(value: float) -> str:
    if value <= 1e-9:  # rounding
        return "0 mm"
    return quantity(value, "m")


def pair_differences(
    mechanism: FileMechanism, truth: FileMechanism, states: SampledStates, assignment: Mapping[str, str], signed: bool
) -> list[JointPair]:
    """Return the differences of all pairs of assigned joints; [] if fewer than two can be placed.

    `signed` is whether the directions of the axes count: a file can have parent and child of a joint exchanged.
    """
    file_joints = single_joints(mechanism)
    mechanism_joints = single_joints(truth)
    values = joint_values(states, assignment)
    links = place_links(mechanism, values, states.count)
    part_of_link = rigid_parts(mechanism)
    names: list[str] = []
    file_lines: dict[str, tuple[Array, Array]] = {}
    mechanism_lines: dict[str, tuple[Array, Array]] = {}
    for name, mechanism_name in assignment.items():
        if name in values and file_joints[name].parent in links:
            names.append(name)
            file_lines[name] = _line_in_world(file_joints[name], links)
            mechanism_lines[name] = _line_in_world(mechanism_joints[mechanism_name], states.links)
    pairs = []
    for first_number, second_number in combinations(range(len(names)), 2):
        first = names[first_number]
        second = names[second_number]
        cosine, distance = _angles_and_distances(file_lines[first], file_lines[second])
        expected_cosine, expected_distance = _angles_and_distances(mechanism_lines[first], mechanism_lines[second])
        if not signed:
            cosine = np.abs(cosine)
            distance = np.abs(distance)
            expected_cosine = np.abs(expected_cosine)
            expected_distance = np.abs(expected_distance)
        turned = np.abs(cosine - expected_cosine)
        shifted = np.zeros(states.count)
        if "prismatic" not in (file_joints[first].kind, file_joints[second].kind):  # the line of a slide has no place
            shifted = np.abs(distance - expected_distance).max(axis=1)
        worst_state = int(np.argmax(shifted))
        if shifted[worst_state] <= LINE_TOL:
            worst_state = int(np.argmax(turned))
            file_value = _degrees(cosine[worst_state])
            mechanism_value = _degrees(expected_cosine[worst_state])
        else:  # also if the distance is not a number
            file_value = float(np.abs(distance[worst_state]).max())
            mechanism_value = float(np.abs(expected_distance[worst_state]).max())
        parts_of_first = {part_of_link[file_joints[first].parent], part_of_link[file_joints[first].child]}
        parts_of_second = {part_of_link[file_joints[second].parent], part_of_link[file_joints[second].child]}
        rigid = bool(parts_of_first & parts_of_second)
        distance_off = or_infinite(shifted.max())
        cosine_off = or_infinite(turned.max())
        pairs.append(
            JointPair(
                first,
                second,
                distance_off,
                cosine_off,
                file_value,
                mechanism_value,
                rigid,
                second_number - first_number,
            )
        )
    return pairs


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _line_in_world(joint: FileJoint, links: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return points and directions, both (k, 3), of a joint's line in the world."""
    line: JointLine = joint.motions[0]
    T = links[joint.parent]
    R = T[:, :3, :3]
    return R @ line.point + T[:, :3, 3], R @ line.direction


def _angles_and_distances(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return (cosines of the angles (k,), distances (k, 2) in m) of two lines at k states.

    The first distance is signed, by the side on which one line passes the other; it is zero for parallel lines. The
    second is the distance of parallel lines; it is zero for other lines.
    """
    point, direction = first
    other_point, other_direction = second
    between = other_point - point
    cosine = np.sum(direction * other_direction, axis=1)
    normal = np.cross(direction, other_direction)
    sine = np.linalg.norm(normal, axis=1)
    parallel = sine < _PARALLEL_SINE
    signed_distance = np.sum(between * normal, axis=1) / np.where(parallel, 1.0, sine)
    parallel_distance = np.linalg.norm(np.cross(direction, between), axis=1)
    distances = np.column_stack([np.where(parallel, 0.0, signed_distance), np.where(parallel, parallel_distance, 0.0)])
    return cosine, distances


def place_links(mechanism: FileMechanism, values: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Return {link: T_base_link (k, 4, 4)} of the links that joints with known values (k,) connect with the base."""
    base = base_link(mechanism)
    placed = {base: np.broadcast_to(np.eye(4), (count, 4, 4))}
    has_grown = True
    while has_grown:
        has_grown = False
        for joint in mechanism.joints:
            if joint.T is None:
                continue
            # A file may lead from the base outwards by the child of a joint.
            for outward in (joint, joint.reversed()):
                if outward.parent not in placed or outward.child in placed:
                    continue
                T = _relative(outward, values)
                if T is not None:
                    placed[outward.child] = placed[outward.parent] @ T
                    has_grown = True
    return placed


def _relative(joint: FileJoint, values: Mapping[str, Array]) -> Array | None:
    """Return T_parent_child (k, 4, 4) or (4, 4) of a joint at its values; None if they are unknown."""
    if joint.kind == "fixed":
        return joint.T
    if joint.kind not in ONE_COORDINATE or len(joint.names) != 1 or joint.names[0] not in values:
        return None
    return joint.motions[0].motion(values[joint.names[0]]) @ joint.T


def joint_values(states: SampledStates, assignment: Mapping[str, str]) -> dict[str, Array]:
    """Return {joint of the file: values (k,)} for the joints that are assigned to joints with known values."""
    values = {}
    for name, mechanism_joint in assignment.items():
        if mechanism_joint in states.joints:
            values[name] = states.joints[mechanism_joint]
    return values
