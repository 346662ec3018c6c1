"""Tables whose numbers have a provenance, and their numbers as parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from pydantic import Field

from twin.core.provenance import Parameter
from twin.core.units import SI
from twin.schema.tables import Origin, Table

Row = tuple[str, float | Sequence[float] | None, str]
"""Name, value and unit of a number or of a point, whose three numbers are named x, y and z; None: no value."""


class Sourced(Table):
    """A table whose numbers have one provenance, and one note with their source or reason."""

    provenance: Origin
    note: str = Field(min_length=1)

    def parameters(self, label: str, rows: Iterable[Row]) -> Iterator[Parameter]:
        """Yield the numbers of the table; their names are the label, the name of the row and the axis."""
        for name, value, unit in rows:
            if value is None:
                continue
            numbers = {"": value} if isinstance(value, int | float) else dict(zip("xyz", value, strict=True))
            for axis, shown in numbers.items():
                full = " ".join(part for part in (label, name, axis) if part)
                yield Parameter(full, shown * SI.get(unit, 1.0), unit, float(shown), self.provenance, self.note)
