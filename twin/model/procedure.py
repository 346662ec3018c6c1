"""A surgical procedure as a task: the organ to remove, the vessel to cut, and the limits of each stage."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from twin.schema import Identifier, Row, Table


class ProcedureTable(Table):
    """A procedure in five stages, with the requirements that are checked.

    1 expose: when the first clip is placed, a grasper holds `organ` and has lifted the held point by `lift_mm`.
    2 show: before the first clip is placed, `camera` has seen the fraction `seen` of `vessel` for `seen_s`.
    3 clip: the vessel is closed by `clips_kept` clips on the side that stays in the patient, and by `clips_taken` clips
      on the side of the removed organ.
    4 cut: the vessel is cut between the clips of both sides, and both cut ends are closed by clips.
    5 remove: each node of the organ's bed (the nodes that attach the organ) is freed by cautery with the energy
      `bed_j`, and the organ is moved to at most `out_mm` from a port.

    During all stages, no tip may be deeper than `depth_mm` below the surface at rest of an organ in `spare`, and no
    other vessel may be clipped or cut. `start` names the first tool of each robot. A tool can be changed only if the
    tip is at most `change_mm` from the port.
    """

    organ: Identifier
    vessel: Identifier
    camera: Identifier
    spare: list[Identifier] = Field(min_length=1)
    start: dict[Identifier, Identifier] = Field(min_length=1)
    change_mm: float = Field(gt=0, le=500)
    lift_mm: float = Field(gt=0, le=200)
    seen: float = Field(gt=0, le=1)
    seen_s: float = Field(gt=0, le=60)
    clips_kept: int = Field(ge=1, le=6)
    clips_taken: int = Field(ge=1, le=6)
    bed_j: float = Field(gt=0, le=1000)
    out_mm: float = Field(gt=0, le=500)
    depth_mm: float = Field(gt=0, le=100)


def rows(p: ProcedureTable) -> Iterator[Row]:
    """Yield (name, value, unit) of each number of a procedure."""
    yield "change", p.change_mm, "mm"
    yield "lift", p.lift_mm, "mm"
    yield "seen", p.seen, "1"
    yield "seen for", p.seen_s, "s"
    yield "clips kept", p.clips_kept, "1"
    yield "clips taken", p.clips_taken, "1"
    yield "energy of the bed", p.bed_j, "J"
    yield "out", p.out_mm, "mm"
    yield "depth", p.depth_mm, "mm"
