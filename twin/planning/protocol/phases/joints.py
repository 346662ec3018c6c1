"""joints: move the driven joints synchronously to joint values; the tool path follows from the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import WaypointPhase
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier


class JointsTable(PhaseTable):
    """Move the driven joints to the joint values of a waypoint, outside the patient."""

    type: Literal["joints"]
    to: Identifier

    rank: ClassVar[int] = 1

    def advance(self, state: ProtocolState) -> None:
        """Check that no RCM is registered and that the waypoint `to` has joint values; end the phase at `to`."""
        state.require_no_rcm(self.type)
        state.end_at(self.to, "a motion by the joints", "joints")

    def phase(self, protocol_file: ProtocolFile) -> Joints:
        """Return the phase that this table describes, in SI units."""
        return Joints(self.name, self.to)


@dataclass(frozen=True)
class Joints(WaypointPhase):
    """Move the driven joints synchronously to the joint values of the waypoint `to`."""

    type: ClassVar[str] = "joints"
    by_joints: ClassVar[bool] = True
