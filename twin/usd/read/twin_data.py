"""Read what only twin writes to the prim of a robot: its tool, trocars, couplings, motors, postures and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pxr import Usd

from twin.core.errors import StageError
from twin.core.json_types import JsonObject
from twin.core.provenance import Parameter
from twin.model.mechanism import Coupling
from twin.model.transmission import Actuator, Transmission
from twin.usd.scan import RawStage


@dataclass(frozen=True)
class TwinData:
    """Fields of `Mechanism` that only twin writes; empty, and the tool "tool", for a stage from other software."""

    tool: str
    trocars: tuple[str, ...]
    couplings: tuple[Coupling, ...]
    actuators: tuple[Actuator, ...]
    transmissions: tuple[Transmission, ...]
    postures: Mapping[str, Mapping[str, float]]
    parameters: tuple[Parameter, ...]


def read_twin_data(scene: RawStage, robot: Usd.Prim) -> TwinData:
    """Return what twin wrote to the prim of a robot.

    Raises:
        StageError: actuators or transmissions do not have the form that twin writes.
    """
    actuators, transmissions = _motors(scene, robot)
    tool = robot.GetAttribute("twin:tool").Get()
    return TwinData(
        tool=str(tool) if tool else "tool",
        trocars=_trocars(robot),
        couplings=_couplings(robot),
        actuators=actuators,
        transmissions=transmissions,
        postures=_postures(robot),
        parameters=_parameters(robot),
    )


def _trocars(robot: Usd.Prim) -> tuple[str, ...]:
    """Return the names of the trocars; a robot with one trocar has its name in an attribute of its own."""
    several = robot.GetAttribute("twin:trocars").Get()
    if several:
        return tuple(map(str, several))
    single = robot.GetAttribute("twin:trocar").Get()
    if single:
        return (str(single),)
    return ()


def _couplings(robot: Usd.Prim) -> tuple[Coupling, ...]:
    couplings: list[Coupling] = []
    for name, row in _sorted_rows(robot.GetCustomDataByKey("twin:couplings")):
        ratios = row["ratios"]
        values = tuple(map(float, ratios.values()))
        couplings.append(Coupling(name, tuple(ratios), values, float(row["total"])))
    return tuple(couplings)


def _postures(robot: Usd.Prim) -> dict[str, dict[str, float]]:
    postures: dict[str, dict[str, float]] = {}
    stored = robot.GetCustomDataByKey("twin:postures") or {}
    for name, coordinates in stored.items():
        postures[name] = {}
        for joint, q in coordinates.items():
            postures[name][joint] = float(q)
    return postures


def _parameters(robot: Usd.Prim) -> tuple[Parameter, ...]:
    parameters: list[Parameter] = []
    for name, row in _sorted_rows(robot.GetCustomDataByKey("twin:parameters")):
        parameter = Parameter(name, row["value"], row["unit"], row["shown"], row["provenance"], row["note"])
        parameters.append(parameter)
    return tuple(parameters)


def _motors(scene: RawStage, prim: Usd.Prim) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
    """Return (actuators, transmissions) in their original order; both are empty for a stage from other software.

    Raises:
        StageError: an entry does not have the form that twin writes.
    """
    actuators: list[Actuator] = []
    transmissions: list[Transmission] = []
    try:
        for name, row in _sorted_rows(prim.GetCustomDataByKey("twin:actuators")):
            actuators.append(_actuator(name, dict(row)))
        for name, row in _sorted_rows(prim.GetCustomDataByKey("twin:transmissions")):
            transmissions.append(_transmission(name, row))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StageError(
            f"{scene.path}: {prim.GetPath()}: the customData twin:actuators or twin:transmissions does not have the "
            f"form that twin writes ({type(error).__name__}: {error})"
        ) from error
    return tuple(actuators), tuple(transmissions)


def _sorted_rows(rows: JsonObject | None) -> list[tuple[str, JsonObject]]:
    """Return the (name, row) of a table in customData in their original order; USD stores dictionaries by name."""
    if not rows:
        return []
    return sorted(rows.items(), key=lambda item: item[1]["index"])


def _actuator(name: str, row: JsonObject) -> Actuator:
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


def _transmission(name: str, row: JsonObject) -> Transmission:
    joints = tuple(map(str, row["joints"]))
    actuators = tuple(map(str, row["actuators"]))
    matrix = np.array(row["matrix"], float).reshape(len(joints), len(actuators))
    return Transmission(name, joints, actuators, matrix)
