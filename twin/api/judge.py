"""Plan protocols, validate robots along them, and find corrections of wrong equations."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Progress, Robot, silent
from twin.core.errors import AssemblyError, TwinError, unknown
from twin.core.units import UM

if TYPE_CHECKING:
    from twin.planning.link_motion import LinkMotion
    from twin.planning.protocol import Protocol, Solver
    from twin.planning.trajectory import Trajectory
    from twin.validation.explain.result import Explanation
    from twin.validation.result import Report
    from twin.validation.retimed import CheckedPlan
    from twin.validation.rows import Tolerances
    from twin.validation.sweep import Strokes


def plan(
    robot: Robot,
    protocol: str | Path | Protocol | None = None,
    progress: Progress = silent,
    *,
    timing: Solver | None = None,
) -> Trajectory:
    """Return the timed trajectory of a protocol, checked at 1 kHz.

    Args:
        robot: a robot with protocols.
        protocol: name, path, or the protocol itself; default: the robot's default protocol.
        progress: see `Progress`.
        timing: solver of the timing, "passes" or "toppra"; None: the solver that the protocol names.

    Raises:
        ProtocolError: the protocol cannot be carried out; the message names phase, path position and limit.
        TimingError: no timing satisfies the limits.
    """
    from twin.planning.plan import plan as plan_
    from twin.planning.protocol import Protocol

    chosen = protocol if isinstance(protocol, Protocol) else robot.protocol(protocol)
    if timing is not None:
        chosen = replace(chosen, timing=robot.with_timing(timing).timing)
    robot = robot.bound(chosen)
    T = robot.mechanism.frame_in_tool(chosen.frame)
    return plan_(chosen, robot.path_kinematics(), T_tool_frame=T, progress=lambda phase: progress(f"plan {phase}", 0.0))


def check_plan(robot: Robot, trajectory: Trajectory, protocol: str | Path | Protocol | None = None) -> CheckedPlan:
    """Judge the timing of a plan by the solver that did not make it; `validate` does the same.

    Args:
        robot: the robot of the plan, source of the limits of joints and motors.
        trajectory: the plan.
        protocol: the protocol of the plan, source of the limits of the moved frame; default: by the name in the plan.

    Raises:
        TwinError: the protocol does not exist, or its file is malformed.
    """
    from twin.planning.protocol import Protocol
    from twin.validation.retimed import CheckedPlan, retimed

    chosen = protocol if isinstance(protocol, Protocol) else robot.protocol(protocol or trajectory.protocol)
    mechanism = robot.mechanism
    rows, facts, findings = retimed(trajectory, mechanism, chosen)
    return CheckedPlan(trajectory, [j.is_angle for j in mechanism.active], rows, facts, findings)


def validate(
    robot: Robot,
    trajectory: Trajectory | None = None,
    *,
    protocol: str | Path | None = None,
    variants: Mapping[str, str] | str | None = None,
    tolerances: Tolerances | None = None,
    stage: Path | None = None,
    baked: bool = False,
    timing: Solver | None = None,
    progress: Progress = silent,
) -> Report:
    """Compare the equations with the mechanism along a protocol, and the mechanism with its USD stage.

    Args:
        robot: a robot with CAD and equations.
        trajectory: the planned trajectory; None: `validate` plans it.
        protocol: the protocol of the trajectory; default: the robot's default protocol.
        variants: variants of the equations to judge; the motion is always planned with the robot's own variants.
        tolerances: maximum deviations; default: tolerances of exact geometry, increased by the placement precision of
            the CAD.
        stage: root layer to judge; default: the robot's own stage, or a new build if this stage is missing or outdated.
        timing: solver of the timing if `validate` plans; None: the solver that the protocol names. The timing is judged
            by the other solver.
        baked: whether the motion in `stage` was baked from `trajectory`; if False, differences are only warnings.
        progress: see `Progress`.

    Raises:
        TwinError: nothing could be judged, because an input is missing or malformed.
    """
    from twin.validation.case import Case
    from twin.validation.commands import commands
    from twin.validation.judge import judge
    from twin.validation.lengths import check_parameters
    from twin.validation.rows import Tolerances

    progress("read CAD", 0.0)
    used = tolerances or Tolerances().widened(10 * robot.cad.placement_loss, robot.mechanism.link_length)
    chosen = robot.protocol(protocol or (trajectory.protocol if trajectory is not None else None))
    said = None if robot.parameters else protocol or chosen.name  # the printed command line cannot set parameters
    robot = robot.bound(chosen)
    kin = robot.kinematics(variants) if variants is not None or not robot.unwritten else None
    if kin is not None:
        check_parameters(kin, robot.cad.description)
    if trajectory is None:
        trajectory = plan(robot, chosen, progress, timing=timing)
    assert robot.files is not None  # the robot has CAD
    with contextlib.nullcontext(stage) if stage is not None else robot.source.fresh_stage() as root:
        sides = (kin, robot.cad, chosen, trajectory, root, used)
        report = judge(Case(*sides, robot.path_kinematics(), baked, _motion(robot, trajectory)), progress)
    return report if said is None else replace(report, commands=commands(robot.files, kin, said, tolerances))


def _motion(robot: Robot, trajectory: Trajectory) -> LinkMotion | None:
    """Return the motion that drives a stage; None if the loops of the CAD cannot be closed."""
    from twin.planning.trajectory import key_times
    from twin.validation.motion import KEY_RATE

    try:
        return robot.link_motion(trajectory, key_times(trajectory.duration, KEY_RATE))
    except AssemblyError:
        return None


def explain(
    robot: Robot,
    variants: Mapping[str, str] | str | None = None,
    *,
    tolerance: float | None = None,
    seconds: float = 8.0,
    progress: Progress = silent,
) -> Explanation:
    """Find which rows (assignments) of the equations disagree with the mechanism, why, and which edits correct them.

    Args:
        robot: a robot with CAD (or a stage) and equations.
        variants: variants of the equations to explain; default: the robot's own.
        tolerance: accuracy of the CAD in m; default: ten times the placement precision of the CAD.
        seconds: time limit in s of processor time of the search for edits, numbers and conventions.
        progress: see `Progress`.

    Raises:
        TwinError: there are no equations, or the CAD cannot be read.
    """
    from twin.validation.explain.explain import explain as explain_
    from twin.validation.explain.judge import Tolerance
    from twin.validation.rows import Tolerances

    if tolerance is not None and not tolerance > 0:
        raise TwinError(f"tolerance {tolerance / UM:g} um: give a positive length")
    formula = robot.formula  # read first, so that errors of the formula are raised before the CAD is read
    progress("read CAD", 0.0)
    error = tolerance if tolerance is not None else 10 * robot.cad.placement_loss
    used = Tolerances().widened(error, robot.mechanism.link_length)
    return explain_(
        robot.name,
        formula,
        robot.reference(),
        variants,
        tolerance=Tolerance(used.position, used.rotation),
        progress=progress,
        budget=seconds,
        root=Path.cwd(),
        cad=robot.cad if robot.files is not None else None,
    )


def strokes(
    robot: Robot,
    joints: Sequence[str] = (),
    standins: Sequence[str] = (),
    variants: Mapping[str, str] | None = None,
    progress: Progress = silent,
) -> Strokes:
    """Compare the equations with the mechanism over the whole stroke of each joint, with the other joints at home.

    Args:
        robot: a robot with equations.
        joints: active joints to sweep; default: all.
        standins: simplified loop models to compare with: "serial", "mimic".
        variants: variants of the equations; default: the robot's own.
        progress: see `Progress`.

    Raises:
        TwinError: there is no such joint or simplified model.
    """
    from twin.validation.sweep import STANDINS, Strokes, sweep

    for name in standins:
        if name not in STANDINS:
            raise TwinError(f"--compare: {unknown('simplified loop model', name, STANDINS)}")
    for name in joints:
        if name not in robot.joints:
            raise TwinError(f"--sweep: {unknown('active joint', name, robot.joints)}")
    chosen = joints or robot.joints
    progress("read CAD", 0.0)
    kin, model = robot.kinematics(variants), robot.reference()
    home = model.home().q if robot.mechanism.home is None else robot.mechanism.home
    found = []
    for i, joint in enumerate(chosen):
        progress(f"sweep {joint}", (i + 0.5) / len(chosen))
        found.append(sweep(kin, model, joint, home, tuple(dict.fromkeys(standins))))
    need = robot.cad.description.requirement if robot.files is not None else None
    required = (need.tool_um * UM, need.provenance, need.note) if need else None
    return Strokes(robot.name, tuple(found), required)
