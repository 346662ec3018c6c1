"""Files that play a plan of several robots: a protocol with the samples of each robot, and a scene that names them.

The written scene has the places, ports, cameras and props of the scene that was planned. Robots at rest have the
joint values at which the plan avoided them. Console and organs are omitted: they are not part of a plan.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np
import tomlkit

from twin.cad.build import inputs
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.model.scene import Scene
from twin.planning.protocol import Limits, Protocol, TrajectoryTolerances

SCENE = "scene.toml"

_COPIED_TABLES = ("touching", "port", "camera")
"""Tables of the scene file that are copied."""

_DIGITS = 12
"""Number of decimals of written numbers in mm and deg; rounding then stays below the tolerances of waypoints."""


@dataclass(frozen=True)
class PhaseTimes:
    """A phase of one robot: its name, the name of the waypoint at its end, and its start and end in s."""

    name: str
    to: str
    t0: float
    t1: float


@dataclass(frozen=True)
class RobotSamples:
    """A robot with its samples.

    Attributes:
        protocol: the protocol of the robot; for a robot at rest, any protocol of this robot.
        joints: (name, whether an angle) of the driven joints.
        q: (k, n) joint values in m or rad; (1, n) for a robot at rest.
        phases: the phases; empty for a robot at rest.
    """

    protocol: Protocol
    joints: Sequence[tuple[str, bool]]
    q: Array
    phases: Sequence[PhaseTimes] = ()


def protocol_files(robots: Iterable[str], scene: Scene) -> dict[str, str]:
    """Return the name of each robot's protocol file; the names differ from each other and from those of other files."""
    used_names = {SCENE}
    if scene.props is not None:
        used_names.add(scene.props.name)
    files = {}
    for robot in robots:
        stem = robot
        while f"{stem}.toml" in used_names:
            stem += "_protocol"
        files[robot] = f"{stem}.toml"
        used_names.add(files[robot])
    return files


def write_plan_scene(
    scene: Scene, robots: Mapping[str, RobotSamples], t: Array, clearance: float, folder: Path
) -> None:
    """Write <robot>.csv and a protocol (`protocol_files`) for each robot, the scene file, and the props.

    Args:
        scene: the scene of the plan.
        robots: all robots of the scene, by the robot's name in the scene.
        t: (k,) times in s of the samples.
        clearance: required clearance in m.
        folder: an existing folder.

    Raises:
        TwinError: the props cannot be copied (`props_files`).
    """
    files = protocol_files(robots, scene)
    moving = []
    for name, robot in robots.items():
        times = t[[0, -1]]  # a robot at rest needs two samples
        if len(robot.q) > 1:
            moving.append(name)
            times = t
        write_samples(folder / f"{name}.csv", robot.joints, times, robot.q)
        protocol = _protocol(name, robot, float(t[-1]), scene)
        (folder / files[name]).write_text(tomlkit.dumps(protocol), encoding="utf-8")
    table = tomllib.loads(scene.file.read_text(encoding="utf-8"))
    head: JsonObject = {
        "name": f"{scene.name}_plan",
        "title": f"Planned motions of {' and '.join(moving)} in scene {scene.name}",
        "source": f"twin plan in scene {scene.name}; {scene.source}",
        "clearance_mm": _number(clearance / MM),
    }
    if scene.props is not None:
        head["props"] = scene.props.name
        for relative, file in props_files(scene.props).items():
            (folder / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, folder / relative)
    places = []
    for robot_table in table["robot"]:
        place = {**robot_table, "protocol": files[robot_table["name"]]}
        place.pop("start", None)  # the protocol says where the robot starts
        places.append(place)
    copied = {key: table[key] for key in _COPIED_TABLES if key in table}
    (folder / SCENE).write_text(tomlkit.dumps({**head, **copied, "robot": places}), encoding="utf-8")


def props_files(props: Path) -> dict[Path, Path]:
    """Return the files of the props: {path relative to the folder of the TOML file `props`: path of the file}.

    Raises:
        TwinError: the TOML file is malformed, has the name of the scene file of a plan, or names a file outside its
            folder, which a plan cannot copy.
    """
    if props.name == SCENE:
        raise TwinError(f"{props}: a plan writes its scene to {SCENE}: give the file of the props another name")
    files = {}
    for file in inputs(props):
        relative = Path(os.path.relpath(file, props.parent))
        if relative.parts[0] == "..":
            raise TwinError(f"{props}: {file} is outside the folder of the props; a plan copies only files inside it")
        files[relative] = file
    return files


