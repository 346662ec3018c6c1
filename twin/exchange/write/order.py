"""Content of an export: the mechanism with masses, its clips, and their sources."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from twin.cad.build import inputs
from twin.cad.description import Description
from twin.core.assets import RobotFiles
from twin.core.errors import ProtocolError, TwinError
from twin.core.findings import Finding, warning
from twin.core.foreign.once import Read
from twin.core.progress import Progress
from twin.core.provenance import DRAWING, AssumedCounts, Parameter, count_assumed
from twin.core.spatial import Array
from twin.exchange.write.clip import Clip, ClipAccuracy, make_clip
from twin.kinematics.compile import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import Trajectory

_KINDS = {".toml": "TOML", ".step": "STEP", ".stp": "STEP", ".py": "text"}
"""Format for each suffix of source files whose bytes the robot's reader keeps; bytes of mesh files are not kept."""

Plan = Callable[..., Trajectory]
"""Function (robot, protocol, progress) that returns the planned trajectory."""


Robot = Any
"""A `twin.api.Robot`; this package cannot import the type."""


@dataclass(frozen=True)
class ExportedScene:
    """A clip, and what judges it.

    Attributes:
        clip: the motion to write.
        mechanism: the mechanism with the trocar positions of the clip's protocol.
        judged: {link: T_world_link (k, 4, 4)} at the times of the clip by the reference model, which did not make the
            clip. For the motion of a stage, those of the stage.
    """

    clip: Clip
    mechanism: Mechanism
    judged: Mapping[str, Array]


@dataclass(frozen=True)
class Order:
    """All data for the writers and the README.

    Attributes:
        mechanism: the robot as in the CAD, with masses.
        scenes: for each protocol, a clip and its mechanism.
        quick_looks: names of the clips that are written as .usdz: the first as <robot>_ar.usdz, all others as
            <robot>_<clip>_ar.usdz.
        inputs: (displayed path, sha256) of every source file.
        assumed: "name: reason" for each assumed (unpublished) number of the robot; numbers of protocols are in clips.
        title, source: title and source of the robot.
        findings: findings on the robot.
        equations: the compiled equations; None if there are none.
        gaps: (lower joint, upper joint, minimum distance in m) of joints on one rail.
        numbers: parameters of the robot and of its drawing.
    """

    mechanism: Mechanism
    scenes: tuple[ExportedScene, ...]
    quick_looks: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    title: str
    source: str
    findings: tuple[Finding, ...]
    equations: Kinematics | None = None
    gaps: tuple[tuple[str, str, float], ...] = ()
    numbers: tuple[Parameter, ...] = ()

    @property
    def assumed_counts(self) -> AssumedCounts:
        """Numbers of assumed values, as all pages and commands count them."""
        of_protocols = 0
        for clip in self.clips:
            of_protocols += len(clip.assumed)
        return replace(count_assumed(self.numbers), protocol=of_protocols)

    @property
    def clips(self) -> tuple[Clip, ...]:
        """The clips of all scenes, one for each protocol."""
        return tuple(scene.clip for scene in self.scenes)

    @property
    def elsewhere(self) -> tuple[ExportedScene, ...]:
        """Scenes whose trocar positions differ from the CAD; each of these scenes needs a separate file."""
        return tuple(filter(self._is_elsewhere, self.scenes))

    def _is_elsewhere(self, scene: ExportedScene) -> bool:
        for name, position in self.mechanism.trocar_places.items():
            in_scene = scene.mechanism.trocar_at(name)
            if not np.array_equal(in_scene, position):
                return True
        return False


