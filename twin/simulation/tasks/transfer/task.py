"""The table of a task with rings to bring to pegs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from twin.model.contact import check_ring, require_contact
from twin.model.task import SceneNames, TaskKind
from twin.schema import Identifier, Table, error_at


class Transfer(Table):
    """A ring to bring to a peg: `ring` names the object, `peg` names a mesh of a solid body."""

    ring: Identifier
    peg: Identifier


@dataclass(frozen=True)
class Transfers:
    """The goal of the task: the rings with their pegs."""

    transfers: tuple[Transfer, ...]


def _goal(tables: Sequence[Transfer]) -> Transfers:
    return Transfers(tuple(tables))


def _check(path: Path, name: str, transfers: Sequence[Transfer], scene: SceneNames, robots: Sequence[str]) -> None:
    """Raise an error if a ring is listed twice, is not in the scene, or if nothing can be touched."""
    require_contact(path, name, KIND.name, scene.contact)
    listed: set[str] = set()
    for k, transfer in enumerate(transfers):
        keys = ("task", name, KIND.name, k, "ring")
        check_ring(path, keys, transfer.ring, scene.object)
        if transfer.ring in listed:
            raise error_at(path, keys, f"'{transfer.ring}' is listed twice")
        listed.add(transfer.ring)


def _steps(name: str, goal: Transfers) -> list[str]:
    return [transfer.ring for transfer in goal.transfers]


KIND = TaskKind(
    name="transfer",
    title="rings to bring to pegs",
    order=20,
    field=(list[Transfer], Field(default_factory=list)),
    goal=_goal,
    check=_check,
    steps=_steps,
    grasps=True,
    props=True,
    judged=True,
    package=__package__,
)
