"""Export a scene: a checked bundle for each robot with its base pose, and one USD stage with all robots.

Files in formats other than USD contain one robot with its motion. `scene.json` contains the pose of each robot's base.
A player must place the bases and start all motions together. A robot that a console controls has no motion: its
files contain the start pose of the console, and `scene.json` contains the joint values at this pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.api.exports import export
from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.api.scene_parts import anatomy_of, props_of
from twin.core import assets
from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import UM
from twin.exchange.formats.glb.write import bends_glb
from twin.exchange.write.bundle import Bundle, chosen_formats
from twin.exchange.write.clip import ClipAccuracy
from twin.exchange.write.home_poses import home_poses
from twin.exchange.write.player_interpolation import poses_between_keys
from twin.model.deformable import Bend
from twin.model.movable import Movable, objects_as_mechanism
from twin.model.scene import Place, Scene, load_scene

_POSITION_TOLERANCE = 1 * UM
"""Maximum distance in m between two world positions of a link: in the scene's stage, and in its robot's bundle."""

_START_DECIMALS = 13
"""Decimals of the joint values in scene.json, as of the poses in exported files."""

_ORGAN_RATE = 60.0
"""Rate in Hz at which the motion of organs is simulated and written."""


@dataclass(frozen=True)
class SceneBundle(Result):
    """The files written for a scene.

    Attributes:
        formats: the formats written.
        bundles: {robot: its bundle (the exported files of this robot)}.
        checks: results of the checks of the scene's USD stage; empty if USD is not among the formats.
    """

    scene: Scene
    formats: tuple[str, ...]
    bundles: Mapping[str, Bundle]
    checks: tuple[JsonObject, ...]

    kind = "scene-export"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the bundles of all robots and on the scene's USD stage."""
        findings: list[Finding] = []
        for bundle in self.bundles.values():
            findings += bundle.findings
        for check in self.checks:
            if check["verdict"] != "agree":
                findings.append(_finding(check))
        return tuple(findings)

    def content(self) -> JsonObject:
        """Return the bundles and checks as plain data; the keys of quantities end with the unit."""
        parameters = []
        for parameter in self.scene.parameters:
            parameters.append(
                {
                    "name": parameter.name,
                    "value": parameter.shown,
                    "unit": parameter.unit,
                    "provenance": parameter.provenance,
                }
            )
        robots = []
        for place in self.scene.places:
            robots.append(_robot_data(place, self.bundles[place.name]))
        return {
            "scene": self.scene.name,
            "title": self.scene.title,
            "duration_s": _duration(self.bundles),
            "robots": robots,
            "objects": list(map(_object_data, self.scene.objects)),
            "checks": list(self.checks),
            "parameters": parameters,
        }

    def text(self) -> Iterator[Part]:
        """Yield the verdict, findings, a row for each robot, and the deviation of the stage."""
        yield f"{self.scene.name} · {self.scene.title}\n\n  {self.verdict.upper()}\n"
        for finding in by_severity(self.findings):
            if finding.severity != "info":
                yield finding
        rows = []
        for place in self.scene.places:
            bundle = self.bundles[place.name]
            duration = f"{_seconds(bundle):.1f} s"
            rows.append((place.name, place.protocol_name or "console", duration, str(len(bundle.checks))))
        yield TextTable(("robot", "protocol", "duration", "checks"), rows)
        yield ""
        for check in self.checks:
            if check["worst"] is not None:
                worst_um = check["worst"] / UM
                limit_um = check["tolerance"] / UM
                yield (
                    f"  the scene's stage: maximum deviation from the bundles {worst_um:.3f} µm, limit {limit_um:g} µm"
                )


def _robot_data(place: Place, bundle: Bundle) -> JsonObject:
    """Return what scene.json says of a robot: its folder, base pose, motion and checks."""
    start = {}
    if not place.protocol:
        start = _start(bundle)
    return {
        "name": place.name,
        "folder": place.name,
        "protocol": place.protocol_name,
        "T_world_base": place.T_world_base.tolist(),
        "duration_s": _seconds(bundle),
        "start": start,
        "verdict": bundle.verdict,
        "checks": len(bundle.checks),
    }


def _object_data(movable: Movable) -> JsonObject:
    """Return what scene.json says of a movable object."""
    return {
        "name": movable.name,
        "shape": movable.shape,
        "size_m": list(movable.size),
        "mass_kg": movable.mass,
        "friction": movable.friction,
        "T_world_object": movable.T_world_object.tolist(),
    }


