"""Numbers of tables as parameters, with the provenance and the note of their table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from twin.core.provenance import Parameter, Provenance
from twin.core.units import SI


class Sourced(Protocol):
    """A table of a file whose numbers have one provenance and one note."""

    @property
    def provenance(self) -> Provenance:
        """See `Parameter`."""
        ...

    @property
    def note(self) -> str:
        """See `Parameter`."""
        ...


Row = tuple[str, float | Sequence[float] | None, str]
"""Name, value and unit of a number or of a point, whose three numbers are named x, y and z; None: no value."""


def parameters(label: str, source: Sourced, rows: Iterable[Row]) -> Iterator[Parameter]:
    """Yield the numbers of a table as parameters; their names are the label, the name of the row and the axis."""
    for name, value, unit in rows:
        if value is None:
            continue
        numbers = {"": value} if isinstance(value, int | float) else dict(zip("xyz", value, strict=True))
        for axis, shown in numbers.items():
            full = " ".join(part for part in (label, name, axis) if part)
            yield Parameter(full, shown * SI.get(unit, 1.0), unit, float(shown), source.provenance, source.note)
