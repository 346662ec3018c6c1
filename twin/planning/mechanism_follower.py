"""Move a mechanism through a protocol whose path it determines: along its driven joints, or in controlled directions.

A robot with fewer than six degrees of freedom cannot reach every pose, and cannot follow every straight line between
two poses. Therefore the number of controlled directions equals the number of degrees of freedom, and positions have
priority over rotations; the other directions follow from the mechanism. At a waypoint with a pose, the tool must have
this pose in every direction that the protocol does not declare free; otherwise the waypoint is unreachable and the
protocol is wrong.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, ProtocolError
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.planning.free_phase import PhaseProgress, Searched, free_path
from twin.planning.mechanism_path import NO_MOTION, STATIONS, carried, followed, joint_values_after, with_joint_values
from twin.planning.path import Path, line
from twin.planning.path_kinematics import MovableMechanism, PathKinematics
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import DIRECTIONS, Auxiliary, Free, Protocol, Samples
from twin.planning.protocol.course import angles_of, rotation
from twin.planning.sampled_phase import sampled_phase

_RADIAN_LENGTH = 0.1
"""Length in m that is equivalent to 1 rad in comparisons of directions."""

_LEAST_SINGULAR_VALUE = 1e-3
"""Minimum relative singular value of independent directions.

This value is the smallest singular value of the directions' Jacobian, divided by the largest row norm of the whole one.
"""

_SUGGESTED_STEP = {"mm": 10, "deg": 5}
"""{unit: change of a joint value that a message suggests}."""


class MechanismFollower:
    """Moves the mechanism through a protocol phase by phase; each phase starts at the end of the previous one.

    Attributes:
        q: (n,) current values of the driven joints in m or rad.
    """

    def __init__(
        self,
        protocol: Protocol,
        kinematics: PathKinematics,
        mechanism: MovableMechanism,
        progress: PhaseProgress = lambda label: None,
        searched: Searched = lambda name, rounds: None,
    ) -> None:
        self._protocol = protocol
        self._kinematics = kinematics
        self._mechanism = mechanism
        self._progress = progress
        self._searched = searched
        self._names = kinematics.joint_names
        self._revolute = kinematics.revolute
        if not self._names:
            raise ProtocolError(
                f"{protocol.name}: no joint of the robot is driven, so the robot cannot move: name its joints in its "
                "description, and mark the driven ones with active = true"
            )
        self._state, self.q = mechanism.drawn()
        self._q_drawn = self.q

    def start(self, T_tool_frame: Array) -> tuple[Array, Array]:
        """Move to the start waypoint; return angles (3,) in rad and position (3,) in m of the moved frame there.

        Raises:
            ProtocolError: the mechanism cannot reach the start waypoint.
        """
        name = self._protocol.start
        waypoint = self._protocol.waypoints[name]
        lever = T_tool_frame[:3, 3]
        try:
            if waypoint.joints is not None:
                s = np.linspace(0.0, 1.0, STATIONS)[:, None]
                q = self.q + s * (self.goal(name) - self.q)
                states, Ts = self._mechanism.carry(q, self._state)
            else:
                assert waypoint.position is not None
                R = rotation(waypoint.angles, self._protocol.rotation)
                goal = spatial.pose(R, waypoint.position - R @ lever)
                directions = self._directions(lever)
                states, q, Ts = self._mechanism.follow(goal[None], directions, lever, self._state)
                self._require_waypoint(name, T_tool_frame, Ts[-1], directions)
        except AssemblyError as error:
            raise ProtocolError(
                f"{self._protocol.name}: the start, '{name}', cannot be reached from the pose in the CAD: {error}"
            ) from error
        self._state = states[-1]
        self.q = q[-1]
        R = Ts[-1, :3, :3]
        angles = angles_of(R, self._protocol.rotation, waypoint.angles)
        return angles, Ts[-1, :3, 3] + R @ lever

    def along(self, path: PhasePath) -> PhasePath:
        """Move the mechanism along a phase to its end; return the phase with the actual motion of the mechanism.

        Raises:
            ProtocolError: the mechanism cannot follow the phase, or misses the waypoint at its end.
        """
        where = f"{self._protocol.name}: phase '{path.phase.name}' ({path.phase.type})"
        phase = path.phase
        start = self._state
        lever = path.T_tool_frame[:3, 3]
        if isinstance(phase, Samples):
            self._require_driven(phase, where)
            sampled, self.q, self._state = sampled_phase(
                path, phase, self._protocol, self.q, self._names, self._mechanism, start, where
            )
            return sampled
        course = self._course(path, where)
        if course is not None:
            carried_path, self._state = carried(path, course, self._mechanism, start, where)
            self.q = course(np.ones(1))[0]
            return carried_path
        directions = ~self._free()
        if path.rcm is None and phase.is_positioning:
            directions = self._directions(lever)

        def solved(s: Array) -> tuple[Array, Array, Array]:
            try:
                return self._mechanism.follow(path.motion(s).Ts_base_tool, directions, lever, start)
            except AssemblyError as error:
                raise ProtocolError(
                    f"{where} cannot be carried out: {error}{self._too_many_directions(directions)}"
                ) from error

        states, q, Ts = solved(np.linspace(0.0, 1.0, STATIONS))
        self._require_path(path, directions, Ts, where)
        if path.waypoint is not None and path.rcm_mode is None:
            self._require_waypoint(path.waypoint, path.T_tool_frame, Ts[-1], directions)
        self._state = states[-1]
        self.q = q[-1]
        return followed(path, solved)

    def _require_driven(self, phase: Samples, where: str) -> None:
        """Raise `ProtocolError` if a sampled joint is not driven, or if its samples are in the wrong unit."""
        first = dict(zip(phase.joints, phase.q[0], strict=True))
        with_joint_values(self.q, first, phase.angle_joints, self._names, self._revolute, where)

    def _course(self, path: PhasePath, where: str) -> Path | None:
        """Return the path of the driven joints for a phase in joint space; None for a phase defined by tool poses."""
        if isinstance(path.phase, Auxiliary):
            return line(self.q, joint_values_after(self.q, path.phase, self._names, self._revolute, where))
        name = path.waypoint
        if name is None or not path.phase.by_joints:
            return None
        if self._protocol.waypoints[name].joints is not None:
            goal = self.goal(name)
            if np.abs(goal - self.q).max() < NO_MOTION:
                raise ProtocolError(f"{where}: the phase has no length: {self._no_motion_text(name)}")
        elif isinstance(path.phase, Free):
            goal = self._joints_at(path, name, where)
        else:
            return None
        straight = line(self.q, goal)
        if not isinstance(path.phase, Free):
            return straight
        try:
            _, Ts = self._mechanism.carry(straight(np.linspace(0.0, 1.0, STATIONS)), self._state)
        except AssemblyError as error:
            raise ProtocolError(f"{where}: found no path to the goal that keeps the loops closed: {error}") from error
        return free_path(
            path.phase, self._kinematics, (self.q, goal), Ts[[0, -1]], where, self._progress, self._searched
        )

    def _joints_at(self, path: PhasePath, name: str, where: str) -> Array:
        """Return the driven joint values (n,) at a waypoint with a pose, reached by a straight motion of the tool."""
        lever = path.T_tool_frame[:3, 3]
        directions = self._directions(lever)
        goal = path.motion(np.ones(1)).Ts_base_tool
        try:
            _, q, Ts = self._mechanism.follow(goal, directions, lever, self._state)
        except AssemblyError as error:
            text = f"{where}: joint values at waypoint '{name}' are not known; give the waypoint by joints"
            raise ProtocolError(f"{text}: {error}") from error
        self._require_waypoint(name, path.T_tool_frame, Ts[-1], directions)
        return q[-1]

    def goal(self, name: str) -> Array:
        """Return the driven joint values (n,) at a waypoint; a joint without a value there has its drawn value.

        Raises:
            ProtocolError: the waypoint has a joint that is not driven, or a value in the wrong unit.
        """
        waypoint = self._protocol.waypoints[name]
        where = f"{self._protocol.name}: waypoint '{name}'"
        return with_joint_values(
            self._q_drawn, waypoint.joints or {}, waypoint.angle_joints, self._names, self._revolute, where
        )

    def _no_motion_text(self, name: str) -> str:
        """Return a reason and advice for a phase that begins at its waypoint: another value of the first joint."""
        is_angle = self._revolute[0]
        unit, factor = display_unit(is_angle)
        other_value = self.q[0] / factor + _SUGGESTED_STEP[unit]
        return (
            f"the driven joints are already at waypoint '{name}'. Change a joint value of the waypoint within limits, "
            f"such as joints = {{ {self._names[0]}_{unit} = {other_value:.6g} }}"
        )

    def _directions(self, lever: Array) -> np.ndarray:
        """Return a mask (6,) of the directions that can be controlled independently, selected in order."""
        J = self._mechanism.jacobians(self._state, lever)
        J = np.concatenate([J[:, :3] / _RADIAN_LENGTH, J[:, 3:]], axis=1)
        largest = np.linalg.norm(J, axis=2).max()
        directions = np.zeros(6, bool)
        for i, name in enumerate(DIRECTIONS):
            if name in (self._protocol.free or ()):
                continue
            rows = directions.copy()
            rows[i] = True
            if rows.sum() > J.shape[2]:  # more directions than driven joints
                break
            smallest = np.linalg.svd(J[:, rows], compute_uv=False)[:, -1].max()
            directions[i] = smallest > _LEAST_SINGULAR_VALUE * largest
        return directions

    def _free(self) -> np.ndarray:
        """Return a mask (6,) of the directions that the protocol declares free."""
        free = self._protocol.free or ()
        return np.array([direction in free for direction in DIRECTIONS])

    def _too_many_directions(self, directions: np.ndarray) -> str:
        """Return advice for a phase that prescribes more directions than there are driven joints, else ""."""
        prescribed = int(directions.sum())
        joints = len(self._names) - len(self._kinematics.auxiliary)
        if prescribed <= joints:
            return ""
        plural = ""
        if joints > 1:
            plural = "s"
        return (
            f". The phase prescribes {prescribed} directions, but the robot has {joints} driven joint{plural}: "
            'use a phase with type = "joints", or declare directions as free above the tables of the protocol, such as '
            f"free = {_toml_directions(np.arange(6) >= joints)}"
        )

    def _require_path(self, path: PhasePath, directions: np.ndarray, Ts: Array, where: str) -> None:
        """Raise `ProtocolError` if the mechanism leaves the path in a controlled direction."""
        Ts_prescribed = path.motion(np.linspace(0.0, 1.0, len(Ts))).Ts_base_tool
        deviations = np.zeros((len(Ts), 6))
        for station, (T, T_wanted) in enumerate(zip(Ts, Ts_prescribed, strict=True)):
            deviations[station] = _deviation(T, T_wanted, path.T_tool_frame)
        excess = np.abs(deviations) / self._tolerance() * directions
        station = int(np.argmax(excess.max(axis=1)))
        if excess[station].max() <= 1:
            return
        missed = directions & (excess[station] > 1)
        raise ProtocolError(
            f"{where} cannot be carried out: at {100 * station / (len(Ts) - 1):.0f} % of the phase, the tool is "
            f"{_deviation_text(deviations[station], missed)} from its path, because the robot cannot move "
            f'in all directions. Use a phase with type = "joints", or declare directions as free, with free = '
            f"{_toml_directions(self._free() | missed)}"
        )

    def _tolerance(self) -> Array:
        """Return the tolerances (6,) of positions in m, then of rotations in rad."""
        tolerances = self._protocol.tolerances
        return np.repeat([tolerances.waypoint, tolerances.waypoint_angle], 3)

    def _require_waypoint(self, name: str, T_tool_frame: Array, T: Array, directions: np.ndarray) -> None:
        """Raise `ProtocolError` if a pose misses a waypoint in a direction that the protocol does not declare free."""
        waypoint = self._protocol.waypoints[name]
        if waypoint.position is None:
            return
        lever = T_tool_frame[:3, 3]
        R = rotation(waypoint.angles, self._protocol.rotation)
        deviation = _deviation(T, spatial.pose(R, waypoint.position - R @ lever), T_tool_frame)
        missed = (np.abs(deviation) > self._tolerance()) & ~self._free()
        if not missed.any():
            return
        position = T[:3, 3] + T[:3, :3] @ lever
        angles = angles_of(T[:3, :3], self._protocol.rotation, waypoint.angles)
        count = int(directions.sum())
        plural = "s"
        if count == 1:
            plural = ""
        raise ProtocolError(
            f"{self._protocol.name}: waypoint '{name}' is not reachable by this robot, which has {count} "
            f"degree{plural} of freedom there: with {_directions_text(directions)} as in the file, "
            f"{self._protocol.frame} deviates by {_deviation_text(deviation, missed)}. Write the reachable pose: "
            f"position_mm = {_toml_numbers(position / MM)}, angles_deg = {_toml_numbers(angles / DEG)}; or declare the "
            f"other directions as free, with free = {_toml_directions(~directions)} above the tables of the protocol; "
            "or give the waypoint by joints."
        )


def _deviation(T: Array, goal: Array, T_tool_frame: Array) -> Array:
    """Return the deviation (6,) of T from `goal`, in base: moved frame's origin in m, then rotation vector in rad."""
    lever = T_tool_frame[:3, 3]
    position = T[:3, 3] + T[:3, :3] @ lever
    goal_position = goal[:3, 3] + goal[:3, :3] @ lever
    return np.concatenate([position - goal_position, spatial.log_so3(T[:3, :3] @ goal[:3, :3].T)])


