"""A surgical procedure as a task: the organ to remove, the vessel to cut, and the limits of each stage."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Literal, get_args

from pydantic import Field

from twin.core.errors import unknown
from twin.model.task import SceneNames, TaskKind
from twin.schema import Identifier, Row, Table, error_at

Mistake = Literal["", "clip_missed", "wrong_vessel", "organ_punctured", "cut_outside", "bed_left"]
"""Mistakes on request: a clip beside the vessel; a clip on another vessel; a tip pushed into an organ that must be
spared; a cut outside the clips; a cell of the bed that is not freed."""


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


def _rows(table: ProcedureTable) -> Iterator[Row]:
    """Yield (name, value, unit) of each number of a procedure."""
    yield "change", table.change_mm, "mm"
    yield "lift", table.lift_mm, "mm"
    yield "seen", table.seen, "1"
    yield "seen for", table.seen_s, "s"
    yield "clips kept", table.clips_kept, "1"
    yield "clips taken", table.clips_taken, "1"
    yield "energy of the bed", table.bed_j, "J"
    yield "out", table.out_mm, "mm"
    yield "depth", table.depth_mm, "mm"


def _check(path: Path, name: str, procedure: ProcedureTable, scene: SceneNames, robots: Sequence[str]) -> None:
    """Raise an error if the procedure names something that the scene does not have."""
    keys = ("task", name, KIND.name)
    named: list[tuple[str, str, str, Collection[str]]] = [
        ("organ", "tissue", procedure.organ, scene.tissue),
        ("vessel", "vessel", procedure.vessel, scene.vessel),
        ("camera", "camera", procedure.camera, scene.camera),
    ]
    for organ in procedure.spare:
        named.append(("spare", "tissue", organ, scene.tissue))
    for robot in procedure.start:
        named.append(("start", "robot", robot, robots))
    for first_tool in procedure.start.values():
        named.append(("start", "tool", first_tool, scene.tool))
    for key, what, value, known_names in named:
        if value not in known_names:
            raise error_at(path, (*keys, key), unknown(what, value, known_names))
    for robot, first_tool in procedure.start.items():
        carriers = scene.tool[first_tool].robots
        if robot not in carriers:
            listed = ", ".join(carriers)
            message = f"{robot} cannot carry '{first_tool}'; only {listed} can carry it"
            raise error_at(path, (*keys, "start"), message)


KIND = TaskKind(
    name="procedure",
    title="a procedure on organs",
    order=50,
    field=(ProcedureTable | None, None),
    rows=_rows,
    check=_check,
    console=False,
    judged=True,
    mistakes=get_args(Mistake)[1:],
    package=__package__,
)
