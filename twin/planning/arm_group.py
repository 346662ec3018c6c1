"""Timing and check of several robots that follow given joint paths; all robots begin and end each phase together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import AssemblyError, ProtocolError, TimingError
from twin.core.spatial import Array
from twin.planning.check import check
from twin.planning.demands import demands, timed
from twin.planning.feasibility import require_feasible
from twin.planning.mechanism_follower import MechanismFollower
from twin.planning.path import Path, line
from twin.planning.path_kinematics import MovableMechanism, PathKinematics
from twin.planning.phase_path import PhasePath, build
from twin.planning.plan import PlannedPhase, assemble, sampled
from twin.planning.protocol import Free, Protocol
from twin.planning.trajectory import Trajectory

_STATIONS = 33
"""Number of points of a straight path between two waypoints."""

_SAMPLING_TIME = 1e-3
"""Sampling time of a trajectory in s."""


@dataclass(frozen=True)
class GroupArm:
    """A robot that follows given joint paths.

    Attributes:
        name: name for messages.
        protocol: its protocol; joint values define every phase.
        kinematics: its planning data.
        T_tool_frame: (4, 4) pose of `protocol.frame` in the tool frame.
    """

    name: str
    protocol: Protocol
    kinematics: PathKinematics
    T_tool_frame: Array

    @property
    def mechanism(self) -> MovableMechanism:
        """The robot's mechanism; raises `ProtocolError` if the robot has none."""
        if self.kinematics.mechanism is None:
            raise ProtocolError(
                f"{self.name} has no mechanism; several arms can be planned at once only if each has a mechanism"
            )
        return self.kinematics.mechanism


class _CourseFollower(MechanismFollower):
    """Moves the mechanism along the given paths."""

    def __init__(self, robot: GroupArm, courses: Sequence[Path]) -> None:
        super().__init__(robot.protocol, robot.kinematics, robot.mechanism)
        self._courses = iter(courses)

    def _course(self, path: PhasePath, where: str) -> Path:
        return next(self._courses)


def trajectories(robots: Sequence[GroupArm], courses: Sequence[Sequence[Path]]) -> list[Trajectory]:
    """Return the timed trajectory of each robot, with the findings of the check of every sample.

    All robots have the same timing in a phase, by the solver that the first protocol names. This timing is the fastest
    within the limits (jerk included) of the joints, motors and moved frames of all robots. A robot with fewer phases
    has a shorter trajectory.

    Args:
        robots: the robots.
        courses: paths of the driven joints (n,) of each robot, one for each phase of its protocol.

    Raises:
        ProtocolError: a robot cannot follow its path; the message names the phase, the cause, and where in the phase.
        TimingError: no timing within the limits was found; the message names the phases.
    """
    paths = []
    for robot, courses_of_robot in zip(robots, courses, strict=True):
        paths.append(build(robot.protocol, robot.T_tool_frame, _CourseFollower(robot, courses_of_robot)))
    planned: list[list[PlannedPhase]] = [[] for _ in robots]
    for number in range(max(map(len, paths))):
        moving: list[tuple[int, PhasePath]] = []  # the arms that have this phase: (index, phase)
        names = []
        for arm, phases_of_arm in enumerate(paths):
            if number < len(phases_of_arm):
                path = phases_of_arm[number]
                moving.append((arm, path))
                names.append(f"{robots[arm].name}: phase '{path.phase.name}'")
        where = " / ".join(names)
        # all arms before any joint path: the message about an infeasible phase names its cause
        for arm, path in moving:
            protocol = robots[arm].protocol
            require_feasible(path, robots[arm].kinematics, protocol.frame, protocol.name)
        joints = {}
        for arm, path in moving:
            joints[arm] = path.driven(robots[arm].kinematics, where)
        try:
            limits = []
            for arm, path in moving:
                limits.append(demands(path, joints[arm], robots[arm].protocol, robots[arm].kinematics, _SAMPLING_TIME))
            timing = timed(limits, _SAMPLING_TIME, robots[0].protocol.timing)
        except TimingError as error:
            raise TimingError(f"{where}: {error}") from error
        for arm, path in moving:
            planned[arm].append(sampled(path, joints[arm], timing, robots[arm].kinematics))
    trajectories_of_arms = []
    for robot, planned_of_robot in zip(robots, planned, strict=True):
        protocol = robot.protocol
        trajectory = assemble(protocol, robot.kinematics, robot.T_tool_frame, planned_of_robot, _SAMPLING_TIME)
        trajectory = replace(trajectory, followed=True)
        findings = check(trajectory, protocol, robot.kinematics)
        trajectories_of_arms.append(replace(trajectory, findings=(*protocol.findings, *findings)))
    return trajectories_of_arms


def stops(robot: GroupArm) -> tuple[Array, Array]:
    """Return (q (k, n), T_base_tool (k, 4, 4)) at the start and at each phase's end, reached on straight joint paths.

    Raises:
        ProtocolError: a waypoint has no joint values, or the loops open on the straight path to a waypoint.
    """
    protocol = robot.protocol
    follower = MechanismFollower(protocol, robot.kinematics, robot.mechanism)
    state, current = robot.mechanism.drawn()
    q = []
    Ts = []
    names = [protocol.start]
    for phase in protocol.phases:
        if isinstance(phase, Free):
            names.append(phase.to)
    for name in names:
        where = f"{protocol.name}: waypoint '{name}'"
        if protocol.waypoints[name].joints is None:
            raise ProtocolError(
                f"{where} is a pose; to plan several arms at once, give joint values: joints = {{ ... }}"
            )
        goal = follower.goal(name)
        straight = line(current, goal)(np.linspace(0.0, 1.0, _STATIONS))
        try:
            states, reached = robot.mechanism.carry(straight, state)
        except AssemblyError as error:
            raise ProtocolError(f"{where} cannot be reached on a straight path: {error}") from error
        state = states[-1]
        current = goal
        q.append(goal)
        Ts.append(reached[-1])
    return np.array(q), np.array(Ts)
