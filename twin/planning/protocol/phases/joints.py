"""joints: move the driven joints synchronously to joint values; the tool path follows from the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.planning.protocol.phase import PhaseTable, Reaching, Walk
from twin.schema import Identifier


class JointsTable(PhaseTable):
    """Move the driven joints to the joint values of a waypoint, outside the patient."""

    type: Literal["joints"]
    to: Identifier

    rank: ClassVar[int] = 1

    def follow(self, walk: Walk) -> None:
        """Check that no RCM is registered and that the waypoint `to` has joint values; end the phase at `to`."""
        walk.outside(self.type)
        walk.go(self.to, "a motion by the joints", "joints")

    def phase(self, walk: Walk) -> Joints:
        """Return the phase that this table describes, in SI units."""
        return Joints(self.name, self.to)


@dataclass(frozen=True)
class Joints(Reaching):
    """Move the driven joints synchronously to the joint values of the waypoint `to`."""

    type: ClassVar[str] = "joints"
    by_joints: ClassVar[bool] = True
