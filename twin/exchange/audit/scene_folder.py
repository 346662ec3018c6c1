"""Audit the folder of an exported scene: scene.json, the folder of each robot, and the scene's stages."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core.foreign.budget import check_size
from twin.core.json_types import JsonMapping, JsonObject
from twin.exchange.audit.clip_references import references
from twin.exchange.audit.deformables import audit_deformables
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.folder_files import SCENE
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.poses import Array
from twin.exchange.audit.scene_stage import SceneMotion, audit_stage
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds

_OBJECTS = "objects"
"""Name of the prim of a scene's stages that contains the movable objects, beside those of the robots."""

_POSE_ROUNDING = 1e-9
"""Maximum deviation of the entries of a pose in scene.json, which are written with all digits of a double."""

Audited = tuple[list[Content], list[Ledger]]
"""Contents of the audited files, and ledgers of these files."""


@dataclass(frozen=True)
class _RobotEntry:
    """A robot in scene.json.

    `protocol` is "" without a protocol. `T_world_base` (4, 4) is the pose of the robot's base, `folder` its folder.
    """

    name: str
    protocol: str
    T_world_base: Array
    folder: Path


def audit_scene(folder: Path, audited: Callable[[Path], Audited]) -> Audited:
    """Audit an exported scene; return (contents of the robots' files, ledgers of these files and of the stages).

    `audited` is a function that audits the folder of one robot. In the ledgers, file names begin with the name of the
    robot.
    """
    contents: list[Content] = []
    ledger = Ledger(SCENE, "twin.exchange.audit scene", "1")
    ledgers = [ledger]
    motions: dict[str, SceneMotion] = {}
    data = _scene_data(folder / SCENE, ledger)
    for robot in _robots(folder, data, ledger):
        robot_contents, robot_ledgers = audited(robot.folder)
        _check_protocol(robot, robot_contents, ledger)
        motions[robot.name] = _motion_of_robot(robot, robot_contents)
        contents += robot_contents
        for robot_ledger in robot_ledgers:
            _prefix(robot_ledger, robot.name)
        ledgers += robot_ledgers
    ledger.row("robots", float(len(motions)), "found")
    if motions:
        objects = _objects(data, ledger)
        if objects and _OBJECTS in motions:
            text = f"a robot is named '{_OBJECTS}', as is the group of movable objects in the stages."
            ledger.add("scene.objects", "error", text, _OBJECTS, suggestion="give the robot another name")
        elif objects:
            motions[_OBJECTS] = SceneMotion(np.eye(4), np.zeros(1), objects)
            ledger.row("objects", float(len(objects)), "found")
        for stage in sorted((folder / "usd").glob("*.usda")):
            ledgers.append(audit_stage(stage, motions))
    # scene.json has the checks of the scene's stage if the scene was exported to USD
    states_usd = bool(data.get("checks"))
    ledgers += audit_deformables(folder, states_usd or (folder / "usd").is_dir())
    return contents, ledgers


def _prefix(ledger: Ledger, name: str) -> None:
    """Put the name of a robot before the file names in a ledger, in its checks and in its findings."""
    ledger.file = f"{name}/{ledger.file}"
    checks = []
    for check in ledger.checks:
        checks.append(replace(check, file=f"{name}/{check.file}"))
    ledger.checks = checks
    findings = []
    for finding in ledger.found:
        findings.append(replace(finding, where=f"{name}/{finding.where}"))
    ledger.found = findings


def _scene_data(file: Path, ledger: Ledger) -> JsonObject:
    """Return what scene.json contains; if it is no JSON object, report this and return a scene without robots."""
    check_size(file, "JSON")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise TypeError("it is not an object")
    except (ValueError, TypeError, RecursionError) as error:
        _report_unreadable(error, ledger)
        return {"robots": []}
    return data


def _report_unreadable(error: Exception, ledger: Ledger) -> None:
    """Add a finding that scene.json does not list the robots."""
    text = f"the list of robots is missing or malformed: {type(error).__name__}, {error}."
    ledger.add("scene.unreadable", "error", text)


