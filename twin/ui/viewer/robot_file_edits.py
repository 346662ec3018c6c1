"""Write results of an interactive session into the robot's TOML files.

Comments and layout are preserved. The new text is validated before it replaces the file; after an error, the file is
unchanged.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from pydantic import TypeAdapter, ValidationError
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table, Whitespace

from twin.cad import description as descriptions
from twin.cad import references
from twin.core import spatial
from twin.core.assets import atomic_folder
from twin.core.errors import DescriptionError, OutputError, TwinError, unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM, SI
from twin.planning import phase_path as paths
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
from twin.ui.session.recorded_session import RecordedSession as RecordedSession

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
    file_values = _in_file_units(description, description_data, name, values)

    def check(fresh: Path) -> None:
        references.check(fresh, descriptions.load(fresh))

    rewrite(description, [("posture", name, file_values)], check)


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
    if _ends_inside(loaded):
        last = phase_names[-1]
        text = f"the instrument is in the patient after the last phase, '{last}': add a retraction to depth 0 first"
        raise error_at(protocol, ("phases", len(phase_names) - 1), text)
    waypoint = {
        "position_mm": _rounded((T @ T_tool_frame)[:3, 3] / MM, "mm"),
        "angles_deg": _rounded(angles_of(T[:3, :3], loaded.rotation, _last_angles(loaded)) / DEG, "deg"),
        "provenance": "ASSUMED",
        "note": "chosen by hand in the viewer",
    }
    phase = {"name": name, "type": "positioning", "to": name}

    def check(fresh: Path) -> None:
        written = load_protocol(fresh, folder=protocol.parent)
        by_joints = any(waypoint.joints is not None for waypoint in written.waypoints.values())
        has_samples = any(isinstance(phase, Samples) for phase in written.phases)
        if not by_joints and not has_samples:  # else the mechanism would be needed
            paths.build(written, T_tool_frame)

    rewrite(protocol, [("waypoints", name, waypoint), ("phases", None, phase)], check)


def _last_angles(p: Protocol) -> Array:
    """Return the orientation angles (3,) in rad at the end of a protocol's last phase."""
    goals = [phase.to for phase in p.phases if isinstance(phase, Positioning | Pivot | Home)]
    return p.waypoints[goals[-1] if goals else p.start].angles


def _ends_inside(p: Protocol) -> bool:
    inside = p.rcm is not None
    for phase in p.phases:
        if isinstance(phase, Insertion | Retraction):
            inside = phase.depth > 0
        elif trocar_of(phase):
            inside = True
    return inside


def _in_file_units(
    path: Path, description: descriptions.Description, name: str, values: Mapping[str, float]
) -> dict[str, float]:
    """Return a posture as it is written to the file: rounded values in mm or deg; a key is a joint's name and unit."""
    keys = {}
    for joint_spec in description.joint:
        if joint_spec.active:
            unit = references.UNITS.get(joint_spec.type, "mm")
            keys[joint_spec.name] = f"{joint_spec.name}_{unit}"
    limits = {}
    for limit in description.limit:
        for joint in limit.joints:
            limits[joint] = limit
    for joint in values:
        if joint not in keys:
            raise error_at(path, ("posture", name), unknown("active joint", joint, keys))
    posture = {}
    for joint, key in keys.items():
        unit = key.rpartition("_")[2]
        if joint not in values:
            raise error_at(path, ("posture", name), f"active joint '{joint}' is missing; needed: {', '.join(keys)}")
        value = float(values[joint]) / SI[unit]
        if not np.isfinite(value):
            raise error_at(path, ("posture", name, key), f"{value} is not finite; give a number for '{joint}'")
        lower, upper = getattr(limits.get(joint), f"limits_{unit}", None) or (-np.inf, np.inf)
        last = 10.0 ** -_DECIMALS[unit]
        if not lower - last <= value <= upper + last:
            text = f"{value:.6g} {unit} is outside the limits {lower:g} .. {upper:g} {unit} of '{joint}'"
            raise error_at(path, ("posture", name, key), f"{text}; move the joint back, or change the limits")
        posture[key] = float(np.clip(_rounded(value, unit), lower, upper))
    return posture


