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
    """Two mating parts of a joint and their distance in m in the rest poses; 0 if the parts touch or overlap."""

    joint: str
    parts: tuple[str, str]
    apart: float


def mates(mechanism: Mechanism) -> list[Mate]:
    """Return, for each joint with mating parts on both bodies, the two parts that are nearest in the rest poses."""
    out = []
    for joint in mechanism.joints:
        here, there = (_named(mechanism, joint, body) for body in (joint.parent, joint.child))
        if not here or not there:
            continue
        if joint.parent not in mechanism.rest or joint.child not in mechanism.rest:
            continue
        T = spatial.inverse(mechanism.rest[joint.parent]) @ mechanism.rest[joint.child]
        mate = _nearest(joint.name, here, there, T)
        if mate.apart > LOOSE:  # the zero position may be at an end stop: try all parts of the parent body
            mate = _nearest(joint.name, list(mechanism.body(joint.parent).meshes), there, T)
        out.append(mate)
    return out


def _nearest(joint: str, here: list[Mesh], there: list[Mesh], T: Array) -> Mate:
    pairs = [(a, b) for a in here for b in there]
    found = [distance_between(Shape(a.name, "", [a]), Shape(b.name, "", [b]), np.eye(4), T) for a, b in pairs]
    k = int(np.argmin(found))
    return Mate(joint, (pairs[k][0].name, pairs[k][1].name), found[k])


def _named(mechanism: Mechanism, joint: Joint, body: str) -> list[Mesh]:
    return [m for m in mechanism.body(body).meshes if m.name in joint.mating]
