"""pivot: move about the RCM.

With "enforced", the waypoint has angles and a depth, from which the tip position follows. With "monitored", the
waypoint has a pose that is reached exactly, and the RCM error is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import MM
from twin.planning.protocol.course import Course, Motion, RcmMode, rotation
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable, TrocarName
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier


class PivotTable(PhaseTable):
    """Move about the RCM."""

    type: Literal["pivot"]
    to: Identifier
    rcm: RcmMode
    trocar: TrocarName = None

    rank: ClassVar[int] = 4
    in_patient: ClassVar[bool] = True

    def advance(self, state: ProtocolState) -> None:
        """Register the trocar that the phase names, if any, as the RCM, and set `to` as the end of the phase.

        The protocol is refused if then no RCM is registered, or if the waypoint `to` has no depth (RCM "enforced") or
        no position (RCM "monitored").
        """
        state.register_trocar(self.trocar)
        state.require_rcm(self.type)
        if self.rcm == "enforced":
            state.end_at(self.to, "a pivot with an enforced RCM", "depth_mm")
        else:
            state.end_at(self.to, "a pivot with a monitored RCM", "position_mm")

    def phase(self, protocol_file: ProtocolFile) -> Pivot:
        """Return the phase that this table describes, in SI units."""
        return Pivot(self.name, self.to, self.rcm, self.trocar or "")


@dataclass(frozen=True)
class Pivot(Phase):
    """Move about the RCM, or about the `trocar` if one is named, to the waypoint `to`."""

    to: str
    rcm: RcmMode
    trocar: str = ""
    type: ClassVar[str] = "pivot"

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end: the waypoint's pose ("monitored"), or its angles and depth ("enforced")."""
        if start.rcm is None:
            raise start.error("no RCM is registered yet; add an insertion before this pivot")
        if self.rcm == "monitored":
            angles, tip = start.pose_at(self.to)
            # The shaft may pass beside the RCM: the depth is that from the point of the shaft's line nearest to the
            # RCM.
            depth = float((tip - start.rcm) @ rotation(angles, start.order) @ start.n_tool_shaft)
            return PhaseEnd(angles, tip, start.rcm, self.to, self.rcm, depth)
        angles = start.waypoints[self.to].angles
        depth = start.waypoints[self.to].depth
        if depth is None:
            raise start.error(f"waypoint '{self.to}' has no depth")
        missed = spatial.point_to_line(start.rcm, start.tip, start.shaft)
        # An enforced pivot puts the shaft through the RCM from its first instant: a shaft beside it would jump there.
        if start.rcm_mode == "monitored" and missed > start.tolerance:
            raise start.error(
                f"the shaft must pass through the RCM, but after a monitored pivot the shaft is {missed / MM:.3f} mm "
                f"beside the RCM (allowed: {start.tolerance / MM:g} mm)"
            )
        tip = start.rcm + depth * (rotation(angles, start.order) @ start.n_tool_shaft)
        return PhaseEnd(angles, tip, start.rcm, self.to, self.rcm, depth)

    def motion(self, course: Course, s: Array) -> Motion:
        """Return the motion of the phase at s (k,): about an enforced RCM, otherwise along a straight line."""
        if course.rcm_mode == "enforced" and course.rcm is not None:
            return course.about(course.rcm, s)
        return course.line(s)
