"""Save a posture in a robot's description, or a reached pose as the last phase of a protocol.

`twin.ui.session.toml_edits` writes the files: comments and layout are preserved, and a file is only replaced by text
that was read again without an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from twin.cad import description as descriptions
from twin.cad import references
from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM, SI
from twin.planning import phase_path
from twin.planning.protocol import (
    Home,
    Insertion,
    Pivot,
    Positioning,
    Protocol,
    Retraction,
    Samples,
    load_protocol,
    trocar_of,
)
from twin.planning.protocol.course import angles_of
from twin.schema import Identifier, error_at
from twin.ui.session.toml_edits import TomlEntry, rewrite

_DECIMALS = {"mm": 6, "deg": 8}
"""Number of decimals of values in mm and in deg; the resolution is 1 nm, for angles 1 nm at a radius of 5 m."""


def identifier(name: str) -> str:
    """Return `name` if it is a valid identifier for a posture or a phase.

    Raises:
        TwinError: the name is invalid.
    """
    try:
        return TypeAdapter(Identifier).validate_python(name)
    except ValidationError as error:
        text = "the name must begin with a small letter and contain only small letters, digits and _"
        raise TwinError(f"{ascii(name)[:80]}: {text}") from error


def save_posture(description: Path, name: str, values: Mapping[str, float], *, replace: bool = False) -> None:
    """Add a posture to a robot's description.

    Args:
        description: cad/<robot>/<robot>.toml.
        name: identifier of the posture.
        values: values of all active joints in m or rad.
        replace: whether an existing posture of this name may be overwritten; its comments are preserved.

    Raises:
        DescriptionError: the name exists or is not an identifier, joints are missing or unknown, a value is infinite,
            NaN or outside its limits, or the file was already invalid.
        OutputError: the file cannot be written.
    """
    description_data = descriptions.load(description)
    references.check(description, description_data)
    if name in description_data.posture and not replace:
        raise error_at(
            description, ("posture", name), "a posture of that name exists; choose another name, or replace it"
        )
    posture = _posture_entry(description, description_data, name, values)

    def check(new_file: Path) -> None:
        references.check(new_file, descriptions.load(new_file))

    rewrite(description, [TomlEntry("posture", name, posture)], check)


def append_phase(protocol: Path, name: str, T_base_tool: Array, T_tool_frame: Array) -> None:
    """Add a waypoint to a protocol, and a last phase of type "positioning" to this waypoint; both are named `name`.

    Args:
        protocol: trajectories/<robot>/<protocol>.toml.
        name: identifier of the waypoint and of the phase.
        T_base_tool: target pose (4, 4) of the tool.
        T_tool_frame: pose (4, 4), in the tool frame, of the frame that the protocol moves (`Mechanism.frame_in_tool`).

    Raises:
        DescriptionError: the name exists or is not an identifier, the instrument is still in the patient at the
            end of the protocol, limits for positioning phases are missing, or the file was already invalid.
        ProtocolError: the robot is already at the target.
        TwinError: T_base_tool is not a pose.
        OutputError: the file cannot be written.
    """
    loaded = load_protocol(protocol)
    T = np.asarray(T_base_tool, float)
    if not spatial.is_pose(T, 1e-6):
        raise TwinError(f"{protocol}: waypoint '{name}': T_base_tool is not a rigid pose: {T.tolist()}")
    if name in loaded.waypoints:
        raise error_at(protocol, ("waypoints", name), "a waypoint of that name exists; choose another name")
    phase_names = [phase.name for phase in loaded.phases]
    if name in phase_names:
        raise error_at(protocol, ("phases", phase_names.index(name)), f"there is a phase '{name}'; choose another name")
    if ends_in_patient(loaded):
        last = phase_names[-1]
        text = f"the instrument is in the patient after the last phase, '{last}': add a retraction to depth 0 first"
        raise error_at(protocol, ("phases", len(phase_names) - 1), text)
    # A protocol states the position of the frame that it moves, but the rotation of the tool (see `protocol.course`).
    waypoint = {
        "position_mm": _rounded_list((T @ T_tool_frame)[:3, 3] / MM, "mm"),
        "angles_deg": _rounded_list(angles_of(T[:3, :3], loaded.rotation, _last_angles(loaded)) / DEG, "deg"),
        "provenance": "ASSUMED",
        "note": "chosen by hand in the viewer",
    }
    phase = {"name": name, "type": "positioning", "to": name}

    def check(new_file: Path) -> None:
        written = load_protocol(new_file, folder=protocol.parent)
        by_joints = any(waypoint.joints is not None for waypoint in written.waypoints.values())
        has_samples = any(isinstance(phase, Samples) for phase in written.phases)
        if not by_joints and not has_samples:  # else the mechanism would be needed
            phase_path.build(written, T_tool_frame)

    rewrite(protocol, [TomlEntry("waypoints", name, waypoint), TomlEntry("phases", None, phase)], check)


def ends_in_patient(protocol: Protocol) -> bool:
    """Return whether the instrument is in the patient after the last phase of a protocol.

    An insertion or retraction decides by its depth; a phase that names a trocar takes place in it; a protocol with an
    RCM of its own begins in the patient.
    """
    in_patient = protocol.rcm is not None
    for phase in protocol.phases:
        if isinstance(phase, Insertion | Retraction):
            in_patient = phase.depth > 0
        elif trocar_of(phase):
            in_patient = True
    return in_patient


def _last_angles(protocol: Protocol) -> Array:
    """Return the orientation angles (3,) in rad at the end of a protocol's last phase."""
    waypoint = protocol.start
    for phase in protocol.phases:
        if isinstance(phase, Positioning | Pivot | Home):
            waypoint = phase.to
    return protocol.waypoints[waypoint].angles


