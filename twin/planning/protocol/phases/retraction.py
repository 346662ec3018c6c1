"""retraction: move straight back along the shaft to a depth; at depth 0 the RCM is released."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core import spatial
from twin.core.units import MM
from twin.planning.protocol.course import RcmMode
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable, TrocarName
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import NotNegative

_DEPTH_ROUNDING = 1e-9
"""Tolerance in m for a final depth that exceeds the initial depth."""


class RetractionTable(PhaseTable):
    """Move straight back along the shaft to the depth `depth_mm`."""

    type: Literal["retraction"]
    depth_mm: NotNegative = 0.0
    trocar: TrocarName = None

    rank: ClassVar[int] = 6
    in_patient: ClassVar[bool] = True

    def advance(self, state: ProtocolState) -> None:
        """Register the named trocar, if any, and check that an RCM is registered; the phase ends at no waypoint."""
        state.register_trocar(self.trocar)
        state.require_rcm(self.type)
        state.has_rcm = self.depth_mm > 0

    def phase(self, protocol_file: ProtocolFile) -> Retraction:
        """Return the phase that this table describes, in SI units."""
        return Retraction(self.name, self.depth_mm * MM, self.trocar or "")

    def releases_rcm(self) -> bool:
        """Return whether the instrument is fully retracted."""
        return self.depth_mm == 0


@dataclass(frozen=True)
class Retraction(Phase):
    """Move back along the shaft until the tip is `depth` (m) beyond the RCM, or beyond the named `trocar`."""

    depth: float = 0.0
    trocar: str = ""
    type: ClassVar[str] = "retraction"

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end: the tip moved back along the shaft.

        If the shaft misses the RCM at the start, the RCM mode is "monitored", otherwise "enforced".
        """
        if start.rcm is None:
            raise start.error("no RCM is registered yet; add an insertion before this retraction")
        if self.depth > start.depth + _DEPTH_ROUNDING:
            text = f"the phase should end at depth {self.depth / MM:.3f} mm, but begins at {start.depth / MM:.3f} mm"
            raise start.error(f"{text}; use an insertion to move deeper")
        rcm_mode: RcmMode = "monitored"
        if spatial.point_to_line(start.rcm, start.tip, start.shaft) <= start.tolerance:
            rcm_mode = "enforced"
        # Relative to the tip, not to the RCM: a shaft that passes beside the RCM must not move sideways.
        tip = start.tip + (self.depth - start.depth) * start.shaft
        return PhaseEnd(start.angles, tip, start.rcm, rcm_mode=rcm_mode, depth=self.depth)

    def releases_rcm(self) -> bool:
        """Return whether the instrument is fully retracted."""
        return self.depth == 0
