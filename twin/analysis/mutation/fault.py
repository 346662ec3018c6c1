"""One seeded fault and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from twin.api import Robot
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory

Family = Literal["formula", "cad", "usd", "units", "timing"]

FAMILIES: tuple[Family, ...] = ("formula", "cad", "usd", "units", "timing")

MEANING: dict[Family, str] = {
    "formula": "one edit of the source of an equation",
    "cad": "a joint frame moved or turned, a limit, a shape",
    "usd": "one attribute of the written stage or motion",
    "units": "metres for millimetres, radians for degrees",
    "timing": "samples too fast, too late, or off the RCM",
}

State = Literal["caught", "warned", "missed", "equivalent"]
"""caught: the verdict changes; warned: there is a new warning; equivalent: the fault has no effect; else missed."""


@dataclass(frozen=True)
class Fault:
    """A fault that can be seeded into a robot.

    Exactly one of the functions `robot`, `mechanism`, `stage`, `protocol` and `trajectory` is given; the others are
    None.

    Attributes:
        family, kind: the class of the fault.
        what: the change, in one phrase.
        robot: returns the robot with faulty equations or parameters, given a folder to write to.
        mechanism: returns the faulty mechanism.
        stage: edits a copy of the stage in a folder.
        protocol: writes a faulty protocol to a given folder, and returns what is read from it.
        trajectory: returns faulty samples.
    """

    family: Family
    kind: str
    what: str
    robot: Callable[[Path], Robot] | None = None
    mechanism: Callable[[], Mechanism] | None = None
    stage: Callable[[Path], None] | None = None
    protocol: Callable[[Path], Protocol] | None = None
    trajectory: Callable[[], Trajectory] | None = None


@dataclass(frozen=True)
class Outcome:
    """Result of a seeded fault.

    Attributes:
        family, kind, what: see `Fault`.
        state: see `State`.
        code: code of the most severe new finding or of the error raised; "" if missed.
        where: place of the finding.
        message: its text, or why the fault is equivalent.
        seconds: duration of the check.
    """

    family: Family
    kind: str
    what: str
    state: State
    code: str
    where: str
    message: str
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)
