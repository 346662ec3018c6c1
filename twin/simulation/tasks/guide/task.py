"""The table of a guide task: a ring is handed over and guided along a wire in a dome."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from pydantic import Field

from twin.model.contact import check_ring, require_contact
from twin.model.task import SceneNames, TaskKind
from twin.schema import Identifier, Row, Table

STEPS = ("picked up", "handed over", "guided", "released", "retracted")
"""Steps of the task, in order."""

Mistake = Literal["", "dropped", "not_handed_over", "stopped_short", "wire_touched", "wall_hit", "left_inside"]
"""Mistakes on request, in the order of the names after "" (none): the first hand opens before the second arm holds the
ring; the first arm guides the ring itself; the ring is released in the middle of the wire; the ring touches the first
half of the wire; an instrument is moved into the wall of the dome; the instruments stay in the dome."""


class AllowedTable(Table):
    """Largest errors with which the task still counts as done.

    `touch_s`: time in s for which the held ring touches the wire; `drops`: number of drops of the ring; `collisions`:
    number of collisions of an instrument with a solid body or with the other instrument.
    """

    touch_s: float = Field(ge=0, le=1000)
    drops: int = Field(ge=0, le=1000)
    collisions: int = Field(ge=0, le=1000)


class GuideTable(Table):
    """A ring that is picked up, handed over, and guided along a wire; then both instruments leave the dome.

    `ring` names the object, `dome` the solid body around it. The arm of hand `first` picks the ring up: the centre of
    the ring must move by `lifted_mm`. The arm of the other hand then guides the ring. The wire consists of at least two
    parts of solid bodies; the name of each part begins with `wire`. The file of the props must list these parts in
    order, the part with the free end first. The ring has passed the wire when it is within `end_mm` of the other end of
    the wire. A tool has left the dome when it is `outside_mm` outside the convex hull of the dome.
    """

    ring: Identifier
    wire: Identifier
    dome: Identifier
    first: Literal["right", "left"]
    lifted_mm: float = Field(gt=0, le=100)
    end_mm: float = Field(gt=0, le=100)
    outside_mm: float = Field(gt=0, le=1000)
    allowed: AllowedTable


def _rows(table: GuideTable) -> list[Row]:
    """Return (name, value, unit) of each number of the table."""
    return [
        ("lift", table.lifted_mm, "mm"),
        ("end of the wire", table.end_mm, "mm"),
        ("distance outside the dome", table.outside_mm, "mm"),
        ("allowed touch", table.allowed.touch_s, "s"),
        ("allowed drops", table.allowed.drops, "1"),
        ("allowed collisions", table.allowed.collisions, "1"),
    ]


def _check(path: Path, name: str, table: GuideTable, scene: SceneNames, robots: Sequence[str]) -> None:
    """Raise an error if the ring is not in the scene, or if nothing can be touched."""
    require_contact(path, name, KIND.name, scene.contact)
    check_ring(path, ("task", name, KIND.name, "ring"), table.ring, scene.object)


def _steps(name: str, goal: GuideTable) -> list[str]:
    return [*STEPS, name]  # the last one is shown after the last step


KIND = TaskKind(
    name="guide",
    title="a ring to guide along a wire",
    order=30,
    field=(GuideTable | None, None),
    rows=_rows,
    check=_check,
    steps=_steps,
    grasps=True,
    props=True,
    judged=True,
    mistakes=get_args(Mistake)[1:],
    package=__package__,
)