def _deviation_text(deviation: Array, directions: np.ndarray) -> str:
    """Return the components of a deviation (6,) in the given directions as text, such as "0.2 mm in x"."""
    parts = []
    for i in np.flatnonzero(directions):
        axis = "xyz"[i % 3]
        if i < 3:
            parts.append(f"{abs(deviation[i]) / MM:.4g} mm in {axis}")
        else:
            parts.append(f"{abs(deviation[i]) / DEG:.4g} deg about {axis}")
    return ", ".join(parts)


def _toml_directions(directions: np.ndarray) -> str:
    """Return directions as a list in TOML."""
    words = []
    for i in np.flatnonzero(directions):
        words.append(f'"{DIRECTIONS[i]}"')
    return f"[{', '.join(words)}]"


def _directions_text(directions: np.ndarray) -> str:
    """Return directions as words."""
    names = []
    for i in np.flatnonzero(directions):
        names.append(DIRECTIONS[i].replace("turn_", "turn about "))
    if not names:
        return "nothing"
    if len(names) == 1:
        return names[0]
    return ", ".join(names[:-1]) + " and " + names[-1]


def _toml_numbers(values: Array) -> str:
    """Return numbers as a list in TOML, with at most six decimals."""
    words = []
    for value in values + 0.0:  # + 0.0: -0 becomes 0
        words.append(f"{value:.6f}".rstrip("0").rstrip("."))
    return f"[{', '.join(words)}]"
