"""A surgical procedure as a task: the organ that is taken out, the vessel that is cut, and what counts as done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pydantic import Field

from twin.core.provenance import Parameter
from twin.schema import Identifier, Origin, Table


class ProcedureTable(Table):
    """A procedure in five stages; all lengths and limits are those of its checks.

    1 expose: a grasper holds `organ` and has lifted the held point by `lift_mm` when the first clip is placed.
    2 show: `camera` has seen the fraction `seen` of `vessel` for `seen_s` before the first clip is placed.
    3 clip: `clips_kept` clips shut the vessel on the side that stays, `clips_taken` on the side of the organ.
    4 cut: the vessel is cut between them, and no cut end is open.
    5 remove: each cell of the bed got `bed_j` by cautery and let go; the organ is at most `out_mm` from a port.

    During all stages, no tip goes deeper than `depth_mm` below the surface at rest of an organ in `spare`, and no other
    vessel is clipped or cut. `start` names the first tool of each robot; a tool is changed while the tip is at most
    `change_mm` inside the port.
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


def parameters(task: str, p: ProcedureTable, provenance: Origin, note: str) -> Iterator[Parameter]:
    """Yield the numbers of a procedure with their provenance."""
    rows: Iterable[tuple[str, float, str, float]] = (
        ("change", p.change_mm, "mm", 1e-3), ("lift", p.lift_mm, "mm", 1e-3), ("seen", p.seen, "1", 1.0),
        ("seen for", p.seen_s, "s", 1.0), ("clips kept", p.clips_kept, "1", 1.0),
        ("clips taken", p.clips_taken, "1", 1.0), ("energy of the bed", p.bed_j, "J", 1.0),
        ("out", p.out_mm, "mm", 1e-3), ("depth", p.depth_mm, "mm", 1e-3),
    )  # fmt: skip
    for what, v, unit, factor in rows:
        yield Parameter(f"task {task} {what}", v * factor, unit, float(v), provenance, note)
