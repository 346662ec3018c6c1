"""Read actuators and transmissions that twin writes as customData of the robot's prim."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from twin.core.errors import StageError
from twin.model.transmission import Actuator, Transmission
from twin.usd.scan import Scene


def read_motors(scene: Scene, prim: Usd.Prim) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
    """Return (actuators, transmissions) in their original order; both are empty for a stage from other software.

    Raises:
        StageError: an entry does not have the form that twin writes.
    """
    actuators, transmissions = (prim.GetCustomDataByKey(f"twin:{k}") or {} for k in ("actuators", "transmissions"))
    try:
        return (
            tuple(_actuator(name, dict(row)) for name, row in _sorted(actuators)),
            tuple(_transmission(name, row) for name, row in _sorted(transmissions)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StageError(
            f"{scene.path}: {prim.GetPath()}: the customData twin:actuators or twin:transmissions does not have the "
            f"form that twin writes ({type(error).__name__}: {error})"
        ) from error


def _sorted(rows: dict) -> list[tuple[str, dict]]:
    return sorted(rows.items(), key=lambda item: item[1]["index"])


def _actuator(name: str, row: dict) -> Actuator:
    del row["index"]
    limits = row.pop("limits", None)
    kind = str(row.pop("kind"))
    numbers = {k: float(v) for k, v in row.items()}
    return Actuator(
        name,
        kind,  # pyright: ignore[reportArgumentType]
        None if limits is None else (float(limits[0]), float(limits[1])),
        **numbers,
    )


def _transmission(name: str, row: dict) -> Transmission:
    joints, actuators = (tuple(map(str, row[k])) for k in ("joints", "actuators"))
    matrix = np.array(row["matrix"], float).reshape(len(joints), len(actuators))
    return Transmission(name, joints, actuators, matrix)
