"""A number with its origin. Reports list every parameter, and name the assumed ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Provenance = Literal["PUBLISHED", "CITED", "DERIVED", "ASSUMED"]
"""PUBLISHED: printed in the paper that describes the robot. CITED: another source. DERIVED: computed from those.
ASSUMED: no published value was found; the note says why this one."""

EARLIER: dict[str, Provenance] = {"SEED": "PUBLISHED"}
"""Old provenance words and their present names."""


@dataclass(frozen=True)
class Parameter:
    """One number: its value in SI, its unit for people, and its origin.

    Attributes:
        name: identifier.
        value: the number in SI units.
        unit: unit it is shown in ("mm", "deg", "kg/m3", "mm/s", ...).
        shown: the number in `unit`.
        provenance: kind of its origin, see `Provenance`.
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