def _posture_entry(
    path: Path, description: descriptions.Description, name: str, values: Mapping[str, float]
) -> dict[str, float]:
    """Return the table of a posture as it is written to the file.

    A key is the name and the unit of an active joint; its value is in this unit, rounded and within the limits.

    Args:
        path: the description, for messages.
        description: its content.
        name: name of the posture, for messages.
        values: values of all active joints in m or rad.

    Raises:
        DescriptionError: a joint is missing or unknown, or a value is not finite or outside its limits.
    """
    units = {}
    for joint_spec in description.joint:
        if joint_spec.active:
            units[joint_spec.name] = references.UNITS.get(joint_spec.type, "mm")
    limits = {}
    for limit in description.limit:
        for joint in limit.joints:
            limits[joint] = limit
    for joint in values:
        if joint not in units:
            raise error_at(path, ("posture", name), unknown("active joint", joint, units))
    posture = {}
    for joint, unit in units.items():
        key = f"{joint}_{unit}"
        if joint not in values:
            needed = ", ".join(f"{active}_{unit_of_active}" for active, unit_of_active in units.items())
            raise error_at(path, ("posture", name), f"active joint '{joint}' is missing; needed: {needed}")
        value = float(values[joint]) / SI[unit]
        if not np.isfinite(value):
            raise error_at(path, ("posture", name, key), f"{value} is not finite; give a number for '{joint}'")
        lower, upper = getattr(limits.get(joint), f"limits_{unit}", None) or (-np.inf, np.inf)
        rounding = 10.0 ** -_DECIMALS[unit]
        if not lower - rounding <= value <= upper + rounding:
            text = f"{value:.6g} {unit} is outside the limits {lower:g} .. {upper:g} {unit} of '{joint}'"
            raise error_at(path, ("posture", name, key), f"{text}; move the joint back, or change the limits")
        posture[key] = float(np.clip(_rounded(value, unit), lower, upper))
    return posture


def _rounded(value: float, unit: str) -> float:
    """Return a number in a unit, rounded for the file; -0.0 becomes 0.0."""
    return float(np.round(value, _DECIMALS[unit])) + 0.0


def _rounded_list(values: Array, unit: str) -> list[float]:
    return [_rounded(float(value), unit) for value in values]