def order(
    robot: Robot,
    trajectory: Trajectory | None,
    protocols: Sequence[str | Path] | None,
    budget: ClipAccuracy | None,
    plan: Plan,
    progress: Progress,
) -> Order:
    """Return the data to export: compute masses, plan the protocols and choose key rates.

    Args:
        robot: a robot from CAD, or from a USD stage; a stage has no protocols, but may contain a motion.
        trajectory: a planned motion, which is then the only exported motion. Its protocol is the first in `protocols`
            or, without `protocols`, the protocol that the trajectory names. None: plan the protocols.
        protocols: names or paths; None: all protocols of the robot.
        budget: maximum errors of each clip; None: `Budget()`. Not used for a stage: its samples become the keys.
        plan: function that plans a protocol.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: input is missing or invalid, or a protocol cannot be planned.
    """
    if robot.files is None:
        if protocols or trajectory is not None:
            raise TwinError(
                f"{robot.name} was loaded from {robot.source.kind}, which has no protocols; only a motion baked in a "
                "stage is exported: name no protocol"
            )
        if robot.source.described is not None:
            return _of_file(robot, robot.source.described.path, progress)
        return _of_stage(robot, progress)
    progress("read CAD, compute masses", 0.0)
    files = robot.files
    robot = robot.weighed()
    cad = robot.cad
    findings = [finding for finding in cad.findings if finding.severity != "info"]
    chosen, choice_findings = _chosen(robot, trajectory, protocols)
    findings += choice_findings
    loaded = [robot.protocol(name) for name in chosen]
    sources = _sources(files, cad.description, chosen, loaded)  # hash the files first: planning takes time
    # A protocol that the user did not ask for may be one that an imported robot cannot follow.
    optional = protocols is None and robot.unwritten
    scenes: list[ExportedScene] = []
    planned_names: list[str] = []
    for number, protocol in enumerate(loaded):
        progress(f"plan {protocol.name}", number / len(loaded))
        try:
            planned = trajectory
            if planned is None:
                planned = plan(robot, protocol)
        except ProtocolError as error:
            if not optional:
                raise
            text = f"protocol {protocol.name} is left out, because the mechanism cannot follow it: {error}"
            findings.append(warning("export.not_planned", protocol.name, text))
            continue
        progress(f"keys of {protocol.name}", (number + 0.5) / len(loaded))
        scene = _scene(robot.bound(protocol), protocol, planned, budget)
        scenes.append(scene)
        planned_names.append(scene.clip.name)
    numbers = [*cad.mechanism.parameters, *cad.dimensions]
    equations = None
    if files.has_equations:
        equations = robot.kinematics()
        numbers += equations.formula.parameters
    return Order(
        cad.mechanism,
        tuple(scenes),
        _quick_looks(cad.description.default_protocol, planned_names, protocols is not None),
        sources,
        _assumed(numbers),
        cad.description.title,
        cad.description.source,
        tuple(findings),
        equations,
        robot.gaps,
        tuple(numbers),
    )


def _chosen(
    robot: Robot, trajectory: Trajectory | None, protocols: Sequence[str | Path] | None
) -> tuple[list[str | Path], list[Finding]]:
    """Return (names or paths of the exported protocols, findings)."""
    if trajectory is not None:
        first = list(protocols or [trajectory.protocol])[:1]
        return first, []
    if protocols is not None:
        return list(protocols), []
    names = list(robot.files.protocols())
    if robot.files.has_equations or robot.unwritten or not names:
        return names, []
    text = f"{robot.name} has no equations for planning: no motion is exported for {', '.join(names)}"
    return [], [warning("export.no_equations", "", text, suggestion="write formula.py")]


def _scene(robot: Robot, protocol: Any, planned: Trajectory, budget: ClipAccuracy | None) -> ExportedScene:
    """Return the clip of a planned protocol, for a robot with the trocars of the protocol, and what judges it."""
    motion_at = partial(robot.link_motion, planned)
    assumed = _assumed(protocol.parameters())
    clip = make_clip(robot.mechanism, planned, protocol.title, budget, assumed, motion_at)
    model = robot.reference()
    run = robot.link_motion(planned, clip.times).on(model, planned)
    return ExportedScene(clip, robot.mechanism, model.link_poses(run.x))