def _rounded(value: Any, unit: str) -> Any:
    """Return a number or list of numbers, rounded for the file, without negative zeros."""
    return (np.round(value, _DECIMALS[unit]) + 0.0).tolist()


Entry = tuple[str, str | None, JsonObject]
"""(Table, key, values) of an entry to add. The values become the table `table.key` or, if the key is None, the last
element of the list `table`."""


def rewrite(path: Path, entries: list[Entry], check: Callable[[Path], None]) -> None:
    """Write entries into a TOML file, if the new text passes a check.

    `check` is called with the path of a file of the same name that contains the new text. It raises `TwinError` if the
    text is invalid.

    Raises:
        TwinError: `check` raised it.
        DescriptionError: the entries cannot be added in the layout of the file.
        OutputError: the file cannot be written.
    """
    target = path.resolve()
    text = target.read_bytes().decode("utf-8")
    expected = tomllib.loads(text)
    try:
        document: Any = tomlkit.parse(text)
        for table, key, values in entries:
            if key is None:
                expected[table].append(values)
                _append(document, table, None, values)
            else:
                expected.setdefault(table, {})[key] = values
                _append(document, table, key, values)
        new = tomlkit.dumps(document)
        if "\r\n" in text:
            new = new.replace("\r\n", "\n").replace("\n", "\r\n")
        same = tomllib.loads(new) == expected
    except (TOMLKitError, ValueError, TypeError, AttributeError) as error:
        raise _layout(path, entries) from error
    if not same:
        raise _layout(path, entries)
    try:
        with atomic_folder(target.parent) as work:
            fresh = work / target.name
            fresh.write_bytes(new.encode())
            shutil.copymode(target, fresh)
            try:
                check(fresh)
            except TwinError as error:
                reason = str(error).replace(str(fresh), str(path))
                raise type(error)(f"{reason} (in the new text; the file is unchanged)") from error
    except OutputError as error:
        why = getattr(error.__cause__, "strerror", None) or error
        text = (
            f"{path}: cannot be written: {why}. Copy the robot's folders to a writable place, and load the robot from "
            "there."
        )
        raise OutputError(text) from error


def _append(document: Any, table: str, key: str | None, values: JsonObject) -> None:
    """Append values to the list `table` or, with a key, set the values in `table.key`; existing values are replaced."""
    parent: Any = document.get(table)
    if key is not None and parent is not None and key in parent:
        parent[key].update(values)
        return
    if parent is None:
        document[table] = parent = tomlkit.table(is_super_table=True)
    fresh: Any = tomlkit.table()
    fresh.update(values)
    before = list(parent if key is None else parent.values())
    if before and isinstance(before[-1], Table) and not isinstance(parent, OutOfOrderTableProxy):
        # Comments after a blank line below the last table belong to the next table; insert the new table before them.
        body = before[-1].value.body
        end = max((n + 1 for n, (k, _) in enumerate(body) if k is not None), default=0)
        end = next((n for n in range(end, len(body)) if isinstance(body[n][1], Whitespace)), len(body))
        below = [item for _, item in body[end:]]
        del body[end:]
        before[-1].add(tomlkit.nl())
        for item in below:
            fresh.append(None, item)
    if key is None:
        document[table].append(fresh)
    else:
        parent[key] = fresh


def _layout(path: Path, entries: list[Entry]) -> DescriptionError:
    names = ", ".join(f"[{table}.{key}]" if key else f"[[{table}]]" for table, key, _ in entries)
    return DescriptionError(
        f"{path}: cannot add {names} in this layout: write the existing tables of this kind with such headers, too"
    )
