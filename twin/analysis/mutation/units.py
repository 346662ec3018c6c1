"""Seed unit faults: one parameter of the equations, or numbers of the protocol, are given in a wrong unit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import tomlkit

from twin.analysis.mutation.fault import SeededFault, random_item
from twin.api.robot import Robot
from twin.core.json_types import JsonObject
from twin.planning.protocol import Protocol, load_protocol

KINDS = (
    *("parameter", "position", "parameter", "angles", "parameter", "speed", "parameter"),
    *("depth", "turning", "trocar"),
)
"""Kinds of faults in the order of seeding; kinds that do not apply to the robot are skipped."""

_LENGTH_UNITS = ("m", "mm", "um", "µm")
"""Units of lengths that can be given in a wrong unit."""

_ANGLE_UNITS = ("deg", "rad")
"""Units of angles that can be given in a wrong unit."""

_MOST_TRIES = 10
"""Tries for each fault, at most: kinds that do not apply, and faults that were seeded before, are drawn as well."""


def faults(robot: Robot, protocol: Path, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield unit faults of a robot's parameters and of a protocol file."""
    text = protocol.read_text(encoding="utf-8")
    seeded: set[str] = set()
    for i in range(_MOST_TRIES * count):
        if len(seeded) == count:
            return
        kind = KINDS[i % len(KINDS)]
        if kind == "parameter":
            fault = _parameter_fault(robot, rng)
            if fault is None:
                continue
        else:
            document = tomlkit.parse(text)
            what = _FAULT_OF_KIND[kind](document, rng)
            if what is None:
                continue
            fault = SeededFault("units", kind, what, protocol=_protocol_maker(protocol, tomlkit.dumps(document)))
        if fault.what not in seeded:
            seeded.add(fault.what)
            yield fault


def _protocol_maker(original: Path, text: str) -> Callable[[Path], Protocol]:
    """Return the function that writes a protocol with this text to a folder, and reads it as if beside `original`."""

    def read(folder: Path) -> Protocol:
        path = folder / original.name
        path.write_text(text, encoding="utf-8")
        return load_protocol(path, folder=original.parent)

    return read


def _parameter_fault(robot: Robot, rng: np.random.Generator) -> SeededFault | None:
    """Return a fault of a length or an angle among the parameters; None if there is none."""
    candidates = []
    for parameter in robot.formula.parameters:
        has_unit = parameter.unit in _LENGTH_UNITS or parameter.unit in _ANGLE_UNITS
        # Zero is the same in all units; a parameter that the robot replaces has no effect.
        if has_unit and parameter.value and parameter.name not in robot.parameters:
            candidates.append(parameter)
    if not candidates:
        return None
    parameter_in_wrong_unit = random_item(candidates, rng)
    if parameter_in_wrong_unit.unit in _ANGLE_UNITS:
        factor = float(rng.choice((180 / np.pi, np.pi / 180)))
        units = "degrees instead of radians" if factor > 1 else "radians instead of degrees"
    else:
        factor = float(rng.choice((1000.0, 0.001)))
        units = "mm instead of m" if factor > 1 else "m instead of mm"

    def make(folder: Path) -> Robot:
        return robot.with_parameters({parameter_in_wrong_unit.name: factor * parameter_in_wrong_unit.value})

    return SeededFault("units", "parameter", f"{parameter_in_wrong_unit.name} with {units}", robot=make)


def _scaled(value: float, factor: float) -> float:
    """Return a number of a protocol times a factor, with five significant digits, as in a hand-written file."""
    return float(f"{factor * float(value):.5g}")


def _waypoint_fault(
    document: JsonObject, rng: np.random.Generator, key: str, least: float, factor: float, unit: str
) -> str | None:
    """Multiply the values of `key` by `factor` in a random waypoint, of those with a magnitude above `least`."""
    waypoints = document["waypoints"]
    candidates = []
    for name, waypoint in waypoints.items():
        magnitudes = np.abs(np.array(waypoint.get(key, 0.0), float))
        if magnitudes.max() > least:
            candidates.append(name)
    if not candidates:
        return None
    waypoint_name = random_item(candidates, rng)
    values = waypoints[waypoint_name][key]
    scaled_values = []
    for value in values:
        scaled_values.append(_scaled(value, factor))
    waypoints[waypoint_name][key] = scaled_values
    quantity = key.partition("_")[0]
    return f"{quantity} of waypoint '{waypoint_name}' in {unit}"


def _depth_fault(document: JsonObject, rng: np.random.Generator) -> str | None:
    """Give a depth of a waypoint or an insertion in metres."""
    tables = []
    for waypoint in document["waypoints"].values():
        if waypoint.get("depth_mm"):
            tables.append(waypoint)
    for phase in document["phases"]:
        if phase.get("depth_mm") and phase["type"] == "insertion":
            tables.append(phase)
    if not tables:
        return None
    table = random_item(tables, rng)
    depth = float(table["depth_mm"])
    table["depth_mm"] = _scaled(depth, 1e-3)
    return f"a depth of {depth:g} mm in metres"


def _limits_fault(document: JsonObject, rng: np.random.Generator, name: str, factor: float, unit: str) -> str:
    """Multiply the speed of tip or rotation in one of the limits, or speed and acceleration."""
    kind = random_item(list(document["limits"]), rng)
    limits = document["limits"][kind]
    if rng.integers(2) == 0:
        quantity = "speed and acceleration"
        prefixes = (f"{name}_speed_", f"{name}_acceleration_")
    else:
        quantity = "speed"
        prefixes = (f"{name}_speed_",)
    for key in list(limits):
        if key.startswith(prefixes):
            limits[key] = _scaled(limits[key], factor)
    return f"{name} {quantity} of {kind} in {unit}"


def _trocar_fault(document: JsonObject, rng: np.random.Generator) -> str | None:
    """Give the position of a trocar in metres."""
    named_trocars = document.get("trocars_mm", {})
    places = []
    for key in ("trocar_mm", "rcm_mm"):
        if key in document:
            places.append((document, key, key))
    for name in named_trocars:
        places.append((named_trocars, name, f"trocar '{name}'"))
    if not places:
        return None
    table, key, what = places[0]
    if named_trocars:
        table, key, what = random_item(places, rng)
    position = []
    for value in table[key]:
        position.append(_scaled(value, 1e-3))
    table[key] = position
    return f"{what} in metres"


# Each function changes a parsed protocol, and returns what it changed; None: its kind does not apply.
_FAULT_OF_KIND: dict[str, Callable[[JsonObject, np.random.Generator], str | None]] = {
    "position": lambda d, rng: _waypoint_fault(d, rng, key="position_mm", least=1.0, factor=1e-3, unit="metres"),
    "angles": lambda d, rng: _waypoint_fault(d, rng, key="angles_deg", least=0.0, factor=np.pi / 180, unit="radians"),
    "depth": _depth_fault,
    "speed": lambda d, rng: _limits_fault(d, rng, name="tip", factor=1e-3, unit="m/s"),
    "turning": lambda d, rng: _limits_fault(d, rng, name="rotation", factor=np.pi / 180, unit="rad/s"),
    "trocar": _trocar_fault,
}
