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
from typing import Any

import numpy as np
import tomlkit

from twin.cad.build import inputs
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.scene import Scene
from twin.planning.protocol import Limits, Protocol

SCENE = "scene.toml"

_KEPT = ("touching", "port", "camera")
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
    taken, out = {SCENE, "" if scene.props is None else scene.props.name}, {}
    for robot in robots:
        stem = robot
        while f"{stem}.toml" in taken:
            stem += "_protocol"
        out[robot] = f"{stem}.toml"
        taken.add(out[robot])
    return out


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
    for name, robot in robots.items():
        moving = len(robot.q) > 1
        write_samples(folder / f"{name}.csv", robot.joints, t if moving else t[[0, -1]], robot.q)
        about = _protocol(name, robot, float(t[-1]), scene)
        (folder / files[name]).write_text(tomlkit.dumps(about), encoding="utf-8")
    table = tomllib.loads(scene.file.read_text(encoding="utf-8"))
    moving = [name for name, robot in robots.items() if len(robot.q) > 1]
    head: dict[str, Any] = {
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
    places = [{k: v for k, v in r.items() if k != "start"} for r in table["robot"]]
    places = [{**r, "protocol": files[r["name"]]} for r in places]
    kept = {k: table[k] for k in _KEPT if k in table}
    (folder / SCENE).write_text(tomlkit.dumps({**head, **kept, "robot": places}), encoding="utf-8")


def props_files(props: Path) -> dict[Path, Path]:
    """Return the files of the props: {path relative to the folder of the TOML file `props`: path of the file}.

    Raises:
        TwinError: the TOML file is malformed, has the name of the scene file of a plan, or names a file outside its
            folder, which a plan cannot copy.
    """
    if props.name == SCENE:
        raise TwinError(f"{props}: a plan writes its scene to {SCENE}: give the file of the props another name")
    out = {}
    for file in inputs(props):
        relative = Path(os.path.relpath(file, props.parent))
        if relative.parts[0] == "..":
            raise TwinError(f"{props}: {file} is outside the folder of the props; a plan copies only files inside it")
        out[relative] = file
    return out


def write_samples(path: Path, joints: Sequence[tuple[str, bool]], t: Array, q: Array) -> None:
    """Write q (k, n), in m or rad, at times t (k,) in s as CSV; the file is in mm and deg, with units in the header."""
    units = ["deg" if angle else "mm" for _, angle in joints]
    values = np.broadcast_to(q / np.array([DEG if unit == "deg" else MM for unit in units]), (len(t), len(units)))
    header = ["t_s", *(f"{j}_{unit}" for (j, _), unit in zip(joints, units, strict=True))]
    # with these digits, speeds and accelerations can be computed from the samples
    table = np.column_stack([t, values])
    np.savetxt(path, table, fmt="%.15g", delimiter=",", header=",".join(header), comments="")


def _protocol(name: str, robot: RobotSamples, end: float, scene: Scene) -> dict[str, Any]:
    """Return the protocol of a robot as TOML."""
    p, angles = robot.protocol, dict(robot.joints)
    if robot.phases:
        start, limits = p.start, p.limits["free"]
        used = {n: p.waypoints[n] for n in dict.fromkeys([p.start, *(s.to for s in robot.phases)])}
        waypoints = {
            n: {"label": w.label, **_joints(w.joints or {}, angles), "provenance": w.provenance, "note": w.note}
            for n, w in used.items()
        }
        times = [{"to": s.to, "from_s": _number(s.t0), "to_s": _number(s.t1)} for s in robot.phases]
        phases = [
            {"type": "samples", "name": s.name, "file": f"{name}.csv", **more}
            for s, more in zip(robot.phases, times, strict=True)
        ]
        title = p.title
    else:
        start, limits = "rest", next(iter(p.limits.values()))
        at = {j: float(x) for (j, _), x in zip(robot.joints, robot.q[0], strict=True)}
        note = f"where {name} was avoided in the plan"
        waypoints = {"rest": {"label": "at rest", **_joints(at, angles), "provenance": "ASSUMED", "note": note}}
        phases = [{"type": "samples", "name": "rest", "file": f"{name}.csv", "to_s": _number(end)}]
        title = "At rest"
    out: dict[str, Any] = {
        "name": name,
        "title": title,
        "source": f"twin plan in scene {scene.name}; {p.source}",
        "robot": p.robot,
        "frame": p.frame,
        "shaft_axis": [float(x) for x in p.shaft_axis],
        "rotation": p.rotation,
        "start": start,
        "no_patient": p.no_patient or f"the patient, if there is one, is part of scene {scene.name}",
    }
    places = {n: [_number(x / MM) for x in place] for n, place in p.trocars.items()}
    if "" in places:
        out["trocar_mm"] = places[""]
    elif places:
        out["trocars_mm"] = places
    t = p.tolerances
    out["tolerances"] = {
        "rcm_mm": _number(t.rcm / MM),
        "rcm_alarm_mm": _number(t.rcm_alarm / MM),
        "straightness_mm": _number(t.straightness / MM),
        "waypoint_mm": _number(t.waypoint / MM),
        "waypoint_deg": _number(t.waypoint_angle / DEG),
        "provenance": t.provenance,
        "note": t.note,
    }
    return {**out, "limits": {"samples": _limits(limits)}, "waypoints": waypoints, "phases": phases}


def _joints(values: Mapping[str, float], angles: Mapping[str, bool]) -> dict[str, Any]:
    """Return the entry `joints` of a waypoint with values in m or rad."""
    table = tomlkit.inline_table()
    for j, x in values.items():
        table[f"{j}_{'deg' if angles[j] else 'mm'}"] = _number(x / (DEG if angles[j] else MM))
    return {"joints": table}


def _limits(limits: Limits) -> dict[str, Any]:
    values = {
        "tip_speed_mm_s": limits.tip_speed / MM,
        "tip_acceleration_mm_s2": limits.tip_acceleration / MM,
        "rotation_speed_deg_s": limits.rotation_speed / DEG,
        "rotation_acceleration_deg_s2": limits.rotation_acceleration / DEG,
        "tip_jerk_mm_s3": limits.tip_jerk / MM,
        "rotation_jerk_deg_s3": limits.rotation_jerk / DEG,
    }
    numbers = {k: _number(v) for k, v in values.items() if isfinite(v)}
    return {**numbers, "provenance": limits.provenance, "note": limits.note}


def _number(value: float) -> float:
    """Return a number rounded for a file, -0 as 0."""
    return round(float(value), _DIGITS) + 0.0
