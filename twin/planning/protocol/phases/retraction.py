"""retraction: move straight back along the shaft to a depth; at depth 0 the RCM is released."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core import spatial
from twin.core.units import MM
from twin.planning.protocol.course import RcmMode
from twin.planning.protocol.phase import Begin, End, Phase, PhaseTable, Trocar, Walk
from twin.schema import NotNegative

_DEPTH_ROUNDING = 1e-9
"""Tolerance in m for a final depth that exceeds the initial depth."""


class RetractionTable(PhaseTable):
    """Move straight back along the shaft to the depth `depth_mm`."""

    type: Literal["retraction"]
    depth_mm: NotNegative = 0.0
    trocar: Trocar = None

    rank: ClassVar[int] = 6
    in_patient: ClassVar[bool] = True

    def follow(self, walk: Walk) -> None:
        """Register the named trocar, if any, and check that an RCM is registered; the phase ends at no waypoint."""
        walk.through(self.trocar)
        walk.registered(self.type)
        walk.inside = self.depth_mm > 0

    def phase(self, walk: Walk) -> Retraction:
        """Return the phase that this table describes, in SI units."""
        return Retraction(self.name, self.depth_mm * MM, self.trocar or "")

    def leaves(self) -> bool:
        """Return whether the instrument is fully retracted."""
        return self.depth_mm == 0


@dataclass(frozen=True)
class Retraction(Phase):
    """Move back along the shaft until the tip is `depth` (m) beyond the RCM, or beyond the named `trocar`."""

    depth: float = 0.0
    trocar: str = ""
    type: ClassVar[str] = "retraction"

    def end_after(self, at: Begin) -> End:
        """Return the state at the end: the tip moved back along the shaft.

        If the shaft misses the RCM at the start, the RCM mode is "monitored", otherwise "enforced".
        """
        if at.rcm is None:
            raise at.refuse("no RCM is registered yet; add an insertion before this retraction")
        if self.depth > at.depth + _DEPTH_ROUNDING:
            text = f"the phase should end at depth {self.depth / MM:.3f} mm, but begins at {at.depth / MM:.3f} mm"
            raise at.refuse(f"{text}; use an insertion to move deeper")
        mode: RcmMode = "monitored"
        if spatial.point_to_line(at.rcm, at.tip, at.shaft) <= at.tolerance:
            mode = "enforced"
        # Relative to the tip, not to the RCM: a shaft that passes beside the RCM must not move sideways.
        tip = at.tip + (self.depth - at.depth) * at.shaft
        return End(at.angles, tip, at.rcm, None, mode, self.depth)

    def leaves(self) -> bool:
        """Return whether the instrument is fully retracted."""
        return self.depth == 0
