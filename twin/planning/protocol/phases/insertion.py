"""insertion: move straight along the shaft by a depth; registers the RCM at the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core.units import MM
from twin.planning.protocol.phase import Begin, End, Phase, PhaseTable, Trocar, Walk
from twin.schema import Identifier, Positive


class InsertionTable(PhaseTable):
    """Move straight along the shaft; if the waypoint `to` is given, the tip must arrive there."""

    type: Literal["insertion"]
    depth_mm: Positive
    to: Identifier | None = None
    trocar: Trocar = None

    rank: ClassVar[int] = 3
    in_patient: ClassVar[bool] = True

    def follow(self, walk: Walk) -> None:
        """Check that no RCM is registered, and register one; if `to` is given, set it as the end of the phase."""
        walk.outside(self.type)
        # A guess among several trocars would put the RCM in another place than the author meant.
        if self.trocar is None and len(walk.trocars) > 1:
            text = f"[trocars_mm] has {', '.join(walk.trocars)}: name the trocar of this insertion"
            raise walk.wrong("type", f'{text}, with trocar = "NAME"')
        walk.through(self.trocar)
        walk.inside = True
        if self.to is not None:
            walk.go(self.to, "an insertion", "position_mm")

    def phase(self, walk: Walk) -> Insertion:
        """Return the phase in SI units; its trocar is the named trocar, otherwise the only trocar of the protocol."""
        trocar = self.trocar or ""
        if not trocar and len(walk.trocars) == 1:
            (trocar,) = walk.trocars
        return Insertion(self.name, self.depth_mm * MM, self.to, trocar)


@dataclass(frozen=True)
class Insertion(Phase):
    """Move along the shaft by `depth` in m; the initial position of the tip (at the named `trocar`) becomes the RCM."""

    depth: float
    to: str | None = None
    trocar: str = ""
    type: ClassVar[str] = "insertion"
    registers: ClassVar[bool] = True

    def end_after(self, at: Begin) -> End:
        """Return the state at the end: the tip has moved along the shaft; the RCM is the tip's initial position."""
        # The RCM is registered where the phase begins: there the depth is zero, whatever it was before.
        return End(at.angles, at.tip + self.depth * at.shaft, at.tip, self.to, "enforced", self.depth, depth0=0.0)
