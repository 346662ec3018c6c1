"""insertion: move straight along the shaft by a depth; registers the RCM at the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core.units import MM
from twin.planning.protocol.phase import Phase, PhaseEnd, PhaseStart
from twin.planning.protocol.phase_table import PhaseTable, TrocarName
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.schema import Identifier, Positive


class InsertionTable(PhaseTable):
    """Move straight along the shaft; if the waypoint `to` is given, the tip must arrive there."""

    type: Literal["insertion"]
    depth_mm: Positive
    to: Identifier | None = None
    trocar: TrocarName = None

    rank: ClassVar[int] = 3
    in_patient: ClassVar[bool] = True

    def advance(self, state: ProtocolState) -> None:
        """Check that no RCM is registered, and register one; if `to` is given, set it as the end of the phase."""
        state.require_no_rcm(self.type)
        # A guess among several trocars would put the RCM in another place than the author meant.
        trocars = state.protocol_file.trocars
        if self.trocar is None and len(trocars) > 1:
            text = f"[trocars_mm] has {', '.join(trocars)}: name the trocar of this insertion"
            raise state.protocol_file.error("type", f'{text}, with trocar = "NAME"')
        state.register_trocar(self.trocar)
        state.has_rcm = True
        if self.to is not None:
            state.end_at(self.to, "an insertion", "position_mm")

    def phase(self, protocol_file: ProtocolFile) -> Insertion:
        """Return the phase in SI units; its trocar is the named trocar, otherwise the only trocar of the protocol."""
        trocar = self.trocar or ""
        if not trocar and len(protocol_file.trocars) == 1:
            (trocar,) = protocol_file.trocars
        return Insertion(self.name, self.depth_mm * MM, self.to, trocar)


@dataclass(frozen=True)
class Insertion(Phase):
    """Move along the shaft by `depth` in m; the initial position of the tip (at the named `trocar`) becomes the RCM."""

    depth: float
    to: str | None = None
    trocar: str = ""
    type: ClassVar[str] = "insertion"
    registers_rcm: ClassVar[bool] = True

    def end_after(self, start: PhaseStart) -> PhaseEnd:
        """Return the state at the end: the tip has moved along the shaft; the RCM is the tip's initial position."""
        tip = start.tip + self.depth * start.shaft
        return PhaseEnd(start.angles, tip, start.tip, self.to, "enforced", self.depth)
