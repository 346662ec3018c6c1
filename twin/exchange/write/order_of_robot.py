"""Collect what is exported of a robot: masses, planned protocols with their key rates, and sources."""

from __future__ import annotations

import hashlib
import typing
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path

from twin.cad.build import CadModel, inputs
from twin.cad.description import Description
from twin.core.assets import RobotFiles
from twin.core.errors import ProtocolError, TwinError
from twin.core.findings import Finding, warning
from twin.core.foreign.once import Read
from twin.core.progress import Progress
from twin.core.provenance import DRAWING, Parameter, count_assumed
from twin.core.spatial import Array
from twin.exchange.write.clip import ClipAccuracy
from twin.exchange.write.key_rate import make_clip
from twin.exchange.write.order import ExportedScene, Order
from twin.kinematics.compile import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel

_KEPT_SYNTAXES = {".toml": "TOML", ".step": "STEP", ".stp": "STEP", ".py": "text"}
"""Syntax by suffix of source files whose bytes the robot's reader keeps; bytes of mesh files are not kept."""

Plan = Callable[..., Trajectory]
"""Function (robot, protocol) that returns the planned trajectory."""


class SourceFile(typing.Protocol):
    """A file in a foreign format that describes a robot."""

    @property
    def path(self) -> Path: ...  # noqa: D102


class ExportableSource(typing.Protocol):
    """What a robot was read from: `kind` as text; `described` is None unless it is a file in a foreign format."""

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def described(self) -> SourceFile | None: ...  # noqa: D102


class ExportableRobot(typing.Protocol):
    """What an export uses of a `twin.api.Robot`, whose type this package cannot import; see there for the members."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def source(self) -> ExportableSource: ...  # noqa: D102
    @property
    def files(self) -> RobotFiles | None: ...  # noqa: D102
    @cached_property
    def cad(self) -> CadModel: ...  # noqa: D102
    @cached_property
    def mechanism(self) -> Mechanism: ...  # noqa: D102
    @property
    def gaps(self) -> tuple[tuple[str, str, float], ...]: ...  # noqa: D102
    @property
    def unwritten(self) -> bool: ...  # noqa: D102
    def weighed(self) -> ExportableRobot: ...  # noqa: D102
    def protocol(self, name: str | Path | None = None) -> Protocol: ...  # noqa: D102
    def bound(self, protocol: Protocol) -> ExportableRobot: ...  # noqa: D102
    def kinematics(self) -> Kinematics: ...  # noqa: D102
    def reference(self) -> ReferenceModel: ...  # noqa: D102
    def link_motion(self, trajectory: Trajectory, times: Array) -> LinkMotion: ...  # noqa: D102


def order_of_robot(
    robot: ExportableRobot,
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
        budget: maximum errors of each clip; None: `ClipAccuracy()`. Not used for a stage: its samples become the keys.
        plan: see `Plan`.
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
    weighed = robot.weighed()
    cad = weighed.cad
    findings = [finding for finding in cad.findings if finding.severity != "info"]
    chosen, choice_findings = _chosen_protocols(weighed, files, trajectory, protocols)
    findings += choice_findings
    loaded = [weighed.protocol(name) for name in chosen]
    sources = _sources(files, cad.description, chosen, loaded)  # hash the files first: planning takes time
    # A protocol that the user did not ask for may be one that an imported robot cannot follow.
    may_leave_out = protocols is None and weighed.unwritten
    scenes: list[ExportedScene] = []
    for number, protocol in enumerate(loaded):
        progress(f"plan {protocol.name}", number / len(loaded))
        planned = trajectory
        try:
            if planned is None:
                planned = plan(weighed, protocol)
        except ProtocolError as error:
            if not may_leave_out:
                raise
            text = f"protocol {protocol.name} is left out, because the mechanism cannot follow it: {error}"
            findings.append(warning("export.not_planned", protocol.name, text))
            continue
        progress(f"keys of {protocol.name}", (number + 0.5) / len(loaded))
        scenes.append(_scene(weighed.bound(protocol), protocol, planned, budget))
    parameters = [*cad.mechanism.parameters, *cad.dimensions]
    equations = None
    if files.has_equations:
        equations = weighed.kinematics()
        parameters += equations.formula.parameters
    planned_names = [scene.clip.name for scene in scenes]
    return Order(
        cad.mechanism,
        tuple(scenes),
        _quick_looks(cad.description.default_protocol, planned_names, protocols is not None),
        sources,
        _assumed(parameters),
        cad.description.title,
        cad.description.source,
        tuple(findings),
        equations,
        weighed.gaps,
        tuple(parameters),
    )


def _chosen_protocols(
    robot: ExportableRobot, files: RobotFiles, trajectory: Trajectory | None, protocols: Sequence[str | Path] | None
) -> tuple[list[str | Path], list[Finding]]:
    """Return (names or paths of the exported protocols, findings)."""
    if trajectory is not None:
        first = list(protocols or [trajectory.protocol])[:1]
        return first, []
    if protocols is not None:
        return list(protocols), []
    names: list[str | Path] = list(files.protocols())
    if files.has_equations or robot.unwritten or not names:
        return names, []
    text = f"{robot.name} has no equations for planning: no motion is exported for {', '.join(map(str, names))}"
    return [], [warning("export.no_equations", "", text, suggestion="write formula.py")]


def _scene(
    robot: ExportableRobot, protocol: Protocol, planned: Trajectory, budget: ClipAccuracy | None
) -> ExportedScene:
    """Return the clip of a planned protocol, for a robot with the trocars of the protocol, and what judges it."""
    motion_at = partial(robot.link_motion, planned)
    assumed = _assumed(protocol.parameters())
    clip = make_clip(robot.mechanism, planned, protocol.title, budget, assumed, motion_at)
    model = robot.reference()
    solved = robot.link_motion(planned, clip.times).on(model, planned)
    return ExportedScene(clip, robot.mechanism, model.link_poses(solved.x))


def _sources(
    files: RobotFiles, description: Description, chosen: Sequence[str | Path], loaded: Sequence[Protocol]
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


def _of_stage(robot: ExportableRobot, progress: Progress) -> Order:
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


def _of_file(robot: ExportableRobot, path: Path, progress: Progress) -> Order:
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
    syntax = _KEPT_SYNTAXES.get(path.suffix.lower(), "")
    if read is not None and syntax:
        data = read(path, syntax)
    else:
        data = path.read_bytes()
    return hashlib.sha256(data).hexdigest()
