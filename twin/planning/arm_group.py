"""Timing and check of several robots that follow given joint paths; all robots begin and end each phase together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import AssemblyError, ProtocolError, TimingError
from twin.core.spatial import Array
from twin.planning.check import check
from twin.planning.demands import demands, timed
from twin.planning.feasible import require_feasible
from twin.planning.mechanism_path import MechanismFollower
from twin.planning.path import Path
from twin.planning.phase_path import PhasePath, build
from twin.planning.plan import Leg, assemble, sampled
from twin.planning.protocol import Free, Protocol
from twin.planning.smooth import line
from twin.planning.trajectory import Carrier, PathKinematics, Trajectory

_STATIONS = 33
"""Number of points of a straight path between two waypoints."""

_DT = 1e-3
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
    def carrier(self) -> Carrier:
        """The robot's mechanism; raises `ProtocolError` if the robot has none."""
        if self.kinematics.carrier is None:
            raise ProtocolError(
                f"{self.name} has no mechanism; several arms can be planned at once only if each has a mechanism"
            )
        return self.kinematics.carrier


class _Guide(MechanismFollower):
    """Moves the mechanism along the given paths."""

    def __init__(self, robot: GroupArm, courses: Sequence[Path]) -> None:
        super().__init__(robot.protocol, robot.kinematics, robot.carrier)
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
    paths = [build(r.protocol, r.T_tool_frame, _Guide(r, c)) for r, c in zip(robots, courses, strict=True)]
    legs: list[list[Leg]] = [[] for _ in robots]
    for phase in range(max(map(len, paths))):
        here = [(k, r, p[phase]) for k, (r, p) in enumerate(zip(robots, paths, strict=True)) if phase < len(p)]
        where = " / ".join(f"{r.name}: phase '{path.phase.name}'" for _, r, path in here)
        for _, r, path in here:
            require_feasible(path, r.kinematics, r.protocol.frame, r.protocol.name)
        joints = [path.driven(r.kinematics, where) for _, r, path in here]
        try:
            timing = timed(
                [demands(path, q, r.protocol, r.kinematics, _DT) for (_, r, path), q in zip(here, joints, strict=True)],
                _DT,
                robots[0].protocol.timing,
            )
        except TimingError as error:
            raise TimingError(f"{where}: {error}") from error
        for (k, r, path), q in zip(here, joints, strict=True):
            legs[k].append(sampled(path, q, timing, r.kinematics))
    out = []
    for r, own in zip(robots, legs, strict=True):
        made = replace(assemble(r.protocol, r.kinematics, r.T_tool_frame, own, _DT), followed=True)
        out.append(replace(made, findings=(*r.protocol.findings, *check(made, r.protocol, r.kinematics))))
    return out


def stops(robot: GroupArm) -> tuple[Array, Array]:
    """Return (q (k, n), T_base_tool (k, 4, 4)) at the start and at each phase's end, reached on straight joint paths.

    Raises:
        ProtocolError: a waypoint has no joint values, or the loops open on the straight path to a waypoint.
    """
    protocol, guide = robot.protocol, MechanismFollower(robot.protocol, robot.kinematics, robot.carrier)
    state, here = robot.carrier.drawn()
    q, Ts = [], []
    for name in (protocol.start, *(p.to for p in protocol.phases if isinstance(p, Free))):
        where = f"{protocol.name}: waypoint '{name}'"
        if protocol.waypoints[name].joints is None:
            raise ProtocolError(
                f"{where} is a pose; to plan several arms at once, give joint values: joints = {{ ... }}"
            )
        goal = guide.goal(name)
        try:
            states, reached = robot.carrier.carry(line(here, goal)(np.linspace(0.0, 1.0, _STATIONS)), state)
        except AssemblyError as error:
            raise ProtocolError(f"{where} cannot be reached on a straight path: {error}") from error
        state, here = states[-1], goal
        q.append(goal)
        Ts.append(reached[-1])
    return np.array(q), np.array(Ts)
