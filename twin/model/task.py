"""A task at a console or a bedside.

Targets to touch, rings to bring to pegs, a ring to guide along a wire, a camera to align, or a procedure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model import alignment, guide, procedure
from twin.model.alignment import Alignment, AlignTable
from twin.model.contact import ObjectTable
from twin.model.guide import GuideTable
from twin.model.procedure import ProcedureTable
from twin.schema import Identifier, Row, Sourced, Table, Vector, at, error_at


class Transfer(Table):
    """A ring to bring to a peg: `ring` names the object, `peg` names a mesh of a solid body."""

    ring: Identifier
    peg: Identifier


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


class TaskTable(Sourced):
    """A task: targets to touch in order, rings to bring to pegs, a ring to guide, a camera to align, or a procedure.

    A target has a point for one hand or for both hands. A target is touched when, for each of these hands, the distance
    between tip and point has been within the tolerance for `hold_s`, without interruption. A ring is transferred when
    it is around its peg and no instrument holds it. `GuideTable` describes `guide`, `AlignTable` describes `align`,
    `ProcedureTable` describes `procedure`; only a task with `procedure` needs no console.
    """

    title: str = Field(min_length=1)
    tolerance_mm: float | None = Field(None, gt=0)
    hold_s: float | None = Field(None, ge=0, le=10)
    target: list[TargetTable] = Field(default_factory=list)
    transfer: list[Transfer] = Field(default_factory=list)
    guide: GuideTable | None = None
    align: AlignTable | None = None
    procedure: ProcedureTable | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> TaskTable:
        kinds = [name for name in ("target", "transfer", "guide", "align", "procedure") if getattr(self, name)]
        if len(kinds) != 1:
            found = " and ".join(f"`{k}`" for k in kinds) or "none of them"
            raise at(
                "title",
                "a task needs a goal: `target` or `transfer` with at least one entry, `guide`, `align` or `procedure`; "
                f"this task has {found}",
            )
        for key in ("tolerance_mm", "hold_s"):
            if (getattr(self, key) is None) == bool(self.target):
                raise at("title" if self.target else key, f"a task with `{kinds[0]}` "
                         f"{'needs' if self.target else 'takes no'} `{key}`")  # fmt: skip
        return self


@dataclass(frozen=True)
class Target:
    """A target of a task: its name, and {hand ("right", "left"): point (3,) in the world frame, in m}."""

    name: str
    p_world: Mapping[str, Array]


@dataclass(frozen=True)
class ConsoleTask:
    """A task with targets, transfers, a guide, an alignment or a procedure; all except a procedure need a console.

    `tolerance` is the maximum distance in m of a tip from its point during a touch; `hold` is the time in s for which
    all tips of a target must be within the tolerance. `alignment` describes the camera task.
    """

    name: str
    title: str
    tolerance: float
    hold: float
    targets: tuple[Target, ...]
    transfers: tuple[Transfer, ...] = ()
    alignment: Alignment | None = None
    procedure: ProcedureTable | None = None
    guide: GuideTable | None = None

    @property
    def grasps(self) -> bool:
        """Whether the instruments grasp movable objects."""
        return bool(self.transfers) or self.guide is not None


def task_of(name: str, task: TaskTable) -> ConsoleTask:
    """Return the `ConsoleTask` that a table describes, in SI units."""
    targets = []
    for target in task.target:
        points = {"right": target.right_mm, "left": target.left_mm}
        targets.append(Target(target.name, {h: np.array(p) * MM for h, p in points.items() if p is not None}))
    return ConsoleTask(
        name,
        task.title,
        (task.tolerance_mm or 0.0) * MM,
        task.hold_s or 0.0,
        tuple(targets),
        tuple(task.transfer),
        None if task.align is None else alignment.alignment(task.align),
        task.procedure,
        task.guide,
    )


def check_rings(path: Path, name: str, task: TaskTable, objects: Mapping[str, ObjectTable], contact: bool) -> None:
    """Raise an error if task `name` lists a ring twice, or lists a ring that is missing or cannot be touched.

    A ring is missing if the scene has no ring of this name. A ring cannot be touched if `contact` is False: the scene
    file has no section [contact].

    Raises:
        DescriptionError: the message gives the file, the line, the key and the wrong value.
    """
    kind = "transfer" if task.transfer else "guide" if task.guide else ""
    if kind and not contact:
        raise error_at(path, ("task", name), f"a task with `{kind}` requires a section [contact] in this file")
    if task.guide is not None:
        _check_ring(path, ("task", name, "guide", "ring"), task.guide.ring, objects)
    for k, transfer in enumerate(task.transfer):
        keys = ("task", name, "transfer", k, "ring")
        _check_ring(path, keys, transfer.ring, objects)
        if transfer.ring in [t.ring for t in task.transfer[:k]]:
            raise error_at(path, keys, f"'{transfer.ring}' is listed twice")


def _check_ring(path: Path, keys: tuple[str | int, ...], name: str, objects: Mapping[str, ObjectTable]) -> None:
    if name not in objects:
        raise error_at(path, keys, unknown("object", name, objects))
    if (shape := objects[name].shape) != "ring":
        raise error_at(path, keys, f"'{name}' is a {shape}; only a ring goes around a peg or a wire")


def listed(name: str, task: TaskTable) -> Iterator[Parameter]:
    """Yield the numbers of task `name` as parameters with provenance."""
    rows: list[Row] = [("tolerance", task.tolerance_mm, "mm"), ("hold", task.hold_s, "s")]
    if task.guide is not None:
        rows += guide.rows(task.guide)
    if task.align is not None:
        rows += alignment.rows(task.align)
    if task.procedure is not None:
        rows += procedure.rows(task.procedure)
    for target in task.target:
        rows += [(f"{target.name} right", target.right_mm, "mm"), (f"{target.name} left", target.left_mm, "mm")]
    return task.parameters(f"task {name}", rows)
