"""Limits of one robot, or of several that move together, as functions of the path parameter of a phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.planning.path import Path
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import Auxiliary, Free, Limits, Protocol, Solver
from twin.planning.protocol.course import Motion
from twin.planning.timing import Derivatives, Jerk, Load, Timing, time_path
from twin.planning.trajectory import PathKinematics


@dataclass(frozen=True)
class Demands:
    """Limits of one robot in a phase: of its joints, of its moved frame, and of its motors.

    Attributes:
        joints: path of the driven joints (n,).
        speed, acceleration: (n,) limits of the driven joints in m or rad per s and per s2.
        extra: derivatives of the further coordinates (path length and rotation of the moved frame, then motors).
        extra_speed, extra_acceleration: limits of the further coordinates in m or rad per s and per s2.
        load, jerk: arguments of `time_path`; `jerk` is None if there is no jerk limit.
    """

    joints: Path
    speed: Array
    acceleration: Array
    extra: Derivatives
    extra_speed: Array
    extra_acceleration: Array
    load: Load
    jerk: Jerk | None


def demands(path: PhasePath, joints: Path, protocol: Protocol, kinematics: PathKinematics, dt: float) -> Demands:
    """Return the limits of a robot in a phase.

    Args:
        path: the phase.
        joints: path of the robot's driven joints (n,) in this phase.
        protocol: source of the limits of the moved frame.
        kinematics: source of the limits of joints and motors.
        dt: sampling time in s.
    """
    limits = protocol.limits[path.phase.type]
    max_speed, max_acceleration = _joint_limits(path, protocol, kinematics)
    max_jerk = np.inf if kinematics.max_jerk is None else kinematics.max_jerk
    fast = np.isfinite(kinematics.motors.max_speed)  # each motor with a speed limit is a further limited coordinate
    rows, motor_speed = kinematics.motors.rows[fast], kinematics.motors.max_speed[fast]

    def extra(s: Array) -> tuple[Array, Array]:
        m = path.motion(s)
        length, length1 = _norm_rate(m.p1, m.p2)
        turn, turn1 = _norm_rate(m.w1, m.w2)
        if not fast.any():
            return np.column_stack([length, turn]), np.column_stack([length1, turn1])
        motors, motors1 = (joints(s, order) @ rows.T for order in (1, 2))
        return np.column_stack([length, turn, motors]), np.column_stack([length1, turn1, motors1])

    latest: tuple[Array, tuple[Motion, Array, Array]] | None = None

    def at(s: Array) -> tuple[Motion, Array, Array]:
        """Return (motion, first and second derivative of the joints); load and jerk share a stored result."""
        nonlocal latest
        if latest is None or latest[0] is not s:
            latest = s, (path.motion(s), joints(s, 1), joints(s, 2))
        return latest[1]

    def load(s: Array, sd: Array, sdd: Array) -> tuple[Array, Array]:
        m, first, second = at(s)
        sd, sdd = sd[:, None], sdd[:, None]
        v = np.max(np.abs(first * sd) / max_speed, axis=1)
        if fast.any():
            v = np.maximum(v, np.max(np.abs(first @ rows.T * sd) / motor_speed, axis=1))
        a = np.max(np.abs(first * sdd + second * sd**2) / max_acceleration, axis=1)
        for d1, d2, speed, acceleration in _vectors(m, limits):
            v = np.maximum(v, np.linalg.norm(d1 * sd, axis=1) / speed)
            a = np.maximum(a, np.linalg.norm(d1 * sdd + d2 * sd**2, axis=1) / acceleration)
        return v, a

    def jerk(s: Array, sd: Array, sdd: Array) -> float:
        m, first, second = at(s)
        parts = ((m.p1, m.p2, limits.tip_jerk), (m.w1, m.w2, limits.rotation_jerk))
        accelerations = [(d1 * sdd[:, None] + d2 * sd[:, None] ** 2, most) for d1, d2, most in parts]
        tip = max(float(np.max(np.linalg.norm(np.diff(a, axis=0), axis=1))) / (dt * most) for a, most in accelerations)
        of_joints = first * sdd[:, None] + second * sd[:, None] ** 2
        return max(tip, float(np.max(np.abs(np.diff(of_joints, axis=0)) / (dt * max_jerk))))

    return Demands(
        joints,
        max_speed,
        max_acceleration,
        extra,
        np.concatenate([[limits.tip_speed, limits.rotation_speed], motor_speed]),
        np.concatenate([[limits.tip_acceleration, limits.rotation_acceleration], np.full(len(rows), np.inf)]),
        load,
        jerk if min(limits.tip_jerk, limits.rotation_jerk, np.min(max_jerk)) < np.inf else None,
    )


def timed(robots: Sequence[Demands], dt: float, solver: Solver) -> Timing:
    """Return the fastest timing of a phase within the limits of all robots, which move together.

    Raises:
        TimingError: no timing within the limits was found.
    """

    def joints(s: Array, order: int = 0) -> Array:
        return np.column_stack([r.joints(s, order) for r in robots])

    def extra(s: Array) -> tuple[Array, Array]:
        first, second = zip(*(r.extra(s) for r in robots), strict=True)
        return np.column_stack(first), np.column_stack(second)

    def load(s: Array, sd: Array, sdd: Array) -> tuple[Array, Array]:
        speed, acceleration = zip(*(r.load(s, sd, sdd) for r in robots), strict=True)
        return np.max(speed, axis=0), np.max(acceleration, axis=0)

    jerks = [r.jerk for r in robots if r.jerk is not None]
    return time_path(
        joints,
        np.concatenate([*(r.speed for r in robots), *(r.extra_speed for r in robots)]),
        np.concatenate([*(r.acceleration for r in robots), *(r.extra_acceleration for r in robots)]),
        extra=extra,
        dt=dt,
        load=load,
        jerk=(lambda s, sd, sdd: max(jerk(s, sd, sdd) for jerk in jerks)) if jerks else None,
        solver=solver,
    )


def _joint_limits(path: PhasePath, protocol: Protocol, kinematics: PathKinematics) -> tuple[Array, Array]:
    """Return the maximum speeds and accelerations (n,) of the driven joints, in m or rad per s and per s2.

    In a phase in joint space, a joint without limits of its own gets the tool limits of the phase type: if only a
    gripper's jaw moves, the tool is at rest, and no other limit would slow down the joint.
    """
    speed, acceleration = kinematics.max_speed, kinematics.max_acceleration
    waypoint = protocol.waypoints.get(path.waypoint or "")
    by_joints = path.phase.by_joints and waypoint is not None and waypoint.joints is not None
    if not by_joints and not isinstance(path.phase, (Auxiliary, Free)):
        return speed, acceleration
    limits, turns = protocol.limits[path.phase.type], np.array(kinematics.revolute, bool)
    own_speed = np.where(turns, limits.rotation_speed, limits.tip_speed)
    own_acceleration = np.where(turns, limits.rotation_acceleration, limits.tip_acceleration)
    return np.where(np.isfinite(speed), speed, own_speed), np.where(
        np.isfinite(acceleration), acceleration, own_acceleration
    )


def _vectors(m: Motion, limits: Limits) -> tuple[tuple[Array, Array, float, float], ...]:
    return (
        (m.p1, m.p2, limits.tip_speed, limits.tip_acceleration),
        (m.w1, m.w2, limits.rotation_speed, limits.rotation_acceleration),
    )


def _norm_rate(d1: Array, d2: Array) -> tuple[Array, Array]:
    """Return first and second derivative (k,) of the arc length from the derivatives (k, 3) of the curve."""
    n = np.linalg.norm(d1, axis=1)
    return n, np.einsum("ij,ij->i", d1, d2) / np.where(n > 0, n, 1.0)
