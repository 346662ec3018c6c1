"""Audit exported files: against each other, against a robot, and against a new export of it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from twin.api.clip_protocols import protocol_of_clip
from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.progress import Progress, silent
from twin.core.sampling import spread
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.exchange.audit import AuditReport, SampledStates
    from twin.exchange.xacro import XacroSettings
    from twin.model.mechanism import Mechanism

_RANDOM_STATES = 96
"""Number of joint states that are drawn for an audit."""

_COMPARED_STATES = 24
"""Number of the drawn states at which an audit compares a file: all of them would take seconds more."""


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
    run = joint_range(model, _RANDOM_STATES).run
    chosen = spread(len(run.x), _COMPARED_STATES)
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
