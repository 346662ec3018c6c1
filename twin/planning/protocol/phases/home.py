"""home: move to the home waypoint on a straight line, or in joint space if the waypoint has joint values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import PhaseTable, Reaching, Walk


class HomeTable(PhaseTable):
    """Move back to the home waypoint."""

    type: Literal["home"]

    rank: ClassVar[int] = 7

    def follow(self, walk: Walk) -> None:
        """Set the home waypoint as the end of the phase."""
        walk.outside(self.type)
        walk.go(walk.home, "home", key="type")

    def phase(self, walk: Walk) -> Home:
        """Return the phase that this table describes, in SI units."""
        return Home(self.name, walk.home)


@dataclass(frozen=True)
class Home(Reaching):
    """Move to the home waypoint `to` on a straight line, or in joint space if the waypoint has joint values."""

    type: ClassVar[str] = "home"
    places: ClassVar[bool] = True
    by_joints: ClassVar[bool] = True
