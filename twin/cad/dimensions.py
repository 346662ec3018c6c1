"""Read the dimensions from which the CAD was drawn, `cad/<robot>/dimensions.toml`, to report their provenance.

The mechanism is measured on the STEP file and does not depend on these dimensions. Reports list those that are not
published.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from twin.core.errors import DescriptionError
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.once import Read
from twin.core.foreign.text import read_text
from twin.core.provenance import Parameter
from twin.core.units import SI
from twin.schema import Sourced, Vector, error_at, first_mistake


class Dimension(Sourced):
    """One length or angle, a vector of three numbers, or a table with one row for each section of a drawn body."""

    value: float | Vector | list[list[float]]
    unit: Literal["mm", "deg"]


def read_dimensions(path: Path, read: Read = read_bytes) -> tuple[Parameter, ...]:
    """Return the dimensions in a file as parameters named `drawing.<name>`; an empty tuple if the file is missing.

    Raises:
        DescriptionError: the file is not TOML, or an entry lacks value, unit, provenance or note.
    """
    if not path.is_file():
        return ()
    try:
        data = tomllib.loads(read_text(path, "TOML", read=read))
    except (ValueError, RecursionError) as error:
        raise DescriptionError(f"{path}: {error}") from error
    parameters = []
    for name, entry in data.items():
        if name == "part":  # manufacturing errors of single parts are not dimensions of the design
            continue
        value = entry.get("value") if isinstance(entry, dict) else None
        if isinstance(value, list) and not all(isinstance(row, list) for row in value):
            # TOML knows lists only; a tuple tells a vector of three numbers from a table of rows.
            entry = {**entry, "value": tuple(value)}
        try:
            dimension = Dimension.model_validate(entry)
        except ValidationError as error:
            where, what = first_mistake(error)
            raise error_at(path, (name,), f"{where or 'entry'}: {what}") from error
        for suffix, number in _numbers(dimension.value):
            value_si = number * SI[dimension.unit]
            parameters.append(
                Parameter(
                    f"drawing.{name}{suffix}",
                    value_si,
                    dimension.unit,
                    number,
                    dimension.provenance,
                    dimension.note,
                )
            )
    return tuple(parameters)


def _numbers(value: float | Vector | list[list[float]]) -> list[tuple[str, float]]:
    """Return (suffix, value) of each number of a dimension; the suffix is added to the name of the dimension."""
    if isinstance(value, tuple):
        x, y, z = value
        return [(".x", x), (".y", y), (".z", z)]
    if not isinstance(value, list):
        return [("", value)]
    numbers = []
    for row_number, row in enumerate(value, 1):
        for column_number, number in enumerate(row, 1):
            numbers.append((f".{row_number}.{column_number}", number))
    return numbers