def write_samples(path: Path, joints: Sequence[tuple[str, bool]], t: Array, q: Array) -> None:
    """Write q (k, n), in m or rad, at times t (k,) in s as CSV; the file is in mm and deg, with units in the header."""
    header = ["t_s"]
    factors = []
    for joint, is_angle in joints:
        unit, factor = display_unit(is_angle)
        header.append(f"{joint}_{unit}")
        factors.append(factor)
    values = np.broadcast_to(q / np.array(factors), (len(t), len(factors)))
    table = np.column_stack([t, values])
    # with these digits, speeds and accelerations can be computed from the samples
    np.savetxt(path, table, fmt="%.15g", delimiter=",", header=",".join(header), comments="")


def _protocol(name: str, robot: RobotSamples, end: float, scene: Scene) -> JsonObject:
    """Return the protocol of a robot as TOML."""
    source = robot.protocol
    is_angle = dict(robot.joints)
    waypoints = {}
    phases = []
    if robot.phases:
        title = source.title
        start = source.start
        limits = source.limits["free"]
        ends = [phase.to for phase in robot.phases]
        for waypoint_name in dict.fromkeys([source.start, *ends]):
            waypoint = source.waypoints[waypoint_name]
            values = _joints(waypoint.joints or {}, is_angle)
            waypoints[waypoint_name] = {
                "label": waypoint.label,
                **values,
                "provenance": waypoint.provenance,
                "note": waypoint.note,
            }
        for phase in robot.phases:
            phases.append(
                {
                    "type": "samples",
                    "name": phase.name,
                    "file": f"{name}.csv",
                    "to": phase.to,
                    "from_s": _number(phase.t0),
                    "to_s": _number(phase.t1),
                }
            )
    else:
        title = "At rest"
        start = "rest"
        limits = next(iter(source.limits.values()))
        names = [joint for joint, _ in robot.joints]
        rest_values = dict(zip(names, robot.q[0].tolist(), strict=True))
        note = f"where {name} was avoided in the plan"
        waypoints["rest"] = {
            "label": "at rest",
            **_joints(rest_values, is_angle),
            "provenance": "ASSUMED",
            "note": note,
        }
        phases.append({"type": "samples", "name": "rest", "file": f"{name}.csv", "to_s": _number(end)})
    table: JsonObject = {
        "name": name,
        "title": title,
        "source": f"twin plan in scene {scene.name}; {source.source}",
        "robot": source.robot,
        "frame": source.frame,
        "shaft_axis": list(map(float, source.shaft_axis)),
        "rotation": source.rotation,
        "start": start,
        "no_patient": source.no_patient or f"the patient, if there is one, is part of scene {scene.name}",
    }
    trocars = {}
    for trocar, position in source.trocars.items():
        trocars[trocar] = list(map(_number, position / MM))
    if "" in trocars:  # the only trocar has no name
        table["trocar_mm"] = trocars[""]
    elif trocars:
        table["trocars_mm"] = trocars
    table["tolerances"] = _tolerances(source.tolerances)
    return {**table, "limits": {"samples": _limits(limits)}, "waypoints": waypoints, "phases": phases}


def _joints(values: Mapping[str, float], is_angle: Mapping[str, bool]) -> JsonObject:
    """Return the entry `joints` of a waypoint with values in m or rad."""
    table = tomlkit.inline_table()
    for joint, value in values.items():
        unit, factor = display_unit(is_angle[joint])
        table[f"{joint}_{unit}"] = _number(value / factor)
    return {"joints": table}


def _tolerances(tolerances: TrajectoryTolerances) -> JsonObject:
    """Return the table of tolerances."""
    return {
        "rcm_mm": _number(tolerances.rcm / MM),
        "rcm_alarm_mm": _number(tolerances.rcm_alarm / MM),
        "straightness_mm": _number(tolerances.straightness / MM),
        "waypoint_mm": _number(tolerances.waypoint / MM),
        "waypoint_deg": _number(tolerances.waypoint_angle / DEG),
        "provenance": tolerances.provenance,
        "note": tolerances.note,
    }


def _limits(limits: Limits) -> JsonObject:
    """Return the table of limits; a limit that is infinite is left out."""
    values = {
        "tip_speed_mm_s": limits.tip_speed / MM,
        "tip_acceleration_mm_s2": limits.tip_acceleration / MM,
        "rotation_speed_deg_s": limits.rotation_speed / DEG,
        "rotation_acceleration_deg_s2": limits.rotation_acceleration / DEG,
        "tip_jerk_mm_s3": limits.tip_jerk / MM,
        "rotation_jerk_deg_s3": limits.rotation_jerk / DEG,
    }
    numbers = {}
    for key, value in values.items():
        if isfinite(value):
            numbers[key] = _number(value)
    return {**numbers, "provenance": limits.provenance, "note": limits.note}


def _number(value: float) -> float:
    """Return a number rounded for a file, -0 as 0."""
    return round(float(value), _DIGITS) + 0.0
