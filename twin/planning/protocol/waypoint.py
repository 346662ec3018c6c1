"""A waypoint of a protocol: frozen, SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.core.provenance import Provenance
from twin.core.spatial import Array
from twin.core.units import DEG, MM


@dataclass(frozen=True)
class Waypoint:
    """A pose, an attitude, or values of driven joints.

    Attributes:
        name: identifier.
        angles: (3,) in rad about `Protocol.rotation`; zero where `joints` are given.
        position: (3,) in m, of a pose. depth: m, of an attitude about the RCM.
        label, provenance, note: for people.
        joints: value by driven joint, in m or rad; one that is not named is as drawn. None: no joint values.
        angle_joints: those of them that were given in degrees.
    """

    name: str
    angles: Array
    position: Array | None
    depth: float | None
    label: str
    provenance: Provenance
    note: str
    joints: Mapping[str, float] | None = None
    angle_joints: frozenset[str] = frozenset()


def joint_values(given: Mapping[str, float]) -> tuple[dict[str, float], frozenset[str]]:
    """Return values in SI by joint of `NAME_deg` and `NAME_mm`, and which of them were given in degrees."""
    split = [(*key.rsplit("_", 1), value) for key, value in given.items()]
    joints = {joint: value * (DEG if unit == "deg" else MM) for joint, unit, value in split}
    return joints, frozenset(j for j, unit, _ in split if unit == "deg")
