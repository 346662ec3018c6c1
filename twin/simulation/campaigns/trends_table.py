"""Tables of the file of the published experiments, such as cad/raven_left/campaigns/trends.toml; see `trends`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from twin.core.errors import DescriptionError
from twin.schema import Identifier, NotNegative, Positive, Sourced, Table, error_at, load_toml
from twin.simulation.campaigns.campaign_table import SpreadQuantity

_Share = Annotated[float, Field(ge=-1, le=1)]
_Count = Annotated[int, Field(gt=0)]
_Scale = Annotated[float, Field(gt=0, le=1)]


class HandTable(Table):
    """Runs with one motion of the hand: seed of the motion, and stuck values as fractions of the motor's limit."""

    seed: Annotated[int, Field(ge=0)]
    shares: list[_Share] = Field(min_length=1)


class StuckTable(Table):
    """The stuck command: `times` faults of `cycles` packets each, at intervals of `every` packets."""

    scale: _Scale
    every: _Count
    cycles: _Count
    times: _Count
    watched: _Count
    hand: list[HandTable] = Field(min_length=1)


class CableTable(Sourced):
    """Cable of a joint, in the units of the joint; see `cable_plant.Cables`."""

    joint: Identifier
    stiffness: Positive
    play: NotNegative
    damping: NotNegative
    coulomb: NotNegative


class PaperServo(Sourced):
    """Servo of the paper's model: `ki` is the gain of the integral of `motor`; all other motors have none."""

    motor: Identifier
    ki: NotNegative


class TrendsTable(Table):
    """File of the experiments, such as cad/raven_left/campaigns/trends.toml.

    Without `cable`, the motors of the machine move its joints without cables. Without `paper_servo`, the model has the
    servo of the released software only.
    """

    title: str
    source: str
    scales: list[_Scale] = Field(min_length=1)
    free: _Count
    free_hand: Annotated[int, Field(ge=0)]
    mass: SpreadQuantity
    friction: SpreadQuantity
    cable: list[CableTable] = Field(default_factory=list)
    paper_servo: PaperServo | None = None
    stuck: StuckTable


def load(path: Path) -> TrendsTable:
    """Read the file of the experiments.

    Raises:
        DescriptionError: the file does not exist or is invalid, or a fault is not shorter than its period; the message
            has file, line, key and value.
    """
    if not path.is_file():
        raise DescriptionError(f"{path}: the file does not exist; cad/raven_left/campaigns/trends.toml is an example")
    table = load_toml(path, TrendsTable)
    if table.stuck.cycles >= table.stuck.every:
        text = f"cycles = {table.stuck.cycles} must be below the period, every = {table.stuck.every} packets"
        raise error_at(path, ("stuck", "cycles"), text)
    return table
