"""Numbers with provenance for reports: those of a description that are not in the CAD, and the drawn dimensions.

The description states limits, drives, densities, gaps, motors. The dimensions are those from which the CAD was drawn,
`cad/<robot>/dimensions.toml`; the mechanism is measured on the STEP file and does not depend on them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from twin.cad.description import ActuatorSpec, CouplingSpec, Description, DriveSpec, LimitSpec, TransmissionSpec
from twin.core.errors import DescriptionError
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.once import Read
from twin.core.foreign.text import read_text
from twin.core.provenance import Parameter
from twin.core.units import SI
from twin.schema import Row, Sourced, Vector, error_at, first_mistake


def parameters(description: Description) -> list[Parameter]:
    """Return every number of the description that is not in the CAD, with unit and provenance."""
    numbers: list[Parameter] = []
    for limit in description.limit:
        numbers += limit.parameters(",".join(limit.joints), _limit(limit))
    hinges = {joint.name for joint in description.joint if joint.type == "revolute"}
    for drive in description.drive:
        label = f"{','.join(drive.joints)} drive"
        is_angle = drive.joints[0] in hinges
        numbers += drive.parameters(label, _drive(drive, is_angle))
    for name, material in description.material.items():
        numbers += material.parameters("density", [(name, material.density_kg_m3, "kg/m3")])
    for gap in description.gap:
        numbers += gap.parameters("gap", [(f"{gap.lower}-{gap.upper}", gap.min_gap_mm, "mm")])
    for coupling in description.coupling:
        numbers += coupling.parameters("coupling", _coupling(coupling))
    for actuator in description.actuator:
        numbers += actuator.parameters(f"actuator {actuator.name}", _actuator(actuator))
    for transmission in description.transmission:
        numbers += transmission.parameters(f"transmission {transmission.name}:", _transmission(transmission))
    return numbers


def _limit(limit: LimitSpec) -> Iterator[Row]:
    for key in type(limit).model_fields:
        value = getattr(limit, key)
        if key in ("joints", "limits", "provenance", "note"):
            continue
        # "max_speed_deg_s" is the max_speed in deg/s
        base = "mm" if "_mm" in key else "deg"
        name, _, per = key.partition(f"_{base}")
        unit = base + per.replace("_", "/")
        if isinstance(value, tuple):
            low, high = value
            yield f"{name} from", low, unit
            yield f"{name} to", high, unit
        else:
            yield name, value, unit


_ANGLE_UNITS = {"value": "deg", "effort": "N m", "inertia": "kg m2", "stiffness": "N m/rad", "damping": "N m s/rad"}
"""Units of a joint or motor that turns."""

_LENGTH_UNITS = {"value": "mm", "effort": "N", "inertia": "kg", "stiffness": "N/m", "damping": "N s/m"}
"""Units of a joint or motor that slides."""


def _drive(drive: DriveSpec, is_angle: bool) -> Iterator[Row]:
    units = _ANGLE_UNITS if is_angle else _LENGTH_UNITS
    yield "stiffness", drive.stiffness, units["stiffness"]
    yield "damping", drive.damping, units["damping"]
    yield "max_effort", drive.max_effort, units["effort"]


def _coupling(coupling: CouplingSpec) -> Iterator[Row]:
    terms = []
    for ratio, joint in zip(coupling.ratios, coupling.joints, strict=False):
        terms.append(f"{ratio:g} {joint}")
    label = f"{coupling.name}: {' + '.join(terms)}"
    yield label, coupling.sum_deg, "deg"
    yield label, coupling.sum_mm, "mm"


def _actuator(actuator: ActuatorSpec) -> Iterator[Row]:
    units = _ANGLE_UNITS if actuator.kind == "angle" else _LENGTH_UNITS
    low, high = actuator.limits or (None, None)
    yield "limits from", low, units["value"]
    yield "limits to", high, units["value"]
    yield "max_speed", actuator.max_speed, f"{units['value']}/s"
    yield "max_effort", actuator.max_effort, units["effort"]
    yield "rotor_inertia", actuator.rotor_inertia, units["inertia"]
    yield "stiffness", actuator.stiffness, units["stiffness"]
    yield "damping", actuator.damping or None, units["damping"]  # 0 is the default, no statement


def _transmission(transmission: TransmissionSpec) -> Iterator[Row]:
    for joint, row in zip(transmission.joints, transmission.matrix, strict=True):
        for motor, ratio in zip(transmission.actuators, row, strict=True):
            yield f"{joint} per {motor}", ratio or None, ""


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
        for suffix, number in _dimension_numbers(dimension.value):
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


def _dimension_numbers(value: float | Vector | list[list[float]]) -> list[tuple[str, float]]:
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