def _sources(
    files: RobotFiles, description: Description, chosen: Sequence[str | Path], loaded: Sequence[Any]
) -> tuple[tuple[str, str], ...]:
    """Return (displayed path, sha256) of every source file of the robot and its protocols."""
    made_from = inputs(files.description, description)
    for path in (files.cad / "dimensions.toml", files.formula):
        if path.is_file():
            made_from.append(path)
    path_by_name: dict[str, Path] = {}
    for path in made_from:
        path_by_name[_shown(path, files.cad)] = path
    for name, protocol in zip(chosen, loaded, strict=True):
        path = Path(name)
        if path.suffix != ".toml":
            path = files.protocols().get(protocol.name)
        if path is not None:
            path_by_name[f"trajectories/{path.name}"] = path
    sources = []
    for name, path in path_by_name.items():
        sources.append((name, _sha256(path, files.read)))
    return tuple(sources)


def _of_stage(robot: Robot, progress: Progress) -> Order:
    from pxr import Usd

    from twin.exchange.write.stage_clip import sampled_clip

    progress("read stage", 0.0)
    mechanism = robot.mechanism
    stage = Path(mechanism.source)
    clip = sampled_clip(mechanism, stage)
    opened = Usd.Stage.Open(str(stage))  # keep a reference: layers are freed with the stage
    paths: set[Path] = set()
    for layer in opened.GetUsedLayers():
        if layer.realPath:  # empty for a layer that exists only in memory
            paths.add(Path(layer.realPath))
    sources = []
    for path in sorted(paths):
        if path.is_file():
            sources.append((path.name, _sha256(path)))
    scenes: tuple[ExportedScene, ...] = ()
    quick_looks: tuple[str, ...] = ()
    if clip is not None:
        scenes = (ExportedScene(clip, mechanism, clip.links),)
        quick_looks = (clip.name,)
    return Order(
        mechanism,
        scenes,
        quick_looks,
        tuple(sources),
        _assumed(mechanism.parameters),
        mechanism.name,
        stage.name,
        (),
    )


def _of_file(robot: Robot, path: Path, progress: Progress) -> Order:
    """Return the mechanism of a description file, without motion."""
    progress(f"read {path.name}", 0.0)
    mechanism = robot.mechanism
    lines = _assumed(mechanism.parameters)
    sources = ((path.name, _sha256(path)),)
    return Order(mechanism, (), (), sources, lines, mechanism.name, path.name, (), numbers=tuple(mechanism.parameters))


def _quick_looks(default: str, names: list[str], are_requested: bool) -> tuple[str, ...]:
    """Return the names of clips to write as .usdz: the clip of <robot>_ar.usdz, then the clips requested by name."""
    if not names:
        return ()
    first = names[0]
    if default in names:
        first = default
    if not are_requested:
        return (first,)
    others = [name for name in names if name != first]
    return (first, *others)


def _assumed(parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return "name = value: reason" for each assumed parameter; parameters of appearance are only counted."""
    lines = []
    for parameter in parameters:
        if parameter.provenance == "ASSUMED" and not parameter.name.startswith(DRAWING):
            line = f"{parameter.name} = {parameter.shown:g} {parameter.unit}: {parameter.note}"
            lines.append(" ".join(line.split()))
    drawing_count = count_assumed(parameters).drawing
    if drawing_count:
        lines.append(
            f"{DRAWING}*: {drawing_count} lengths that affect only the appearance of parts (`twin info --all` lists "
            "them)"
        )
    return tuple(dict.fromkeys(lines))  # each line once, in this order


def _shown(path: Path, folder: Path) -> str:
    """Return a path as text that is the same on every machine."""
    if path.is_relative_to(folder):
        return f"cad/{path.relative_to(folder).as_posix()}"
    return path.name


def _sha256(path: Path, read: Read | None = None) -> str:
    """Return the sha256 of a file. For TOML, STEP and equations, `read` returns the bytes that made the robot."""
    kind = _KINDS.get(path.suffix.lower(), "")
    if read is not None and kind:
        data = read(path, kind)
    else:
        data = path.read_bytes()
    return hashlib.sha256(data).hexdigest()
