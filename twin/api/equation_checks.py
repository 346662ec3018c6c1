"""Compare the equations of a robot with its mechanism, and find corrections of wrong equations."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import AssemblyError, TwinError, unknown
from twin.core.progress import Progress, silent
from twin.core.units import UM

if TYPE_CHECKING:
    from twin.core.compute_device import Choice
    from twin.planning.link_motion import LinkMotion
    from twin.planning.protocol import Solver
    from twin.planning.trajectory import Trajectory
    from twin.validation.explain.explanation import Explanation
    from twin.validation.range_samples_result import RangeSamples
    from twin.validation.residual_rows import Tolerances
    from twin.validation.result import Report
    from twin.validation.stroke_result import Strokes


def validate(
    robot: Robot | str | Path,
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
        robot: a robot with CAD and equations, its name or its folder.
        trajectory: the planned trajectory; None: `validate` plans it.
        protocol: the protocol of the trajectory; default: the one that a given trajectory names, else the robot's
            default protocol.
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

    Examples:
        >>> import twin
        >>> report = twin.validate("sils", variants={"eq1": "printed"})
        >>> report.verdict
        'disagree'
        >>> report.causes[0].message.startswith("point s1")
        True
    """
    from twin.validation.case import Case
    from twin.validation.judge import judge
    from twin.validation.lengths import check_parameters
    from twin.validation.repeat_commands import commands

    robot = loaded(robot)
    progress("read CAD", 0.0)
    chosen_tolerances = tolerances or _tolerances_of(robot)
    name_or_path = protocol
    if not protocol and trajectory is not None:
        name_or_path = trajectory.protocol
    planned_protocol = robot.protocol(name_or_path)
    # the printed command line cannot set parameters
    commands_possible = not robot.parameters
    robot = robot.bound(planned_protocol)
    kin = None
    if variants is not None or not robot.unwritten:  # an empty template: the report says what is not judged
        kin = robot.kinematics(variants)
        check_parameters(kin, robot.cad.description)
    if trajectory is None:
        trajectory = plan(robot, planned_protocol, progress, timing=timing)
    assert robot.files is not None  # the robot has CAD
    # a given stage is judged as it is; the robot's own is built anew if it is outdated
    if stage is not None:
        opened_stage = contextlib.nullcontext(stage)
    else:
        opened_stage = robot.source.fresh_stage()
    with opened_stage as root:
        case = Case(
            kin,
            robot.cad,
            planned_protocol,
            trajectory,
            root,
            chosen_tolerances,
            paths=robot.path_kinematics(),
            baked_for_it=baked,
            motion=_motion(robot, trajectory),
        )
        report = judge(case, progress)
    if not commands_possible:
        return report
    return replace(report, commands=commands(robot.files, kin, protocol or planned_protocol.name, tolerances))


PLACEMENT_FACTOR = 10
"""Ratio of the accuracy of a CAD to the precision of its placements: errors add up along a chain of parts."""


def _tolerances_of(robot: Robot) -> Tolerances:
    """Return the tolerances of exact geometry, increased by the placement precision of the robot's CAD."""
    from twin.validation.residual_rows import Tolerances

    accuracy = PLACEMENT_FACTOR * robot.cad.placement_loss
    return Tolerances().widened(accuracy, robot.mechanism.link_length)


def _motion(robot: Robot, trajectory: Trajectory) -> LinkMotion | None:
    """Return the motion that drives a stage; None if the loops of the CAD cannot be closed."""
    from twin.planning.trajectory import key_times
    from twin.validation.baked_motion import KEY_RATE

    times = key_times(trajectory.duration, KEY_RATE)
    try:
        return robot.link_motion(trajectory, times)
    except AssemblyError:
        return None


def explain(
    robot: Robot | str | Path,
    variants: Mapping[str, str] | str | None = None,
    *,
    tolerance: float | None = None,
    seconds: float = 8.0,
    prove: bool = False,
    progress: Progress = silent,
) -> Explanation:
    """Find which rows (assignments) of the equations disagree with the mechanism, why, and which edits correct them.

    Args:
        robot: a robot with CAD (or a stage) and equations, its name or its folder.
        variants: variants of the equations to explain; default: the robot's own.
        tolerance: accuracy of the CAD in m; default: ten times the placement precision of the CAD; for a stage,
            the tolerance of positions in a stage.
        seconds: time limit in s of processor time of the search for edits, numbers and conventions.
        prove: whether repairs are proved, as by `prove`; repairs that are proved to be one function are merged.
        progress: see `Progress`.

    Raises:
        TwinError: there are no equations, or the CAD cannot be read.

    Examples:
        >>> import twin
        >>> twin.explain("sils").verdict
        'agree'
    """
    from twin.validation.explain.explain import ExplainOptions
    from twin.validation.explain.explain import explain as explain_
    from twin.validation.explain.row_deviations import Tolerance
    from twin.validation.residual_rows import Tolerances

    if tolerance is not None and not tolerance > 0:
        raise TwinError(f"tolerance {tolerance / UM:g} um: give a positive length")
    robot = loaded(robot)
    formula = robot.formula  # read first, so that errors of the formula are raised before the CAD is read
    progress("read CAD", 0.0)
    cad = None
    if robot.files is not None:
        cad = robot.cad
    if tolerance is None:
        tolerance = Tolerances().stage_position  # a stage has frames in single precision
        if cad is not None:
            tolerance = PLACEMENT_FACTOR * cad.placement_loss
    tolerances = Tolerances().widened(tolerance, robot.mechanism.link_length)
    prover = None
    if prove:
        # Loaded by name: without it, nothing of a proof is reached from here.
        prover = import_module("twin.api.repair_prover").EquationsRepairProver(robot, variants)
    return explain_(
        robot.name,
        formula,
        robot.reference(),
        variants,
        options=ExplainOptions(Tolerance(tolerances.position, tolerances.rotation), seconds, Path.cwd(), prover),
        cad=cad,
        progress=progress,
    )


