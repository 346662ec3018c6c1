"""One seeded fault and its result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from twin.api.robot import Robot
from twin.core.json_types import JsonObject
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory

Family = Literal["formula", "cad", "usd", "units", "timing"]

FAMILIES: tuple[Family, ...] = ("formula", "cad", "usd", "units", "timing")
"""Families of faults in the order of reports."""

MEANING: dict[Family, str] = {
    "formula": "one edit of the source of an equation",
    "cad": "a moved or rotated joint frame, a wrong limit, or a wrong shape",
    "usd": "one changed attribute of the written stage or motion",
    "units": "a value in the wrong unit, such as metres instead of millimetres",
    "timing": "motion too fast or too late, or shaft away from the RCM",
}
"""{family: what its faults are, as printed in the report}."""

State = Literal["caught", "warned", "missed", "equivalent"]
"""State of a fault.

caught: the verdict changes. warned: there is a new warning. equivalent: the fault has no effect. missed: the validator
reports nothing, although the fault has an effect.
"""


@dataclass(frozen=True)
class SeededFault:
    """A fault that can be seeded into a robot.

    Exactly one of the functions `robot`, `mechanism`, `stage`, `protocol` and `trajectory` is given; the others are
    None.

    Attributes:
        family, kind: family and kind of the fault.
        what: short description of the change.
        robot: function that returns the robot with faulty equations or parameters; its argument is a folder for files.
        mechanism: function that returns the faulty mechanism.
        stage: function that edits a copy of the stage in a folder.
        protocol: function that writes a faulty protocol to a folder, and returns the protocol read from this folder.
        trajectory: function that returns a faulty trajectory.
    """

    family: Family
    kind: str
    what: str
    robot: Callable[[Path], Robot] | None = None
    mechanism: Callable[[], Mechanism] | None = None
    stage: Callable[[Path], None] | None = None
    protocol: Callable[[Path], Protocol] | None = None
    trajectory: Callable[[], Trajectory] | None = None


Subject = TypeVar("Subject")
"""What a family of faults changes: a mechanism, a stage, a trajectory."""

NamedFault = TypeVar("NamedFault")
"""(short description of a fault, function that seeds it); the function becomes an attribute of `SeededFault`."""

Item = TypeVar("Item")


def faults_in_turn(
    kinds: Sequence[str],
    makers: Mapping[str, Callable[[Subject, np.random.Generator], NamedFault]],
    subject: Subject,
    rng: np.random.Generator,
    count: int,
) -> Iterator[tuple[str, NamedFault]]:
    """Yield (kind, fault) for `count` faults of `subject`, in the order of `kinds`, repeated as often as necessary."""
    for i in range(count):
        kind = kinds[i % len(kinds)]
        yield kind, makers[kind](subject, rng)


def random_item(items: Sequence[Item], rng: np.random.Generator) -> Item:
    """Return one of the items at random."""
    return items[int(rng.integers(len(items)))]


@dataclass(frozen=True)
class Detection:
    """Result of the validator for a seeded fault.

    Attributes:
        family, kind, what: see `SeededFault`.
        code: code of the most severe new finding, or of the raised error; "" if there is none.
        where: place of the finding.
        message: text of the finding; for an equivalent fault, the reason why it has no effect.
        seconds: duration of the check in s.
    """

    family: Family
    kind: str
    what: str
    state: State
    code: str
    where: str
    message: str
    seconds: float

    def as_dict(self) -> JsonObject:
        """Return the result as plain data."""
        return asdict(self)
