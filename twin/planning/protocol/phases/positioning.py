"""positioning: move straight to a waypoint outside the patient, with position and angles linear in s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import WaypointPhase
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier


class PositioningTable(PhaseTable):
    """Move straight to a waypoint, outside the patient."""

    type: Literal["positioning"]
    to: Identifier

    rank: ClassVar[int] = 0

    def advance(self, state: ProtocolState) -> None:
        """Check that no RCM is registered and that the waypoint `to` has a position; end the phase at `to`."""
        state.require_no_rcm(self.type)
        state.end_at(self.to, "a positioning", "position_mm")

    def phase(self, protocol_file: ProtocolFile) -> Positioning:
        """Return the phase that this table describes, in SI units."""
        return Positioning(self.name, self.to)


@dataclass(frozen=True)
class Positioning(WaypointPhase):
    """Move straight to the waypoint `to`."""

    type: ClassVar[str] = "positioning"
    is_positioning: ClassVar[bool] = True
