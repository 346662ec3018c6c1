"""The table of a task with holes to touch in order, as in the SHER simulation paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import Field

from twin.core.errors import unknown
from twin.core.units import MM
from twin.model.task import SceneNames, TaskKind
from twin.schema import Identifier, Row, Table, error_at


class HolesTable(Table):
    """The holes: the ends of the insertions of a protocol of a robot, in order.

    A hole is touched when the tip is at most `contact_mm` from the axis of the hole and from its bottom.
    """

    robot: Identifier
    protocol: Identifier
    contact_mm: float = Field(gt=0, le=10)

    @property
    def contact(self) -> float:
        """Largest distance in m of the tip from axis and bottom of a touched hole."""
        return self.contact_mm * MM


def _rows(table: HolesTable) -> Iterator[Row]:
    yield "contact", table.contact_mm, "mm"


def _check(path: Path, name: str, table: HolesTable, scene: SceneNames, robots: Sequence[str]) -> None:
    if table.robot not in robots:
        raise error_at(path, ("task", name, "holes", "robot"), unknown("robot", table.robot, robots))


KIND = TaskKind(
    name="holes",
    title="holes to touch in order",
    order=15,
    field=(HolesTable | None, None),
    rows=_rows,
    check=_check,
    judged=True,
    package=__package__,
)