def export_scene(
    file: Path,
    folder: Path | None = None,
    formats: Sequence[str] | None = None,
    *,
    budget: ClipAccuracy | None = None,
    progress: Progress = silent,
) -> SceneBundle:
    """Write a bundle for each robot of a scene and one USD stage with all robots, and check the written files.

    `file` is a scene.toml; the default folder is ./twin-out/<scene>/export/. For formats and budget see `twin.export`.

    Raises:
        TwinError: an input is missing or malformed; the folder stays unchanged.
    """
    scene = load_scene(file)
    kinds = chosen_formats(formats)
    root = folder or Path("twin-out") / scene.name / "export"
    assets.require_writable(root)
    bundles: dict[str, Bundle] = {}
    with assets.atomic_folder(root) as work:
        for place in scene.places:
            protocols = [place.protocol] if place.protocol else []
            bundles[place.name] = export(
                _robot(place),
                out=work / place.name,
                to=kinds,
                protocols=protocols,
                budget=budget,
                progress=lambda label, part, name=place.name: progress(f"{name}: {label}", part),
            )
        # scene.json has the shapes as numbers, and the stage the objects themselves: only GLB needs a file more
        if scene.objects and "glb" in kinds:
            from twin.exchange.formats.glb.write import write_glb

            write_glb(objects_as_mechanism(scene.objects), (), work / "objects.glb")
        progress("organs", 0.0)
        bends = _bends(scene, bundles)
        if bends and "glb" in kinds:
            (work / "organs.glb").write_bytes(bends_glb("organs", bends))
        checks: tuple[JsonObject, ...] = ()
        if "usd" in kinds:
            stage = _write_stage(scene, bundles, work / "usd", bends)
            checks = (_check(stage, scene, bundles),)
        bundle_of_scene = SceneBundle(scene, kinds, bundles, checks)
        (work / "scene.json").write_text(bundle_of_scene.to_json() + "\n", encoding="utf-8")
        (work / "README.txt").write_text(_readme(scene, kinds), encoding="utf-8")
    return bundle_of_scene


def _robot(place: Place) -> Robot:
    """Return the robot of a place.

    If the place has no protocol (a console moves the robot), the robot has masses, and its rest pose is the pose at
    the start of a console session.
    """
    from twin.simulation.console_scene import start

    robot = load(place.robot)
    if place.protocol:
        return robot
    robot = robot.weighed()
    # players show the rest pose of a file without motion
    q_start = start(place, robot.mechanism)
    rest = robot.reference().solve(q_start).link_poses
    return robot.with_mechanism(replace(robot.mechanism, rest=rest))


def _bends(scene: Scene, bundles: Mapping[str, Bundle]) -> list[Bend]:
    """Return the motions of the organs caused by the robots' exported motions; empty without organs or motions."""
    from twin.simulation import tissue_scene
    from twin.simulation.plants.tissue import Tool

    duration = _duration(bundles)
    organs = anatomy_of(scene)
    if organs is None or not duration:  # organs move only because robots touch them
        return []
    times = np.arange(round(duration * _ORGAN_RATE) + 1) / _ORGAN_RATE
    places = {place.name: place for place in scene.places}
    tools = []
    poses = []
    for robot, bodies in tissue_scene.touching(scene).items():
        keys, links = _keys(bundles[robot])
        mechanism = bundles[robot].order.mechanism
        for body in bodies:
            tools.append(Tool(robot, mechanism.body(body)))
            Ts_base_body = poses_between_keys(keys, links[body], times)
            poses.append(places[robot].T_world_base @ Ts_base_body)
    tissues = tissue_scene.tissues(scene, organs)
    return tissue_scene.followed(tissues, tools, poses, 1 / _ORGAN_RATE)


def _write_stage(scene: Scene, bundles: Mapping[str, Bundle], folder: Path, bends: Sequence[Bend]) -> Path:
    from twin.exchange.formats.usd.write import write_simulated
    from twin.simulation.scene_stage import write_scene

    stages = {}
    for place in scene.places:
        name = place.robot
        if place.protocol_name:
            name += f"_{place.protocol_name}"
        stages[place.name] = Path("..") / place.name / "usd" / f"{name}.usda"
    mechanisms = {}
    for name, bundle in bundles.items():
        mechanisms[name] = bundle.order.mechanism
    props = props_of(scene)
    stage = write_scene(scene, folder, stages, mechanisms, props, _duration(bundles), bends)
    if not _plays(scene):  # otherwise drives would oppose the baked motions
        write_simulated(scene.name, folder)
    return stage


def _plays(scene: Scene) -> bool:
    """Return whether a robot of the scene plays a protocol."""
    return any(place.protocol for place in scene.places)


def _duration(bundles: Mapping[str, Bundle]) -> float:
    """Return the duration in s of the longest motion of a robot: all motions start together."""
    return max(map(_seconds, bundles.values()))


def _seconds(bundle: Bundle) -> float:
    """Return the duration of a robot's motion in s; 0 without motion."""
    ends = [float(clip.times[-1]) for clip in bundle.order.clips]
    return max(ends, default=0.0)


