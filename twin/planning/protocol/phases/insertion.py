"""insertion: move straight along the shaft by a depth; the RCM is registered at the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twin.core.units import MM
from twin.planning.protocol.phase import Begin, End, Phase, PhaseTable, Positive, Trocar, Walk
from twin.schema import Identifier


class InsertionTable(PhaseTable):
    """Table of a phase: the tool moves straight along its shaft; the tip must arrive at the waypoint `to`."""

    type: Literal["insertion"]
    depth_mm: Positive
    to: Identifier | None = None
    trocar: Trocar = None

    rank: ClassVar[int] = 3
    in_patient: ClassVar[bool] = True

    def follow(self, walk: Walk) -> None:
        """Check that the instrument is outside, and register the RCM."""
        walk.outside(self.type)
        if self.trocar is None and len(walk.trocars) > 1:
            text = f"[trocars_mm] has {', '.join(walk.trocars)}: name the one of this insertion"
            raise walk.wrong("type", f'{text}, trocar = "NAME"')
        walk.through(self.trocar)
        walk.inside = True
        if self.to is not None:
            walk.go(self.to, "an insertion", "position_mm")

    def phase(self, walk: Walk) -> Insertion:
        """Return it in SI, through the only trocar if it names none."""
        only = walk.trocars[0] if len(walk.trocars) == 1 else ""
        return Insertion(self.name, self.depth_mm * MM, self.to, self.trocar or only)


@dataclass(frozen=True)
class Insertion(Phase):
    """Move along the shaft by `depth` in m; registers the RCM at its start, where a `trocar` named here must be."""

    depth: float
    to: str | None = None
    trocar: str = ""
    type: ClassVar[str] = "insertion"
    registers: ClassVar[bool] = True

    def end_after(self, at: Begin) -> End:
        """Return the end: the tip moved along the shaft, with the RCM at its start."""
        return End(at.angles, at.tip + self.depth * at.shaft, at.tip, self.to, "enforced", self.depth, depth0=0.0)
