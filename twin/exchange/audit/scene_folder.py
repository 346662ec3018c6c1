"""Audit an exported scene: check the folder of each robot, and compare the scene's stages with the robots' files."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdPhysics

from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size
from twin.exchange.audit.deformables import audit_deformables
from twin.exchange.audit.file_comparison import references
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.folder_files import SCENE
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.report import POSITION_TOL, ROTATION_TOL, Ledger, Measured, ReadError, guarded, quantity
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds
from twin.exchange.formats.usd.audit import StageWorld
from twin.exchange.formats.usd.audit.checks import version
from twin.usd.check import run_usd_validators

_CONVENTION = re.compile(r"in its base frame, (?P<axis>\w) up, in (?P<unit>\w+)\.")

_LISTED = re.compile(r"One folder for each robot[^\n]*\n +(?P<names>[\w, ]+)\.\n")

REACH = 0.1
"""Distance in m between a link's origin and the other points at which deviations are measured, to include rotations."""

_OBJECTS = "objects"
"""Name of the prim of a scene's stages that contains the movable objects, beside those of the robots."""

_POSE_ROUNDING = 1e-9
"""Maximum deviation of the entries of a pose in scene.json, which are written with all digits of a double."""

Audited = tuple[list[Content], list[Ledger]]


@dataclass(frozen=True)
class SceneRobot:
    """Base pose and motion of a robot in an exported scene.

    `T_world_base` (4, 4) is the base pose in scene.json. `links` maps each link to its poses T_base_link (k, 4, 4) at
    the times `times` (k,) in s.
    """

    T_world_base: Array
    times: Array
    links: Mapping[str, Array]


def audit_scene(folder: Path, audited: Callable[[Path], Audited]) -> Audited:
    """Audit an exported scene; return (contents of the robots' files, ledgers of these files and of the stages).

    `audited` is a function that audits the folder of one robot. In the ledgers, file names begin with the name of the
    robot.
    """
    contents: list[Content] = []
    ledger = Ledger(SCENE, "twin.exchange.audit scene", "1")
    ledgers = [ledger]
    robots: dict[str, SceneRobot] = {}
    for name, protocol, T, path in _robots(folder, ledger):
        robot_contents, robot_ledgers = audited(path)
        _check_protocol(name, protocol, robot_contents, ledger)
        robots[name] = _motion_of_robot(robot_contents, protocol, T)
        contents += robot_contents
        for robot_ledger in robot_ledgers:
            _prefix(robot_ledger, name)
        ledgers += robot_ledgers
    ledger.row("robots", float(len(robots)), "found")
    if not ledger.found:  # else robots are missing, which is reported
        _check_readme(folder / "README.txt", robots, ledger)
    if robots:
        objects = _objects(folder, ledger)
        if objects and _OBJECTS in robots:
            text = f"a robot is named '{_OBJECTS}', as is the group of movable objects in the stages."
            ledger.add("scene.objects", "error", text, _OBJECTS, suggestion="give the robot another name")
        elif objects:
            robots[_OBJECTS] = SceneRobot(np.eye(4), np.zeros(1), objects)
            ledger.row("objects", float(len(objects)), "found")
        for stage in sorted((folder / "usd").glob("*.usda")):
            ledgers.append(_audit_stage(stage, robots))
    ledgers += audit_deformables(folder)
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


def _robots(folder: Path, ledger: Ledger) -> Iterator[tuple[str, str, Array, Path]]:
    """Yield (name, protocol or "", T_world_base, folder) of each robot in scene.json; report unusable entries."""
    check_size(folder / SCENE, "JSON")
    try:
        data = json.loads((folder / SCENE).read_text(encoding="utf-8"))
        rows = []
        for robot in data["robots"]:
            rows.append((str(robot["name"]), str(robot["protocol"]), robot["T_world_base"], str(robot["folder"])))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        text = f"the list of robots is missing or malformed: {type(error).__name__}, {error}."
        ledger.add("scene.unreadable", "error", text)
        return
    for name, protocol, rows_of_T, folder_name in rows:
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
            yield name, protocol, T, path


