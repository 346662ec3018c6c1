"""The table `[trainer]` of a scene: robots that are machines, each with its model beside it, and their limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.model.console import ConsoleTable
from twin.schema import Identifier, Origin, Table, error_at
from twin.schema.sourced import parameters

MODEL = "_model"
"""End of the name of the model beside a machine: `raven_left_model` beside `raven_left`."""

_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]


class CueTable(Table):
    """The force of the cue: gains in N/mm and N s/mm, above a deviation of `tol_mm`, at most `largest_n`."""

    reading: Literal["printed", "corrected"] = "corrected"
    tol_mm: _Positive
    kp_n_mm: _NotNegative
    kd_ns_mm: _NotNegative
    largest_n: _Positive
    blend_mm: _NotNegative = 0.0


class TrainerTable(Table):
    """Robots of the scene that are machines, and the limits of teleoperation and rehearsal.

    `speed_mm_s` and `turn_deg_s` limit the tool that packets move. A rehearsed motion is refused if its tip was faster
    than `rehearsed_mm_s`, or if the machine is farther than `start_mm` and `start_deg` from its start; it is stopped on
    the machine above `replayed_mm_s`, and above a deviation of `deviation_mm` from the model.
    """

    robots: list[Identifier] = Field(min_length=1)
    speed_mm_s: Annotated[float, Field(gt=0, le=200)]
    turn_deg_s: Annotated[float, Field(gt=0, le=720)]
    rehearsed_mm_s: _Positive
    replayed_mm_s: _Positive
    start_mm: _Positive
    start_deg: _Positive
    deviation_mm: _Positive
    cue: CueTable
    provenance: Origin
    note: str = Field(min_length=1)


def check(path: Path, trainer: TrainerTable | None, console: ConsoleTable | None, names: Sequence[str]) -> None:
    """Raise if a machine is not a robot of a hand of the console, or if the name of its model is taken.

    Raises:
        DescriptionError: with file, line, key and value.
    """
    if trainer is None:
        return
    if console is None:
        raise error_at(path, ("trainer",), "machines are led from a console: add the table [console]")
    for i, name in enumerate(trainer.robots):
        if name not in (hands := [*console.right, *console.left]):
            raise error_at(path, ("trainer", "robots", i), unknown("robot of a hand", name, hands))
        if name in console.instrument_mm:
            text = f"'{name}' has its instrument in `instrument_mm`; the tool of a machine is led at its tip only"
            raise error_at(path, ("trainer", "robots", i), text)
        if name in trainer.robots[:i]:
            raise error_at(path, ("trainer", "robots", i), f"'{name}' is there twice")
        if name + MODEL in names:
            raise error_at(path, ("trainer", "robots", i), f"the scene has a robot '{name + MODEL}', the model's name")


def listed(trainer: TrainerTable | None) -> Iterator[Parameter]:
    """Yield the numbers of a trainer, with their provenance."""
    if trainer is None:
        return
    cue = trainer.cue
    rows = (
        ("speed", trainer.speed_mm_s, "mm/s"),
        ("turn", trainer.turn_deg_s, "deg/s"),
        ("rehearsed speed", trainer.rehearsed_mm_s, "mm/s"),
        ("replayed speed", trainer.replayed_mm_s, "mm/s"),
        ("start", trainer.start_mm, "mm"),
        ("start angle", trainer.start_deg, "deg"),
        ("deviation", trainer.deviation_mm, "mm"),
        ("cue limit", cue.tol_mm, "mm"),
        ("cue stiffness", cue.kp_n_mm, "N/mm"),
        ("cue damping", cue.kd_ns_mm, "N s/mm"),
        ("cue largest force", cue.largest_n, "N"),
        ("cue blend", cue.blend_mm, "mm"),
    )
    yield from parameters("trainer", trainer, rows)
