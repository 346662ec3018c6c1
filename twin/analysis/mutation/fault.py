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
    "timing": "samples too fast, too late, beside the RCM",
}

State = Literal["caught", "warned", "missed", "equivalent"]
"""caught: another verdict. warned: a warning that the correct robot does not give. equivalent: nothing differs."""


@dataclass(frozen=True)
class Fault:
    """A fault that can be put into a robot; exactly one of the makers is given.

    Attributes:
        family, kind: what sort of a fault.
        what: what was done, in one phrase.
        robot: returns the robot with faulty equations or parameters, given a folder to write to.
        mechanism: returns the faulty mechanism.
        stage: edits a copy of the stage in a folder.
        protocol: returns the protocol as it would be read from the faulty file, given a folder to write to.
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
        family, kind, what: of the fault.
        state: see `State`.
        code: of the gravest finding that the correct robot does not have; of an error what was raised; "" if missed.
        where: its place.
        message: its words, or why the fault is equivalent.
        seconds: how long it took.
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