def _check_protocol(name: str, protocol: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Report a protocol of a robot in scene.json of which the robot's files have no motion, though they have others."""
    motions = list(references(contents, {}))
    if protocol and motions and not any(_is_motion_of(motion, protocol) for motion in motions):
        text = f"robot '{name}': its files have no motion '{protocol}', its protocol in {SCENE}; they have "
        advice = f"correct the protocol in {SCENE}, or export the scene again"
        ledger.wrong("scene.protocol", f"{text}{', '.join(motions)}.", name, suggestion=advice)


def _is_motion_of(motion: str, protocol: str) -> bool:
    return motion == protocol or motion.endswith(f"_{protocol}")


def _check_readme(file: Path, robots: Collection[str], ledger: Ledger) -> None:
    """Report what the README.txt of a scene of twin states otherwise than its files: unit, up axis, robots."""
    if not file.is_file():
        return
    check_size(file, "text")
    text = file.read_text(encoding="utf-8", errors="replace")
    where = file.name
    convention = _CONVENTION.search(text)
    if convention is None:
        return
    if convention["axis"] != "z" or convention["unit"] != "m":
        stated = f"{convention['axis']} up, in {convention['unit']}"
        message = f"{where} states that the robots' files are {stated}; they are z up, in m."
        ledger.wrong("scene.readme", message, where, suggestion="export the scene again")
    listed = _LISTED.search(text)
    names = set(listed["names"].split(", ")) if listed else set()
    if robots and names != set(robots):
        differing = ", ".join(sorted(names ^ set(robots)))
        message = f"{where} and {SCENE} do not name the same robots: {differing}."
        ledger.wrong("scene.readme", message, where, suggestion="export the scene again")


def _is_pose(T: Array) -> bool:
    """Return whether T is (4, 4), finite, a rotation without reflection, and has the last row (0, 0, 0, 1)."""
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    # A reflection is orthonormal too; only its determinant tells.
    is_orthonormal = np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=_POSE_ROUNDING)
    has_last_row = np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0, atol=_POSE_ROUNDING)
    return is_orthonormal and bool(np.linalg.det(R) > 0) and has_last_row


def _objects(folder: Path, ledger: Ledger) -> dict[str, Array]:
    """Return {object: T_world_object (1, 4, 4)} for the movable objects in scene.json; report unusable entries."""
    try:
        rows = json.loads((folder / SCENE).read_text(encoding="utf-8")).get("objects", [])
        objects: dict[str, Array] = {}
        for row in rows:
            objects[str(row["name"])] = np.array(row["T_world_object"], float).reshape(1, 4, 4)
    except (ValueError, KeyError, TypeError) as error:
        ledger.add("scene.objects", "error", f"the list of objects is malformed: {type(error).__name__}, {error}.")
        return {}
    for name, poses in objects.items():
        if not _is_pose(poses[0]):
            ledger.add("scene.objects", "error", f"object '{name}': T_world_object is not a pose (4, 4).", name)
            return {}
    return objects


def _motion_of_robot(contents: Sequence[Content], protocol: str, T_world_base: Array) -> SceneRobot:
    """Return the motion of a protocol in a robot's files; without a protocol, the poses at rest.

    Poses at rest are read from the GLB if it exists. The robot's stage is unsuitable for the comparison, because the
    scene's stages reference it: the poses are always equal.
    """
    for name, ref in references(contents, {}).items():
        if protocol and _is_motion_of(name, protocol):
            return SceneRobot(T_world_base, ref.clip.times, ref.clip.links)
    contents_at_rest = []
    for content in contents:
        if content.links and content.rest:
            contents_at_rest.append(content)
    contents_at_rest.sort(key=lambda c: not kind_holds(c.format, Holds.ALL_MOTIONS))
    links = {}
    if contents_at_rest and not protocol:
        for link in contents_at_rest[0].links or ():
            links[link] = contents_at_rest[0].rest[link][None]
    return SceneRobot(T_world_base, np.zeros(1), links)


def _audit_stage(path: Path, robots: Mapping[str, SceneRobot]) -> Ledger:
    ledger = Ledger(f"usd/{path.name}", "pxr", version())
    guarded(partial(_compare_stage, robots), path, ledger)
    return ledger


def _compare_stage(robots: Mapping[str, SceneRobot], path: Path, ledger: Ledger) -> None:
    admit(path)
    try:
        public_findings = []
        for finding in run_usd_validators(path):
            if finding.severity != "info":
                public_findings.append(finding)
        _check_bases(path, robots, ledger)
        _check_filters(path, ledger)
        worst, where, when = deviation(path, robots)
    except (Tf.ErrorException, RuntimeError) as error:
        reason = str(error).strip().splitlines()[-1]
        text = f"OpenUSD cannot read the stage: {reason[:200]}"
        raise ReadError(text, "usd.unreadable") from error
    for public_finding in public_findings:
        ledger.add(public_finding.code, public_finding.severity, public_finding.message, public_finding.where)
    ledger.row("public validators", float(len(public_findings)), "found", 0.0)
    check = "links in the world frame, compared with the robots' files"
    ledger.row(check, worst, "m", POSITION_TOL, where=where, when=when)
    if not worst <= POSITION_TOL:
        text = f"{where}: missing."
        if np.isnan(worst):
            text = f"{where}: its pose in the stage or in the robot's files is not finite."
        elif np.isfinite(worst):
            text = f"{where}: the pose differs from the robot's files by {quantity(worst, 'm')}."
        ledger.wrong("scene.link", text, where, size=Measured(worst, POSITION_TOL, "m"), when=when)


