"""The table of a task with targets to touch in order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.task import TaskKind
from twin.schema import Identifier, Row, Table, Vector, at


class TargetTable(Table):
    """A target: a point (world frame, mm) for one or both hands; the tips must touch their points at the same time."""

    name: Identifier
    right_mm: Vector | None = None
    left_mm: Vector | None = None

    @model_validator(mode="after")
    def _someone(self) -> TargetTable:
        if self.right_mm is None and self.left_mm is None:
            raise at("name", "a target needs `right_mm`, `left_mm`, or both")
        return self


@dataclass(frozen=True)
class Target:
    """A target of a task: its name, and {hand ("right", "left"): point (3,) in the world frame, in m}."""

    name: str
    p_world: Mapping[str, Array]


@dataclass(frozen=True)
class Targets:
    """The goal of the task: the targets, in order."""

    targets: tuple[Target, ...]


def _goal(tables: Sequence[TargetTable]) -> Targets:
    targets = []
    for table in tables:
        points = {}
        for hand, point in (("right", table.right_mm), ("left", table.left_mm)):
            if point is not None:
                points[hand] = np.array(point) * MM
        targets.append(Target(table.name, points))
    return Targets(tuple(targets))


def _rows(tables: Sequence[TargetTable]) -> Iterator[Row]:
    for table in tables:
        yield f"{table.name} right", table.right_mm, "mm"
        yield f"{table.name} left", table.left_mm, "mm"


def _steps(name: str, goal: Targets) -> list[str]:
    return [target.name for target in goal.targets]


KIND = TaskKind(
    name="target",
    title="targets to touch",
    order=10,
    field=(list[TargetTable], Field(default_factory=list)),
    goal=_goal,
    rows=_rows,
    steps=_steps,
    timed=True,
    package=__package__,
)
