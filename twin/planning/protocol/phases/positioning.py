"""positioning: move straight to a waypoint outside the patient, with position and angles linear in s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import PhaseTable, Reaching, Walk
from twin.schema import Identifier


class PositioningTable(PhaseTable):
    """Move straight to a waypoint, outside the patient."""

    type: Literal["positioning"]
    to: Identifier

    rank: ClassVar[int] = 0

    def follow(self, walk: Walk) -> None:
        """Check that no RCM is registered and that the waypoint `to` has a position; end the phase at `to`."""
        walk.outside(self.type)
        walk.go(self.to, "a positioning", "position_mm")

    def phase(self, walk: Walk) -> Positioning:
        """Return the phase that this table describes, in SI units."""
        return Positioning(self.name, self.to)


@dataclass(frozen=True)
class Positioning(Reaching):
    """Move straight to the waypoint `to`."""

    type: ClassVar[str] = "positioning"
    places: ClassVar[bool] = True