def _start(bundle: Bundle) -> dict[str, float]:
    """Return {joint: coordinate in m or rad} in the rest pose of a robot's files, for joints with one coordinate."""
    from twin.reference import ReferenceModel

    home = ReferenceModel(bundle.order.mechanism).home()
    start = {}
    for name, value in home.q_full.items():
        # rounded, so that the file does not depend on the processor; + 0.0 turns -0.0 into 0.0
        start[name] = round(value, _START_DECIMALS) + 0.0
    return start


def _check(stage: Path, scene: Scene, bundles: Mapping[str, Bundle]) -> JsonObject:
    """Return the maximum deviation between the link poses in the scene's USD stage and in the robots' bundles."""
    from twin.exchange.audit.scene_stage import SceneMotion, largest_deviation

    motions: dict[str, SceneMotion] = {}
    for place in scene.places:
        times, links = _keys(bundles[place.name])
        motions[place.name] = SceneMotion(place.T_world_base, times, links)
    if scene.objects:
        poses = {movable.name: movable.T_world_object[None] for movable in scene.objects}
        motions["objects"] = SceneMotion(np.eye(4), np.zeros(1), poses)
    worst = largest_deviation(stage, motions)
    return _check_data(worst.size, worst.where, worst.when)


def _keys(bundle: Bundle) -> tuple[Array, Mapping[str, Array]]:
    """Return (times (k,) in s, {link: poses (k, 4, 4)}) of the motion; without motion, only the rest pose at time 0."""
    if bundle.order.scenes:
        scene = bundle.order.scenes[0]  # a robot of a scene plays at most one protocol
        return scene.clip.times, scene.judged
    rest_poses = {}
    for link, T in home_poses(bundle.order.mechanism).items():
        rest_poses[link] = T[None]
    return np.zeros(1), rest_poses


def _check_data(worst: float, where: str, when: str) -> JsonObject:
    """Return a check of the scene's stage as plain data; `worst` is in m, NaN if a link is missing."""
    verdict = "disagree"  # also for NaN, which no comparison accepts
    if worst <= _POSITION_TOLERANCE:
        verdict = "agree"
    return {
        "check": "every link in the world frame, at the first, middle and last key",
        "tool": "pxr",
        "worst": worst if np.isfinite(worst) else None,
        "unit": "m",
        "tolerance": _POSITION_TOLERANCE,
        "verdict": verdict,
        "where": ", ".join(filter(None, (where, when))),
    }


def _finding(check: JsonObject) -> Finding:
    where = check["where"]
    if check["worst"] is None:
        what = f"{where} in the scene's stage is missing or not a number"
        return disagreement("export.scene", where, what, None, None, word="tolerance")
    what = f"displacement of {where} in the scene's stage from the pose in the robot's files"
    return disagreement(
        "export.scene", where, what, Quantity(check["worst"], "m"), _POSITION_TOLERANCE, word="tolerance"
    )


def _readme(scene: Scene, formats: Sequence[str]) -> str:
    names = ", ".join([place.name for place in scene.places])
    lines = [
        scene.title,
        "",
        "One folder for each robot, with its own README.txt and proof.json:",
        f"  {names}.",
        f"Formats: {', '.join(formats)}. Each file contains one robot with its motion, in its base frame, z up, in m.",
        "scene.json   T_world_base of each robot (4 x 4, row by row), and its protocol; all motions start together.",
    ]
    without_protocol = []
    for place in scene.places:
        if not place.protocol:
            without_protocol.append(place.name)
    if without_protocol:
        names = ", ".join(without_protocol)
        lines.append(f"A console controls {names}: no motion; scene.json has the joint values of the start.")
    if scene.objects:
        lines.append("Movable objects: scene.json has their shapes, masses, friction and T_world_object at the start.")
        if "glb" in formats:
            lines.append("objects.glb   the movable objects at the start, in world.")
    if "usd" in formats:
        lines.append(f"usd/{scene.name}.usda   all robots at their base poses with their motions, and the props.")
    if scene.tissues and "glb" in formats:
        lines.append(f"organs.glb   {', '.join(scene.tissues)} with their motion as morph targets, animation `motion`.")
        if "unity" in formats:
            lines.append("  In Unity, the component Deformable Player plays organs.glb after Twin > Import bundle.")
    if scene.tissues and "usd" in formats:
        lines.append("usd/organs.usdc   the organs as time-sampled points; part of the stage with all robots.")
    if "usd" in formats and not _plays(scene):
        lines.append(f"usd/{scene.name}_sim.usda   {scene.name}.usda in a physics scene: open this file to simulate.")
    return "\n".join(lines) + "\n"
