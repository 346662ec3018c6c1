"""auxiliary: move joints that do not move the tool (such as a jaw) to given values; the tool is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import JointKey, PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.planning.protocol.waypoint import joint_values


class AuxiliaryTable(PhaseTable):
    """Move auxiliary joints (such as a jaw), which do not move the tool, to the values in `joints`.

    Keys of `joints` are NAME_deg or NAME_mm.
    """

    type: Literal["auxiliary"]
    joints: dict[JointKey, float]

    rank: ClassVar[int] = 2

    def advance(self, state: ProtocolState) -> None:
        """Check the joints; the phase ends at the waypoint where it begins."""
        state.protocol_file.require_distinct_joints(self.joints, "joints")
        state.end_at_start()

    def phase(self, protocol_file: ProtocolFile) -> Auxiliary:
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

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the unchanged pose of the tool."""
        rcm_mode = None
        if start.rcm is not None:
            rcm_mode = start.rcm_mode
        return PhaseEnd(start.angles, start.tip, start.rcm, rcm_mode=rcm_mode, depth=start.depth)