def _robots(folder: Path, data: JsonMapping, ledger: Ledger) -> Iterator[_RobotEntry]:
    """Yield the robots in the `data` of scene.json; report unusable entries."""
    try:
        rows = []
        for robot in data["robots"]:
            rows.append((str(robot["name"]), str(robot["protocol"]), robot["T_world_base"], str(robot["folder"])))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        _report_unreadable(error, ledger)
        return
    names: set[str] = set()
    for name, protocol, rows_of_T, folder_name in rows:
        if name in names:  # one prim of the stages cannot have the links of both
            ledger.add("scene.robots", "error", f"two robots are named '{name}'.", name)
            continue
        names.add(name)
        try:
            T = np.array(rows_of_T, float)
        except (ValueError, TypeError):
            T = np.zeros(0)
        path = folder / folder_name
        # A base that is no pose would make every link of the robot a finding of its own.
        if not _is_pose(T):
            ledger.add("scene.pose", "error", f"robot '{name}': T_world_base is not a pose (4, 4).", name)
        elif not os.path.isdir(path) or not path.resolve().is_relative_to(folder.resolve()):  # noqa: PTH112 - any name
            ledger.add("scene.folder", "error", f"robot '{name}': the scene has no folder '{folder_name}'.", name)
        else:
            yield _RobotEntry(name, protocol, T, path)


def _check_protocol(robot: _RobotEntry, contents: Sequence[Content], ledger: Ledger) -> None:
    """Report a protocol of a robot in scene.json of which the robot's files have no motion, though they have others."""
    motions = list(references(contents, {}))
    if not robot.protocol or not motions or any(_is_motion_of(motion, robot.protocol) for motion in motions):
        return
    text = (
        f"robot '{robot.name}': its files have no motion '{robot.protocol}', its protocol in {SCENE}; they have "
        f"{', '.join(motions)}."
    )
    advice = f"correct the protocol in {SCENE}, or export the scene again"
    ledger.wrong("scene.protocol", text, robot.name, suggestion=advice)


def _is_motion_of(motion: str, protocol: str) -> bool:
    """Return whether a motion in a robot's files is named as a protocol, with or without the name of the robot."""
    return motion == protocol or motion.endswith(f"_{protocol}")


def _is_pose(T: Array) -> bool:
    """Return whether T is (4, 4), finite, a rotation without reflection, and has the last row (0, 0, 0, 1)."""
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    # A reflection is orthonormal too; only its determinant tells.
    is_orthonormal = np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=_POSE_ROUNDING)
    has_last_row = np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0, atol=_POSE_ROUNDING)
    return is_orthonormal and bool(np.linalg.det(R) > 0) and has_last_row


def _objects(data: JsonMapping, ledger: Ledger) -> dict[str, Array]:
    """Return {object: T_world_object (1, 4, 4)} of the movable objects in the `data` of scene.json.

    If an entry is unusable, it is reported, and the result is {}.
    """
    try:
        objects: dict[str, Array] = {}
        for row in data.get("objects", []):
            objects[str(row["name"])] = np.array(row["T_world_object"], float).reshape(1, 4, 4)
    except (ValueError, KeyError, TypeError) as error:
        ledger.add("scene.objects", "error", f"the list of objects is malformed: {type(error).__name__}, {error}.")
        return {}
    for name, poses in objects.items():
        if not _is_pose(poses[0]):
            ledger.add("scene.objects", "error", f"object '{name}': T_world_object is not a pose (4, 4).", name)
            return {}
    return objects


def _motion_of_robot(robot: _RobotEntry, contents: Sequence[Content]) -> SceneMotion:
    """Return the motion of a robot's protocol in its files; without a protocol, the poses at rest.

    Poses at rest are read from the GLB if it exists. The robot's stage is unsuitable for the comparison, because the
    scene's stages reference it: the poses are always equal.
    """
    for name, reference in references(contents, {}).items():
        if robot.protocol and _is_motion_of(name, robot.protocol):
            return SceneMotion(robot.T_world_base, reference.clip.times, reference.clip.links)
    contents_at_rest = []
    for content in contents:
        if content.links and content.rest:
            contents_at_rest.append(content)
    contents_at_rest.sort(key=lambda content: not kind_holds(content.format, Holds.ALL_MOTIONS))
    links = {}
    if contents_at_rest and not robot.protocol:
        for link in contents_at_rest[0].links or ():
            links[link] = contents_at_rest[0].rest[link][None]
    return SceneMotion(robot.T_world_base, np.zeros(1), links)
