"""A waypoint of a protocol, immutable, in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.core.errors import ProtocolError
from twin.core.provenance import Provenance
from twin.core.spatial import Array
from twin.core.units import DEG, MM


@dataclass(frozen=True)
class Waypoint:
    """A pose, an orientation about the RCM, or values of driven joints.

    Attributes:
        name: name of the waypoint.
        angles: (3,) in rad about the axes of `Protocol.rotation`; zero if `joints` are given.
        position: (3,) in m, for a pose; None otherwise.
        depth: depth in m, for an orientation about the RCM; None otherwise.
        label, provenance, note: text for readers.
        joints: {name: value in m or rad} of driven joints; other joints are as drawn. None: no joint values.
        angle_joints: names in `joints` whose values were given in degrees.
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

    def require_pose(self, protocol: str) -> tuple[Array, Array]:
        """Return angles (3,) in rad and position (3,) in m.

        Raises:
            ProtocolError: the waypoint has no position; the message begins with the name of the protocol.
        """
        if self.position is not None:
            return self.angles, self.position
        text = "no position"
        if self.joints is not None:
            text = "joint values, which require the mechanism"
        raise ProtocolError(f"{protocol}: waypoint '{self.name}' has {text}")


def joint_values(values_by_key: Mapping[str, float]) -> tuple[dict[str, float], frozenset[str]]:
    """Return (values in rad or m by joint, names of the joints given in degrees) for keys NAME_deg and NAME_mm."""
    joints = {}
    angle_joints = []
    for key, value in values_by_key.items():
        # Names of joints contain underscores too: the unit stands behind the last one.
        joint, unit = key.rsplit("_", 1)
        if unit == "deg":
            joints[joint] = value * DEG
            angle_joints.append(joint)
        else:
            joints[joint] = value * MM
    return joints, frozenset(angle_joints)