def validate_samples(
    robot: Robot | str | Path,
    samples: int = 1_000_000,
    *,
    variants: Mapping[str, str] | str | None = None,
    tolerances: Tolerances | None = None,
    device: Choice = "cpu",
    progress: Progress = silent,
) -> RangeSamples:
    """Compare the equations with the mechanism at states all over the joint range, as many as wanted.

    Compiled kernels find the states at which the equations seem to be wrong; the reference model judges them, and some
    of the others. The states are evenly spread, and the same in each call. They are computed in blocks, so that their
    number is not limited by memory.

    Args:
        robot: a robot with CAD and equations, its name or its folder.
        samples: number of states.
        variants: variants of the equations to judge; default: the robot's own.
        tolerances: see `validate`; 10 times these count as agreement, as in every check of the whole range.
        device: what computes the kernels, see `twin.computing_on`.
        progress: see `Progress`.

    Raises:
        TwinError: the robot has no equations, `samples` is below 1, or there is no such device.

    Examples:
        >>> import twin
        >>> twin.validate_samples("davinci_ecm", 20_000).verdict
        'agree'
    """
    from twin.core.compute_device import computing_on
    from twin.validation.lengths import check_parameters
    from twin.validation.range_samples import SampledRange

    if samples < 1:
        raise TwinError(f"samples = {samples}: give at least 1")
    robot = loaded(robot)
    progress("read CAD", 0.0)
    chosen_tolerances = tolerances or _tolerances_of(robot)
    kin = robot.kinematics(variants)
    check_parameters(kin, robot.cad.description)
    passive = None
    if robot.mechanism.limited:  # equations may refuse states that a limit of a passive joint forbids
        passive = robot.passive_check
    judge = SampledRange(robot.name, kin, robot.loops, passive, robot.reference(), chosen_tolerances)
    with computing_on(device):
        return judge.judge(samples, progress)


def strokes(
    robot: Robot | str | Path,
    joints: Sequence[str] = (),
    standins: Sequence[str] = (),
    variants: Mapping[str, str] | None = None,
    progress: Progress = silent,
) -> Strokes:
    """Compare the equations with the mechanism over the whole stroke of each joint, with the other joints at home.

    Args:
        robot: a robot with equations, its name or its folder.
        joints: active joints to sweep; default: all.
        standins: simplified loop models to compare with: "serial", "mimic".
        variants: variants of the equations; default: the robot's own.
        progress: see `Progress`.

    Raises:
        TwinError: there is no such joint or simplified model.

    Examples:
        >>> import twin
        >>> twin.strokes("sher", ["q5"]).verdict
        'agree'
    """
    from twin.validation.stroke import SIMPLIFIED_MODELS, sweep
    from twin.validation.stroke_result import Strokes, ToolRequirement

    robot = loaded(robot)
    for name in standins:
        if name not in SIMPLIFIED_MODELS:
            raise TwinError(f"standins: {unknown('simplified loop model', name, SIMPLIFIED_MODELS)}")
    for name in joints:
        if name not in robot.joints:
            raise TwinError(f"joints: {unknown('active joint', name, robot.joints)}")
    chosen = joints or robot.joints
    progress("read CAD", 0.0)
    kin = robot.kinematics(variants)
    model = robot.reference()
    home = robot.mechanism.home
    if home is None:  # the description has no posture `home`: the rest poses of the CAD
        home = model.home().q
    unique_standins = tuple(dict.fromkeys(standins))  # in the order of the arguments
    sweeps = []
    for i, joint in enumerate(chosen):
        progress(f"sweep {joint}", (i + 0.5) / len(chosen))
        sweeps.append(sweep(kin, model, joint, home, unique_standins))
    required = None
    if robot.files is not None:
        requirement = robot.cad.description.requirement
        if requirement is not None:
            required = ToolRequirement(requirement.tool_um * UM, requirement.provenance, requirement.note)
    return Strokes(robot.name, tuple(sweeps), required)
