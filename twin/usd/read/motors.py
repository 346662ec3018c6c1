"""Read actuators and transmissions that twin writes as customData of the robot's prim."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd

from twin.core.errors import StageError
from twin.model.transmission import Actuator, Transmission
from twin.usd.scan import RawStage


def read_motors(scene: RawStage, prim: Usd.Prim) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
    """Return (actuators, transmissions) in their original order; both are empty for a stage from other software.

    Raises:
        StageError: an entry does not have the form that twin writes.
    """
    actuators: list[Actuator] = []
    transmissions: list[Transmission] = []
    try:
        for name, row in sorted_rows(prim.GetCustomDataByKey("twin:actuators")):
            actuators.append(_actuator(name, dict(row)))
        for name, row in sorted_rows(prim.GetCustomDataByKey("twin:transmissions")):
            transmissions.append(_transmission(name, row))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StageError(
            f"{scene.path}: {prim.GetPath()}: the customData twin:actuators or twin:transmissions does not have the "
            f"form that twin writes ({type(error).__name__}: {error})"
        ) from error
    return tuple(actuators), tuple(transmissions)


def sorted_rows(rows: dict[str, Any] | None) -> list[tuple[str, dict[str, Any]]]:
    """Return the (name, row) of a table in customData in their original order; USD stores dictionaries by name."""
    if not rows:
        return []
    return sorted(rows.items(), key=lambda item: item[1]["index"])


def _actuator(name: str, row: dict[str, Any]) -> Actuator:
    del row["index"]
    limits = row.pop("limits", None)
    if limits is not None:
        limits = (float(limits[0]), float(limits[1]))
    kind = str(row.pop("kind"))
    numbers = {}
    for key, value in row.items():
        numbers[key] = float(value)
    return Actuator(
        name,
        kind,  # pyright: ignore[reportArgumentType]
        limits,
        **numbers,
    )


def _transmission(name: str, row: dict[str, Any]) -> Transmission:
    joints = tuple(map(str, row["joints"]))
    actuators = tuple(map(str, row["actuators"]))
    matrix = np.array(row["matrix"], float).reshape(len(joints), len(actuators))
    return Transmission(name, joints, actuators, matrix)
