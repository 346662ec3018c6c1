"""Read which joints of a URDF are driven, and the motors and transmissions of those with a gear."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from twin.core.errors import SourceError, unknown
from twin.exchange.formats.urdf.read.gears import MOVING, read_gears
from twin.exchange.formats.urdf.read.link_structure import LinkStructure
from twin.exchange.read.imported_robot import Names, unique_identifiers
from twin.model.transmission import Actuator, Transmission


def drop_mimics_of_fixed(structure: LinkStructure) -> None:
    """Remove the <mimic> of each fixed joint, with a warning: tools that fix the joints of a hand often keep it."""
    for name, joint in structure.joints.items():
        mimic = joint.find("mimic")
        if mimic is None or joint.get("type") != "fixed" or name in structure.retyped:
            continue
        joint.remove(mimic)
        structure.findings.warn("mimic", f"joint '{name}' is fixed, so its mimic has no effect.", name)


def driven_joints(structure: LinkStructure) -> set[str]:
    """Return the driven joints: from the closure YAML, else from the transmissions, else all movable joints."""
    if structure.closures is not None:
        _check_motors(structure, structure.closures.motors)
        return set(structure.closures.motors)
    stated = _ros2_control_joints(structure) or _transmission_joints(structure)
    if stated:
        return stated
    moving: set[str] = set()
    for name, joint in structure.joints.items():
        if joint.get("type") in MOVING and joint.find("mimic") is None:
            moving.add(name)
    return moving


def _check_motors(structure: LinkStructure, motors: Sequence[str]) -> None:
    """Raise `SourceError` if the closure YAML names a driven joint that does not exist or cannot be driven."""
    where = f"{structure.closure_file}: name_mot"
    owners: dict[str, str] = {}
    for name in structure.joints:
        for part in structure.part_names(name):
            owners[part] = name
    for motor in motors:
        if motor not in owners:
            raise SourceError(f"{where}: {unknown('joint', motor, owners)}")
        name = owners[motor]
        kind = structure.retyped.get(name, structure.joints[name].get("type"))
        if kind not in MOVING and not str(kind).startswith("UJOINT"):
            raise SourceError(f"{where}: joint '{motor}' is {kind} and cannot be driven")


def _transmission_joints(structure: LinkStructure) -> set[str]:
    """Return the joints that transmissions move.

    Left out are joints that mimic another joint, which the other joint moves, and, with a warning, joints without one
    coordinate and names of no joint: files of a part of a robot often keep the transmissions of the whole robot.
    """
    driven = set()
    for transmission in structure.xml.root.findall("transmission"):
        label = str(transmission.get("name"))
        for element in transmission.findall("joint"):
            name = str(element.get("name"))
            joint = structure.joints.get(name)
            if joint is None:
                text = f"transmission '{label}' moves nothing: {unknown('joint', name, structure.joints)}"
                structure.findings.warn("gear", text, label)
            elif joint.get("type") == "fixed":
                text = f"transmission '{label}': joint '{name}' is fixed, so the transmission moves nothing."
                structure.findings.warn("gear", text, label)
            elif joint.get("type") not in MOVING and name not in structure.retyped:
                text = f"transmission '{label}': joint '{name}' is {joint.get('type')}, which no motor drives: the "
                text += "transmission moves nothing."
                structure.findings.warn("gear", text, label)
            elif joint.find("mimic") is not None:
                text = f"joint '{name}' mimics another joint, so its transmission drives nothing."
                structure.findings.note("gear", text, name)
            else:
                driven.add(name)
    return driven


def _ros2_control_joints(structure: LinkStructure) -> set[str]:
    """Return the joints that have a command interface in a <ros2_control>; all other joints are then passive."""
    driven = set()
    for system in structure.xml.root.findall("ros2_control"):
        for element in system.findall("joint"):
            name = str(element.get("name"))
            if element.find("command_interface") is None or element.find("mimic") is not None:
                continue
            if name not in structure.joints:
                structure.xml.fail("ros2_control", unknown("joint", name, structure.joints))
            joint = structure.joints[name]
            if joint.get("type") in MOVING and joint.find("mimic") is None:
                driven.add(name)
    return driven


def motors_and_transmissions(
    structure: LinkStructure, driven: Collection[str], names: Names
) -> tuple[tuple[Actuator, ...], tuple[Transmission, ...]]:
    """Return (motors, transmissions) of the joints whose gear ratio is not 1; other joints are driven directly."""
    gears = read_gears(structure.xml, structure.joints, structure.retyped, driven, structure.findings)
    motor_names: list[tuple[str, str]] = []
    transmission_names: list[tuple[str, str]] = []
    for name, gear in gears.items():
        motor_names.append((name, gear.motor))
        transmission_names.append((name, gear.transmission))
    motors = unique_identifiers("motor", motor_names, set(names.values()), structure.findings)
    labels = unique_identifiers("transmission", transmission_names, (), structure.findings)
    transmissions: list[Transmission] = []
    for name, gear in gears.items():
        matrix = np.array([[1 / gear.ratio]])
        transmissions.append(Transmission(labels[name], (names[name],), (motors[name],), matrix))
    return tuple(map(Actuator, motors.values())), tuple(transmissions)
