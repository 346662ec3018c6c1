"""Numbers with their provenance. Reports list every parameter and mark those that are assumed."""

from __future__ import annotations

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
