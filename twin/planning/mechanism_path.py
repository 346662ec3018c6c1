"""The motion of a mechanism along a path of its driven joints, as series in the path parameter.

`MechanismPath` is a phase with this motion, `carried` makes it from a path of the driven joints, `followed` from any
solver of the mechanism. `with_joint_values`, `joint_values_after` and `with_auxiliary` are the joint values that a
protocol prescribes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, ProtocolError, unknown
from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.planning.free_phase import PhaseProgress, Searched, free_path
from twin.planning.path import ChebyshevPath, Path, fit, line
from twin.planning.path_kinematics import MovableMechanism, PathKinematics
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import Auxiliary, Free
from twin.planning.protocol.course import Motion, angles_of

STATIONS = 33
"""Number of points of a phase at which the mechanism is evaluated before fitting."""

_ROUNDING_CHANGE = 1e-12
"""Changes along a phase up to this value (in m, or of a matrix entry) count as rounding errors."""

NO_MOTION = 1e-9
"""Change (m, rad) of all driven joints below which a phase counts as having no length."""


@dataclass(frozen=True)
class MechanismPath(PhasePath):
    """A phase with the actual motion of the mechanism.

    Attributes:
        values: path of the driven joints (n,) over s.
        place: path (12,) of the tool over s: its origin in m, then its rotation matrix row by row.
    """

    values: Path
    place: Path

    def joints(self, s: Array, kinematics: PathKinematics) -> Array:
        """Return the driven joint values (k, n) at the path parameters s (k,)."""
        return self.values(s)

    def driven(self, kinematics: PathKinematics, where: str) -> Path:
        """Return the path of the driven joints."""
        return self.values

    def motion(self, s: Array) -> Motion:
        """Return the motion of the phase at the path parameters s (k,)."""
        place = self.place(s, 0)
        place1 = self.place(s, 1)
        place2 = self.place(s, 2)
        R = place[:, 3:].reshape(-1, 3, 3)
        R1 = place1[:, 3:].reshape(-1, 3, 3)
        R2 = place2[:, 3:].reshape(-1, 3, 3)
        # restore the orthogonality lost by truncation, by one Newton step towards the nearest rotation
        R = R @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(R, 1, 2) @ R)
        Rt = np.swapaxes(R, 1, 2)
        w1 = _rotation_vectors(R1 @ Rt)
        w2 = _rotation_vectors(R2 @ Rt)
        # velocity and acceleration of the moved frame: those of the tool's origin, and those of the lever
        lever = R @ self.T_tool_frame[:3, 3]
        lever1 = np.cross(w1, lever)
        p = place[:, :3]
        velocity = place1[:, :3]
        return Motion(
            spatial.pose(R, p),
            p + lever,
            velocity + lever1,
            place2[:, :3] + np.cross(w2, lever) + np.cross(w1, lever1),
            w1,
            w2,
            np.concatenate([velocity, w1], axis=1),
        )

    def angles(self, s: float) -> Array:
        """Return the angles (3,) in rad of the tool at s, about the axes of `order`."""
        R = self.motion(np.array([s])).Ts_base_tool[0, :3, :3]
        return angles_of(R, self.order, self.angles0 + s * (self.angles1 - self.angles0))


def carried(
    path: PhasePath, course: Path, mechanism: MovableMechanism, start: Array, where: str
) -> tuple[MechanismPath, Array]:
    """Move a mechanism along the joint path `course` from state `start`; return (phase with this motion, end state).

    Raises:
        ProtocolError: the loops open; the message begins with `where`.
    """

    def solved(s: Array) -> tuple[Array, Array, Array]:
        q = course(s)
        try:
            states, Ts = mechanism.carry(q, start)
        except AssemblyError as error:
            raise ProtocolError(f"{where} cannot be carried out: {error}") from error
        return states, q, Ts

    states, _, _ = solved(np.linspace(0.0, 1.0, STATIONS))
    return replace(followed(path, solved), values=course), states[-1]


def followed(path: PhasePath, solved: Callable[[Array], tuple[Array, Array, Array]]) -> MechanismPath:
    """Return a phase with the motion of the mechanism, as series fitted to `solved`.

    `solved` is a function of s (k,) that returns states (k, nq), driven joint values (k, n) and tool poses (k, 4, 4).
    """

    def coordinates(s: Array) -> Array:
        """Return origin, rotation matrix by rows and joint values (k, 12 + n) at s (k,)."""
        order = np.argsort(s)  # the mechanism moves forwards from station to station
        _, q, Ts = solved(s[order])
        values = np.concatenate([Ts[:, :3, 3], Ts[:, :3, :3].reshape(-1, 9), q], axis=1)
        is_constant = np.ptp(values, axis=0) < _ROUNDING_CHANGE
        values = np.where(is_constant, values[0], values)  # remove rounding from constant values
        return values[np.argsort(order)]

    series = fit(coordinates)
    c = series.coefficients
    tail = series.tail
    place = ChebyshevPath(c[:, :12], tail[:12])
    values = ChebyshevPath(c[:, 12:], tail[12:])
    phase = MechanismPath(**vars(path), values=values, place=place)
    end = phase.motion(np.ones(1))
    angles1 = angles_of(end.Ts_base_tool[0, :3, :3], path.order, path.angles1)
    return replace(phase, angles1=angles1, tip1=end.p[0])


def with_free_paths(
    paths: Sequence[PhasePath],
    kinematics: PathKinematics,
    protocol: str,
    progress: PhaseProgress = lambda label: None,
    searched: Searched = lambda name, rounds: None,
) -> tuple[PhasePath, ...]:
    """Return the phases, with each free phase replaced by a path around obstacles between its end poses.

    `progress` and `searched` are functions that are called as in `free_phase.free_path`.

    Raises:
        ProtocolError: a free phase cannot be carried out; see `free_phase.free_path`.
    """
    phases = []
    for path in paths:
        if not isinstance(path.phase, Free):
            phases.append(path)
            continue
        where = f"{protocol}: phase '{path.phase.name}' ({path.phase.type})"
        mechanism = kinematics.mechanism
        if mechanism is None:
            raise ProtocolError(f"{where}: a free motion requires a mechanism, but there is none")
        ends = np.array([0.0, 1.0])
        start, goal = path.joints(ends, kinematics)
        Ts = path.motion(ends).Ts_base_tool
        course = free_path(path.phase, kinematics, (start, goal), Ts, where, progress, searched)
        state, drawn_q = mechanism.drawn()
        try:
            states, _ = mechanism.carry(line(drawn_q, start)(np.linspace(0.0, 1.0, STATIONS)), state)
        except AssemblyError as error:
            raise ProtocolError(
                f"{where}: the start of the phase cannot be reached from the pose in the CAD: {error}"
            ) from error
        free, _ = carried(path, course, mechanism, states[-1], where)
        phases.append(free)
    return tuple(phases)


def with_joint_values(
    q: Array,
    values: Mapping[str, float],
    in_degrees: frozenset[str],
    names: tuple[str, ...],
    revolute: tuple[bool, ...],
    where: str,
) -> Array:
    """Return a copy of q (n,), in m or rad, in which the joints named in `values` have these values.

    `names` (n,) and `revolute` (n,) are the names of the driven joints and whether each is an angle in rad.
    `in_degrees` names the joints whose values are in deg in the protocol file; other values are in mm there.

    Raises:
        ProtocolError: a named joint is not driven, or its unit is wrong; the message begins with `where`.
    """
    q_placed = q.copy()
    for joint, value in values.items():
        if joint not in names:
            raise ProtocolError(f"{where}: {unknown('driven joint', joint, names)}")
        i = names.index(joint)
        if revolute[i] != (joint in in_degrees):
            unit, _ = display_unit(revolute[i])
            other_unit, _ = display_unit(not revolute[i])
            raise ProtocolError(
                f"{where}: joint '{joint}' is in {unit}: write {joint}_{unit}, not {joint}_{other_unit}"
            )
        q_placed[i] = value
    return q_placed


def joint_values_after(
    q: Array, phase: Auxiliary, names: tuple[str, ...], revolute: tuple[bool, ...], where: str
) -> Array:
    """Return the joint values (n,) at the end of an auxiliary phase that begins at q.

    Raises:
        ProtocolError: the phase moves no joint, names a joint that is not driven, or has a value in the wrong unit.
    """
    q_end = with_joint_values(q, phase.joints, phase.angle_joints, names, revolute, where)
    if np.abs(q_end - q).max() < NO_MOTION:
        raise ProtocolError(f"{where}: the phase has no length: the joints already have these values; remove the phase")
    return q_end


def with_auxiliary(paths: Sequence[PhasePath], kinematics: PathKinematics, protocol: str) -> tuple[PhasePath, ...]:
    """Return the phases with the values of the auxiliary joints; each joint moves only in phases that name the joint.

    Raises:
        ProtocolError: an auxiliary phase moves no joint, or a joint that is not auxiliary.
    """
    names = kinematics.joint_names
    columns = [names.index(name) for name in kinematics.auxiliary]
    q = np.zeros(len(names))
    q[columns] = list(kinematics.auxiliary.values())
    phases = []
    for path in paths:
        phase = path.phase
        after = q
        if isinstance(phase, Auxiliary):
            where = f"{protocol}: phase '{phase.name}' ({phase.type})"
            for name in phase.joints:
                if name in names and name not in kinematics.auxiliary:
                    raise ProtocolError(
                        f"{where}: joint '{name}' moves the tool, but the phase moves auxiliary joints only (this "
                        f"robot: {', '.join(kinematics.auxiliary) or 'none'}); use a positioning, or a waypoint with "
                        "joint values"
                    )
            after = joint_values_after(q, phase, names, kinematics.revolute, where)
        extra_joints = []
        for column in columns:
            extra_joints.append((column, float(q[column]), float(after[column])))
        phases.append(replace(path, extra_joints=tuple(extra_joints)))
        q = after
    return tuple(phases)


def _rotation_vectors(A: Array) -> Array:
    """Return the vectors (k, 3) of the antisymmetric parts of matrices A (k, 3, 3)."""
    x = A[:, 2, 1] - A[:, 1, 2]
    y = A[:, 0, 2] - A[:, 2, 0]
    z = A[:, 1, 0] - A[:, 0, 1]
    return 0.5 * np.stack([x, y, z], axis=1)
