"""home: move to the home waypoint on a straight line, or in joint space if the waypoint has joint values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import WaypointPhase
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState


class HomeTable(PhaseTable):
    """Move back to the home waypoint."""

    type: Literal["home"]

    rank: ClassVar[int] = 7

    def advance(self, state: ProtocolState) -> None:
        """Set the home waypoint as the end of the phase."""
        state.require_no_rcm(self.type)
        state.end_at(state.protocol_file.home, "home", key="type")

    def phase(self, protocol_file: ProtocolFile) -> Home:
        """Return the phase that this table describes, in SI units."""
        return Home(self.name, protocol_file.home)


@dataclass(frozen=True)
class Home(WaypointPhase):
    """Move to the home waypoint `to` on a straight line, or in joint space if the waypoint has joint values."""

    type: ClassVar[str] = "home"
    is_positioning: ClassVar[bool] = True
    by_joints: ClassVar[bool] = True
