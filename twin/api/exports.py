"""Write a robot's USD stage, export a robot with its motions, and audit exported files."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from twin.api.protocol_plan import plan
from twin.api.robot import Progress, Robot, silent
from twin.api.robot_loading import loaded, names
from twin.core import assets
from twin.core.errors import ProtocolError, TwinError
from twin.core.sampling import spread
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.exchange.audit import AuditReport, SampledStates
    from twin.exchange.write.bundle import Bundle
    from twin.exchange.write.clip import ClipAccuracy
    from twin.exchange.xacro import XacroSettings
    from twin.model.mechanism import Mechanism
    from twin.planning.trajectory import Trajectory

_DRAWN = 96
"""Number of joint states that are drawn for an audit."""

_COMPARED = 24
"""Number of the drawn states at which an audit compares a file: all of them would take seconds more."""


def build(
    robot: Robot | str | Path,
    out: str | Path | None = None,
    *,
    protocols: tuple[str, ...] | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Write the robot's USD stage: meshes, masses, joints, and one baked motion for each protocol.

    Args:
        robot: a robot with CAD, its name or its folder. If it has no equations yet, motions that the mechanism cannot
            follow are skipped.
        out: folder to write; default: usd/<robot>/ in a checkout, usd/ in the folder of a user's robot.
        protocols: protocols whose motions are baked; default: all.
        progress: see `Progress`.

    Returns:
        The files written, root layer first.

    Raises:
        TwinError: the robot was loaded from a stage, or cannot be built; or `out` is None for a built-in robot of an
            installed package, whose data are read-only.
        OutputError: the folder cannot be written; it stays unchanged.

    Examples:
        >>> import twin
        >>> files = twin.build("hibou", out="stage", protocols=())
        >>> files[0].name
        'hibou.usda'
    """
    from twin.exchange.formats.usd.write import bake, baked_times, write_usd

    robot = loaded(robot)
    if robot.files is None:
        raise TwinError(f"{robot.name} was loaded from {robot.source.kind}: there is no CAD to build from")
    if out is None:
        if not assets.is_checkout() and robot.name in names():
            raise TwinError("the installed data is read-only: choose a folder with --out")
        folder = robot.files.usd
    else:
        folder = Path(out)
    progress("read CAD, compute masses", 0.0)
    robot = robot.weighed()  # a stage states masses, for physics engines
    assert robot.files is not None
    chosen = protocols or ()
    if protocols is None and (robot.files.has_equations or robot.unwritten):
        chosen = tuple(robot.files.protocols())
    with assets.atomic_folder(folder) as work:
        root = write_usd(robot.mechanism, (), work)[0]
        for i, name in enumerate(chosen):
            progress(f"bake {name}", i / len(chosen))
            try:
                bound = robot.bound(robot.protocol(name))
                trajectory = plan(robot, name)
            except ProtocolError:
                if protocols is None and robot.unwritten:  # `twin plan` shows the reason
                    continue
                raise
            motion = bound.link_motion(trajectory, baked_times(trajectory))
            bake(robot.mechanism, bound.mechanism, trajectory.protocol, motion, work)
        first = root.relative_to(work)
        other_files = []
        for path in work.rglob("*"):
            if path.is_file() and path != root:
                other_files.append(path.relative_to(work))
    # the files have moved from the temporary folder into `folder`
    return [folder / name for name in (first, *sorted(other_files))]


def export(
    robot: Robot | str | Path,
    trajectory: Trajectory | None = None,
    out: str | Path | None = None,
    to: str | Sequence[str] | None = None,
    *,
    protocols: Sequence[str | Path] | None = None,
    budget: ClipAccuracy | None = None,
    progress: Progress = silent,
) -> Bundle:
    """Write the robot with its motions for headsets, engines and simulators, and audit the written files.

    Args:
        robot: a robot with CAD, its name or its folder; or a USD stage (with the motion baked in the stage, if any); or
            a description file, which is exported without motion.
        trajectory: a planned trajectory as the only motion; None: the motions of the protocols.
        out: folder to write; default: ./twin-out/<robot>/export/.
        to: names of formats, as ["glb", "tracks"] or "glb,tracks"; default: all that `twin export --help` lists.
        protocols: names or paths; default: every protocol of the robot.
        budget: maximum interpolation errors between keys; the key rate is chosen accordingly.
        progress: see `Progress`.

    Raises:
        TwinError: an input is missing or malformed; the folder stays unchanged.

    Examples:
        >>> import twin
        >>> bundle = twin.export("hibou", to="glb", out="export", protocols=())
        >>> bundle.verdict
        'agree'
    """
    from twin.exchange.audit import audit
    from twin.exchange.write.bundle import chosen_formats, write_bundle
    from twin.exchange.write.order import order

    if isinstance(trajectory, (str, Path)):
        raise TwinError(f"'{trajectory}' is not a trajectory: write out='{trajectory}' for a folder")
    if isinstance(to, str):
        to = [name.strip() for name in to.split(",") if name.strip()]
    kinds = chosen_formats(to)
    robot = loaded(robot)
    folder = Path(out or Path("twin-out") / robot.name / "export")
    assets.require_writable(folder)  # before planning, which can take minutes
    ordered = order(robot, trajectory, protocols, budget, plan, progress)
    return write_bundle(ordered, folder, kinds, audit, progress)


