"""Plan the trajectory of a protocol, and check the timing of a plan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.progress import Progress, silent

if TYPE_CHECKING:
    from twin.planning.protocol import Protocol, Solver
    from twin.planning.trajectory import Trajectory
    from twin.validation.checked_plan import CheckedPlan


def plan(
    robot: Robot | str | Path,
    protocol: str | Path | Protocol | None = None,
    progress: Progress = silent,
    *,
    timing: Solver | None = None,
) -> Trajectory:
    """Return the timed trajectory of a protocol, checked at 1 kHz.

    Args:
        robot: a robot with protocols, its name or its folder.
        protocol: name, path, or the protocol itself; default: the robot's default protocol.
        progress: see `Progress`.
        timing: solver of the timing, "passes" or "toppra"; None: the solver that the protocol names.

    Raises:
        ProtocolError: the protocol cannot be carried out; the message names phase, path position and limit.
        TimingError: no timing satisfies the limits.

    Examples:
        >>> import twin
        >>> trajectory = twin.plan("hibou")
        >>> trajectory.q.shape[1] == len(twin.load("hibou").joints)
        True
    """
    from twin.planning.plan import plan as plan_
    from twin.planning.protocol import Protocol

    robot = loaded(robot)
    if not isinstance(protocol, Protocol):
        protocol = robot.protocol(protocol)
    if timing is not None:
        protocol = replace(protocol, timing=robot.with_timing(timing).timing)  # raises for an unknown solver
    # the protocol may place trocars, through which the path must lead
    robot = robot.bound(protocol)
    T_tool_frame = robot.mechanism.frame_in_tool(protocol.frame)

    def start_phase(phase: str) -> None:
        progress(f"plan {phase}", 0.0)

    return plan_(protocol, robot.path_kinematics(), T_tool_frame=T_tool_frame, progress=start_phase)


def check_plan(
    robot: Robot | str | Path, trajectory: Trajectory, protocol: str | Path | Protocol | None = None
) -> CheckedPlan:
    """Judge the timing of a plan by the solver that did not make it; `validate` does the same.

    Args:
        robot: the robot of the plan, its name or its folder; source of the limits of joints and motors.
        trajectory: the plan.
        protocol: the protocol of the plan, source of the limits of the moved frame; default: by the name in the plan.

    Raises:
        TwinError: the protocol does not exist, or its file is malformed.

    Examples:
        >>> import twin
        >>> twin.check_plan("hibou", twin.plan("hibou")).verdict
        'agree'
    """
    from twin.planning.protocol import Protocol
    from twin.validation.checked_plan import CheckedPlan, retimed

    robot = loaded(robot)
    if not isinstance(protocol, Protocol):
        protocol = robot.protocol(protocol or trajectory.protocol)
    rows, facts, findings = retimed(trajectory, robot.mechanism, protocol)
    return CheckedPlan(trajectory, rows, facts, findings)
