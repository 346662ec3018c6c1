"""The section `[trainer]` of a scene: machines, and the limits of the motions of machines and their models.

A machine is a robot with motors and control software that runs as a separate process and is commanded by packets. Its
model is a simulated robot that gets the same packets; differences between machine and model reveal faults of the
machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.model.console import ConsoleTable
from twin.schema import Identifier, NotNegative, Positive, Sourced, Table, error_at

MODEL = "_model"
"""Suffix of the name of a machine's model: `raven_left_model` is the model of `raven_left`."""


class CueTable(Table):
    """Cue: a force on the hand, computed from distance and relative velocity of the tips of a machine and its model.

    With the reading "corrected", the force is 0 up to a distance of `tol_mm`. Above this distance, the gains `kp_n_mm`
    and `kd_ns_mm` determine the force. The force grows from 0 over `blend_mm` and is at most `largest_n`. The reading
    "printed" is the paper's equation; see `twin.simulation.controllers.cue`.
    """

    reading: Literal["printed", "corrected"] = "corrected"
    tol_mm: Positive
    kp_n_mm: NotNegative
    kd_ns_mm: NotNegative
    largest_n: Positive
    blend_mm: NotNegative = 0.0


class TrainerTable(Sourced):
    """Robots of the scene that are machines (commanded by packets), and the limits of teleoperation and rehearsal.

    `speed_mm_s` and `turn_deg_s` limit the tool speed that packets command. A motion rehearsed with the model is not
    replayed on the machine if the tip speed of the rehearsal exceeded `rehearsed_mm_s`, or if the tool of the machine
    is more than `start_mm` or `start_deg` from the start of the motion. A replay is stopped if the tip speed exceeds
    `replayed_mm_s` or the deviation from the model exceeds `deviation_mm`.
    """

    robots: list[Identifier] = Field(min_length=1)
    speed_mm_s: Annotated[float, Field(gt=0, le=200)]
    turn_deg_s: Annotated[float, Field(gt=0, le=720)]
    rehearsed_mm_s: Positive
    replayed_mm_s: Positive
    start_mm: Positive
    start_deg: Positive
    deviation_mm: Positive
    cue: CueTable


def check(path: Path, trainer: TrainerTable | None, console: ConsoleTable | None, names: Sequence[str]) -> None:
    """Check the section `[trainer]` of a scene against its console and the names of its robots.

    Raises:
        DescriptionError: the scene has no console; or a machine is listed twice, is controlled by no hand, or has an
            `instrument_mm`; or another robot has the name of a machine's model. The message gives file, line and value.
    """
    if trainer is None:
        return
    if console is None:
        raise error_at(path, ("trainer",), "machines are controlled from a console: add a section [console]")
    robots_of_hands = [*console.right, *console.left]
    for place, name in enumerate(trainer.robots):
        if name not in robots_of_hands:
            raise error_at(path, ("trainer", "robots", place), unknown("robot of a hand", name, robots_of_hands))
        if name in console.instrument_mm:
            text = f"'{name}' is a machine: a hand controls only its tip; remove it from console.instrument_mm"
            raise error_at(path, ("trainer", "robots", place), text)
        if name in trainer.robots[:place]:
            raise error_at(path, ("trainer", "robots", place), f"'{name}' is listed twice")
        if name + MODEL in names:
            text = f"the name '{name + MODEL}' is reserved for the model of '{name}': rename this robot of the scene"
            raise error_at(path, ("trainer", "robots", place), text)


def listed(trainer: TrainerTable | None) -> Iterator[Parameter]:
    """Yield the numbers of a trainer as parameters with provenance."""
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
    yield from trainer.parameters("trainer", rows)
