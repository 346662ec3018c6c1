"""A number with its origin. Reports list every parameter, and the assumed ones by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Provenance = Literal["PUBLISHED", "CITED", "DERIVED", "ASSUMED"]
"""PUBLISHED: printed in the paper that describes the robot. CITED: another source. DERIVED: computed from those.
ASSUMED: no published value was found; the note says why this one."""

EARLIER: dict[str, Provenance] = {"SEED": "PUBLISHED"}
"""Words of earlier files, and what they are called now."""


@dataclass(frozen=True)
class Parameter:
    """One number: `value` in SI, and how to show it.

    Attributes:
        name: identifier.
        value: the number in SI units.
        unit: unit it is shown in ("mm", "deg", "kg/m3", "mm/s", ...).
        shown: the number in that unit.
        provenance: where it comes from.
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
