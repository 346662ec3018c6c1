"""Numbers with their provenance. Reports list every parameter and mark those that are assumed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Provenance = Literal["PUBLISHED", "CITED", "DERIVED", "ASSUMED"]
"""PUBLISHED: printed in the paper that describes the robot. CITED: from another source. DERIVED: computed from
published or cited values. ASSUMED: no published value was found; the note explains the chosen value."""

EARLIER: dict[str, Provenance] = {"SEED": "PUBLISHED"}
"""{former name of a provenance: current name}."""


@dataclass(frozen=True)
class Parameter:
    """A number with its SI value, its display unit and its provenance.

    Attributes:
        name: identifier.
        value: the number in SI units.
        unit: display unit ("mm", "deg", "kg/m3", "mm/s", ...).
        shown: the number in `unit`.
        provenance: see `Provenance`.
        note: source or reason; never empty.
    """

    name: str
    value: float
    unit: str
    shown: float
    provenance: Provenance
    note: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", EARLIER.get(self.provenance, self.provenance))


DRAWING = "drawing."
"""Prefix of the names of lengths that affect only the appearance of parts."""


@dataclass(frozen=True)
class AssumedCounts:
    """Numbers of assumed values, which every page, report and command counts in the same way.

    Attributes:
        robot: of equations and mechanism.
        protocol: of protocols.
        drawing: lengths that affect only the appearance of parts.
    """

    robot: int
    protocol: int
    drawing: int

    def __str__(self) -> str:
        """Return the counts as words; "" if nothing is assumed."""
        words = []
        if self.robot:
            words.append(f"{self.robot} of the robot")
        if self.protocol:
            words.append(f"{self.protocol} of its motion")
        if self.drawing:
            lengths = "length that affects" if self.drawing == 1 else "lengths that affect"
            words.append(f"{self.drawing} {lengths} only its appearance")
        return ", ".join(words)


def count_assumed(robot: Iterable[Parameter], protocol: Iterable[Parameter] = ()) -> AssumedCounts:
    """Return the numbers of assumed values among the parameters of a robot with its drawing, and of a protocol."""
    values = 0
    lengths = 0
    for parameter in robot:
        if parameter.provenance != "ASSUMED":
            continue
        if parameter.name.startswith(DRAWING):
            lengths += 1
        else:
            values += 1
    provenances = [parameter.provenance for parameter in protocol]
    return AssumedCounts(values, provenances.count("ASSUMED"), lengths)
