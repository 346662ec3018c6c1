"""Check that the mating parts of each joint touch in the rest poses; a gap shows a wrong scale or placement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.clearance import Shape, distance_between

LOOSE = 0.5 * MM
"""Distance in m that exceeds the play of any real joint."""


@dataclass(frozen=True)
class Mate:
    """The nearest parts of a joint's two bodies in the rest poses, see `mates`.

    Attributes:
        joint: name of the joint.
        parts: names of the part of the parent and of the part of the child.
        distance: their distance in m; 0 if they touch or overlap.
    """

    joint: str
    parts: tuple[str, str]
    distance: float


def mates(mechanism: Mechanism) -> list[Mate]:
    """Return, for each joint with mating parts on both bodies and both rest poses, the two parts that are nearest.

    They are mating parts; if these are farther apart than `LOOSE`, the parent's part may be any of its parts.
    """
    found_mates = []
    rest_poses = mechanism.rest
    for joint in mechanism.joints:
        parent_parts = _mating_parts(mechanism, joint, joint.parent)
        child_parts = _mating_parts(mechanism, joint, joint.child)
        if not parent_parts or not child_parts:
            continue
        if joint.parent not in rest_poses or joint.child not in rest_poses:
            continue
        T_parent_child = spatial.inverse(rest_poses[joint.parent]) @ rest_poses[joint.child]
        mate = _nearest(joint.name, parent_parts, child_parts, T_parent_child)
        if mate.distance > LOOSE:
            # At rest, the joint may be at an end stop, where the child touches another part of the parent.
            parent_parts = list(mechanism.body(joint.parent).meshes)
            mate = _nearest(joint.name, parent_parts, child_parts, T_parent_child)
        found_mates.append(mate)
    return found_mates


def _nearest(joint: str, parent_parts: list[Mesh], child_parts: list[Mesh], T_parent_child: Array) -> Mate:
    candidates = []
    for parent_part in parent_parts:
        for child_part in child_parts:
            a = Shape(parent_part.name, "", [parent_part])
            b = Shape(child_part.name, "", [child_part])
            distance = distance_between(a, b, np.eye(4), T_parent_child)
            candidates.append(Mate(joint, (a.name, b.name), distance))
    return min(candidates, key=lambda mate: mate.distance)


def _mating_parts(mechanism: Mechanism, joint: Joint, body: str) -> list[Mesh]:
    return [mesh for mesh in mechanism.body(body).meshes if mesh.name in joint.mating]
