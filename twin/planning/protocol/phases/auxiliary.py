"""auxiliary: move joints that do not move the tool (such as a jaw) to given values; the tool is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import Begin, End, JointValue, Phase, PhaseTable, Walk
from twin.planning.protocol.waypoint import joint_values


class AuxiliaryTable(PhaseTable):
    """Move auxiliary joints (such as a jaw), which do not move the tool, to the values in `joints`.

    Keys of `joints` are NAME_deg or NAME_mm.
    """

    type: Literal["auxiliary"]
    joints: dict[JointValue, float]

    rank: ClassVar[int] = 2

    def follow(self, walk: Walk) -> None:
        """Check the joints; the phase ends at the waypoint where it begins."""
        walk.once(self.joints)
        walk.stays = True

    def phase(self, walk: Walk) -> Auxiliary:
        """Return the phase that this table describes, in SI units."""
        return Auxiliary(self.name, *joint_values(self.joints))


@dataclass(frozen=True)
class Auxiliary(Phase):
    """Move auxiliary joints (such as a jaw) synchronously to `joints`: {name: value in m or rad}. The tool is at rest.

    `angle_joints` are the names of the joints whose values were given in degrees.
    """

    joints: Mapping[str, float]
    angle_joints: frozenset[str]
    type: ClassVar[str] = "auxiliary"
    has_length: ClassVar[bool] = False

    def end_after(self, at: Begin) -> End:
        """Return the unchanged pose of the tool."""
        mode = None
        if at.rcm is not None:
            mode = at.mode
        return End(at.angles, at.tip, at.rcm, None, mode, at.depth)
