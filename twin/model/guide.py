"""The table of a guide task: a ring is handed over and guided along a wire in a dome."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from twin.schema import Identifier, Row, Table


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


def rows(table: GuideTable) -> list[Row]:
    """Return (name, value, unit) of each number of the table."""
    return [
        ("lift", table.lifted_mm, "mm"),
        ("end of the wire", table.end_mm, "mm"),
        ("distance outside the dome", table.outside_mm, "mm"),
        ("allowed touch", table.allowed.touch_s, "s"),
        ("allowed drops", table.allowed.drops, "1"),
        ("allowed collisions", table.allowed.collisions, "1"),
    ]