def _check_bases(path: Path, robots: Mapping[str, SceneRobot], ledger: Ledger) -> None:
    """Report robots whose base has another pose in the stage than in scene.json."""
    stage = Usd.Stage.Open(str(path))
    stage.Reload()
    world = StageWorld(stage)
    root = stage.GetDefaultPrim().GetPath()
    for name, robot in robots.items():
        prim = stage.GetPrimAtPath(root.AppendChild(name))
        if not prim:
            continue  # its links are missing
        T = world.poses(prim, [Usd.TimeCode.Default()])[0]
        distance = float(np.linalg.norm(T[:3, 3] - robot.T_world_base[:3, 3]))
        turn = float(angle(T[:3, :3], robot.T_world_base[:3, :3]))
        if not (distance <= POSITION_TOL and turn <= ROTATION_TOL):
            text = (
                f"robot '{name}': its base in {SCENE} differs by {quantity(distance, 'm')} and "
                f"{np.degrees(turn):.4g} deg from that in the stage."
            )
            size = Measured(distance, POSITION_TOL, "m")
            if distance <= POSITION_TOL:  # only the rotation is wrong
                size = Measured(float(np.degrees(turn)), float(np.degrees(ROTATION_TOL)), "deg")
            advice = f"correct T_world_base in {SCENE}, or the transform of the robot in the stage"
            ledger.wrong("scene.base", text, name, size=size, suggestion=advice)


def _check_filters(path: Path, ledger: Ledger) -> None:
    """Report links that collide with some of the shapes of a prop, and not with the others.

    Links touch or enter a prop as a whole by design: its shapes are left out of collisions together.
    """
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if not prim.HasAPI(UsdPhysics.FilteredPairsAPI):
            continue
        targets = set(UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetForwardedTargets())
        for group in sorted({target.GetParentPath() for target in targets}):
            shapes = _colliders(stage.GetPrimAtPath(group))
            unfiltered = []
            for shape in shapes:
                if shape not in targets:
                    unfiltered.append(shape)
            if unfiltered and any(shape in targets for shape in shapes):
                place = str(prim.GetPath())
                text = (
                    f"{place} collides with {unfiltered[0].name}, but not with the other shapes of {group.name}: "
                    "they are left out of collisions together, as the two touch by design."
                )
                advice = "add the shape to physics:filteredPairs"
                ledger.add("scene.filter", "warning", text, place, suggestion=advice)


def _colliders(group: Usd.Prim) -> list[Sdf.Path]:
    """Return the paths of the shapes directly below a prim that can collide, unless it is a link with joints."""
    if not group or group.HasAPI(UsdPhysics.RigidBodyAPI):
        return []
    shapes = []
    for prim in group.GetChildren():
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            shapes.append(prim.GetPath())
    return shapes


def deviation(stage: Path, robots: Mapping[str, SceneRobot]) -> tuple[float, str, str]:
    """Return the maximum deviation of a scene's stage from the robots' files: (deviation in m, robot and link, time).

    Deviations are measured at the first, middle and last key, at each link's origin and at points `REACH` from the
    origin. The deviation is infinite if the stage lacks a link, or if a robot's files have no link poses. It is NaN if
    a pose is not finite.
    """
    opened = Usd.Stage.Open(str(stage))
    opened.Reload()  # USD keeps layers in memory, but the file may have changed
    world = StageWorld(opened)
    rate = opened.GetTimeCodesPerSecond()
    root = opened.GetDefaultPrim().GetPath()
    corners = np.vstack([np.zeros(3), REACH * np.eye(3)])
    worst = 0.0
    where = ""
    when = ""
    for name, robot in robots.items():
        last = len(robot.times) - 1
        keys = sorted({0, len(robot.times) // 2, last})
        if not robot.links:
            return np.inf, f"link poses in the files of {name}", ""
        codes = []
        for key in keys:
            codes.append(Usd.TimeCode(float(robot.times[key] * rate)))
        for link, poses in robot.links.items():
            prim = opened.GetPrimAtPath(root.AppendChild(name).AppendChild(link))
            if not prim:
                return np.inf, f"{name}/{link}", ""
            for k, T in zip(keys, world.poses(prim, codes), strict=True):
                difference = T - robot.T_world_base @ poses[k]
                shift = corners @ difference[:3, :3].T + difference[:3, 3]
                distance = float(np.linalg.norm(shift, axis=1).max())
                moment = f"t = {robot.times[k]:.3f} s"
                if not np.isfinite(distance):  # no later deviation may replace it
                    return np.nan, f"{name}/{link}", moment
                if distance >= worst:
                    worst = distance
                    where = f"{name}/{link}"
                    when = moment
    return worst, where, when