def audit(
    path: str | Path,
    robot: Robot | str | Path | None = None,
    progress: Progress = silent,
    xacro: XacroSettings | None = None,
) -> AuditReport:
    """Compare exported files of a moving robot with each other; the readers share no code with the writers.

    Args:
        path: a folder, an exported scene, a file of a format that `twin.exchange.formats.audited` returns, or the
            certificate of a proof.
        robot: if given, each clip is also compared with this robot's poses in the protocol of the same name, files
            without motion with its poses at joint states drawn from its whole range, and links, joints and masses with
            its mechanism.
        progress: see `Progress`.
        xacro: arguments and package folders for the xacros among the files.

    Raises:
        TwinError: the file does not exist, or there are clips, but none has the name of a protocol of the robot.

    Examples:
        >>> import twin
        >>> _ = twin.export("hibou", to="glb,urdf", out="hibou", protocols=())
        >>> twin.audit("hibou", "hibou").verdict
        'agree'
    """
    from twin.api.reference_export import ReferenceExport
    from twin.exchange.audit import SCENE
    from twin.exchange.audit import audit as audit_
    from twin.exchange.audit.certificate import is_certificate

    def states() -> SampledStates:
        progress("draw joint states", 0.0)
        assert expected is not None
        return _states(expected)

    path = Path(path)
    if is_certificate(path):
        return _audited_certificate(path, robot, progress)
    if robot is not None and (path / SCENE).is_file():
        raise TwinError(
            f"{path} is an exported scene: omit the robot, or give the folder of one of the scene's robots instead"
        )
    truth: dict[str, tuple[Array, dict[str, Array]]] = {}
    expected: Mechanism | None = None
    if robot is not None:
        robot = loaded(robot)
        expected = robot.weighed().mechanism  # exported files have masses, which are compared too
        truth = _truth(robot, path, progress, xacro)
    with TemporaryDirectory() as folder:
        return audit_(
            path,
            truth=truth,
            mechanism=expected,
            states=None if expected is None else states,
            reference=ReferenceExport(path, robot, Path(folder), progress),
            progress=progress,
            xacro=xacro,
        )


def _audited_certificate(path: Path, robot: Robot | str | Path | None, progress: Progress) -> AuditReport:
    """Check the certificate of a proof; with a robot, its files must be those that were proved."""
    from twin.exchange.audit.certificate import audit_certificate

    if robot is None:
        return audit_certificate(path)
    robot = loaded(robot)
    # Loaded by name: only a certificate with bounds along protocols needs planning.
    samples = import_module("twin.api.audited_motions").SampledMotions(robot, progress)
    return audit_certificate(path, robot.hashes(), samples)


def _states(mechanism: Mechanism) -> SampledStates:
    """Return states of a mechanism, spread over the range of its driven joints."""
    from twin.exchange.audit import SampledStates
    from twin.reference import ReferenceModel
    from twin.reference.joint_range import joint_range

    model = ReferenceModel(mechanism)
    run = joint_range(model, _DRAWN).run
    chosen = spread(len(run.x), _COMPARED)
    joints: dict[str, Array] = {}
    for i, joint in enumerate(mechanism.active):
        joints[joint.name] = run.q[chosen, i]
    for name, q in run.q_passive.items():
        # `SampledStates` has only joints with one coordinate
        if mechanism.joint(name).type in ("revolute", "prismatic"):
            joints[name] = q[chosen]
    return SampledStates(joints, model.link_poses(run.x[chosen]))


def _truth(
    robot: Robot, path: Path, progress: Progress, xacro: XacroSettings | None
) -> dict[str, tuple[Array, dict[str, Array]]]:
    """Return {protocol: (key times (k,) in s, {link: poses (k, 4, 4)})}, computed by the reference model.

    The result is empty if the files have no clips, like a URDF.
    """
    from twin.api.reference_export import protocol_of_clip
    from twin.exchange.audit import key_times
    from twin.reference import ReferenceModel

    progress("read key times", 0.0)
    clips = key_times(path, xacro)
    if not clips:
        return {}
    if robot.files is None:
        raise TwinError(f"{robot.name}: {robot.source.kind} has no protocols; give a robot by name, or its folder")
    protocol_names = robot.files.protocols()
    poses: dict[str, tuple[Array, dict[str, Array]]] = {}
    for clip, times in clips.items():
        name = protocol_of_clip(clip, list(protocol_names))
        if name is None:
            continue
        protocol = robot.protocol(name)
        trajectory = plan(robot, protocol, progress)
        inside = np.clip(times, 0.0, trajectory.duration)  # the time of the last key is rounded
        model = ReferenceModel(robot.bound(protocol).mechanism)
        run = trajectory.on(model, inside)
        poses[protocol.name] = (times, model.link_poses(run.x))
    if not poses:
        names_of_protocols = ", ".join(protocol_names) or "none"
        raise TwinError(f"{robot.name}: no clip has the name of a protocol of the robot ({names_of_protocols})")
    return poses
