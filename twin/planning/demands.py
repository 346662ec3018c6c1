"""Limits of one robot, or of several that move together, as functions of the path parameter of a phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.planning.path import Path
from twin.planning.path_kinematics import PathKinematics
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import Auxiliary, Free, Limits, Protocol, Solver
from twin.planning.protocol.course import Motion
from twin.planning.timing import Derivatives, Jerk, Load, Timing, time_path


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
    max_jerk = np.inf
    if kinematics.max_jerk is not None:
        max_jerk = kinematics.max_jerk
    limited = np.isfinite(kinematics.motors.max_speed)  # a motor with a speed limit is a further limited coordinate
    motor_rows = kinematics.motors.rows[limited]
    motor_speed = kinematics.motors.max_speed[limited]

    def extra(s: Array) -> tuple[Array, Array]:
        motion = path.motion(s)
        length, length1 = _norm_rate(motion.p1, motion.p2)
        turn, turn1 = _norm_rate(motion.w1, motion.w2)
        first = [length, turn]
        second = [length1, turn1]
        if limited.any():
            first.append(joints(s, 1) @ motor_rows.T)
            second.append(joints(s, 2) @ motor_rows.T)
        return np.column_stack(first), np.column_stack(second)

    latest: tuple[Array, tuple[Motion, Array, Array]] | None = None

    def derivatives(s: Array) -> tuple[Motion, Array, Array]:
        """Return (motion, first and second derivative of the joints); load and jerk share a stored result."""
        nonlocal latest
        if latest is None or latest[0] is not s:
            latest = s, (path.motion(s), joints(s, 1), joints(s, 2))
        return latest[1]

    def load(s: Array, sd: Array, sdd: Array) -> tuple[Array, Array]:
        motion, first, second = derivatives(s)
        sd = sd[:, None]
        sdd = sdd[:, None]
        # speeds and accelerations divided by their limits: the largest of joints, motors and moved frame
        speed_load = np.max(np.abs(first * sd) / max_speed, axis=1)
        if limited.any():
            motors = np.abs(first @ motor_rows.T * sd) / motor_speed
            speed_load = np.maximum(speed_load, np.max(motors, axis=1))
        acceleration_load = np.max(np.abs(first * sdd + second * sd**2) / max_acceleration, axis=1)
        v_frame, a_frame = _frame_load(motion, limits, sd, sdd)
        return np.maximum(speed_load, v_frame), np.maximum(acceleration_load, a_frame)

    def jerk(s: Array, sd: Array, sdd: Array) -> float:
        motion, first, second = derivatives(s)
        sd = sd[:, None]
        sdd = sdd[:, None]
        joint_steps = np.diff(first * sdd + second * sd**2, axis=0)
        of_joints = float(np.max(np.abs(joint_steps) / (dt * max_jerk)))
        of_tip = _step(motion.p1 * sdd + motion.p2 * sd**2) / (dt * limits.tip_jerk)
        of_rotation = _step(motion.w1 * sdd + motion.w2 * sd**2) / (dt * limits.rotation_jerk)
        return max(of_tip, of_rotation, of_joints)

    has_jerk_limit = min(limits.tip_jerk, limits.rotation_jerk, np.min(max_jerk)) < np.inf
    extra_speed, extra_acceleration = _extra_limits(limits, motor_speed)
    return Demands(
        joints=joints,
        speed=max_speed,
        acceleration=max_acceleration,
        extra=extra,
        extra_speed=extra_speed,
        extra_acceleration=extra_acceleration,
        load=load,
        jerk=jerk if has_jerk_limit else None,
    )


def _step(acceleration: Array) -> float:
    """Return the largest norm of the change of a vector (k, 3) between neighbouring samples."""
    return float(np.max(np.linalg.norm(np.diff(acceleration, axis=0), axis=1)))


def _extra_limits(limits: Limits, motor_speed: Array) -> tuple[Array, Array]:
    """Return the limits of speed and acceleration of the further coordinates; motors have none of acceleration."""
    speed = np.concatenate([[limits.tip_speed, limits.rotation_speed], motor_speed])
    motor_acceleration = np.full(len(motor_speed), np.inf)
    acceleration = np.concatenate([[limits.tip_acceleration, limits.rotation_acceleration], motor_acceleration])
    return speed, acceleration


def timed(robots: Sequence[Demands], dt: float, solver: Solver) -> Timing:
    """Return the fastest timing of a phase within the limits of all robots, which move together.

    Raises:
        TimingError: no timing within the limits was found.
    """

    def joints(s: Array, order: int = 0) -> Array:
        joints_of_robots = [robot.joints(s, order) for robot in robots]
        return np.column_stack(joints_of_robots)

    def extra(s: Array) -> tuple[Array, Array]:
        first = []
        second = []
        for robot in robots:
            first_of_robot, second_of_robot = robot.extra(s)
            first.append(first_of_robot)
            second.append(second_of_robot)
        return np.column_stack(first), np.column_stack(second)

    def load(s: Array, sd: Array, sdd: Array) -> tuple[Array, Array]:
        speeds = []
        accelerations = []
        for robot in robots:
            speed_of_robot, acceleration_of_robot = robot.load(s, sd, sdd)
            speeds.append(speed_of_robot)
            accelerations.append(acceleration_of_robot)
        return np.max(speeds, axis=0), np.max(accelerations, axis=0)

    jerks = [robot.jerk for robot in robots if robot.jerk is not None]

    def jerk(s: Array, sd: Array, sdd: Array) -> float:
        largest = 0.0
        for jerk_of_robot in jerks:
            largest = max(largest, jerk_of_robot(s, sd, sdd))
        return largest

    jerk_or_none = None
    if jerks:
        jerk_or_none = jerk
    # first the joints of all robots, then their further coordinates, as in `joints` and `extra`
    speed = []
    acceleration = []
    for robot in robots:
        speed.append(robot.speed)
        acceleration.append(robot.acceleration)
    for robot in robots:
        speed.append(robot.extra_speed)
        acceleration.append(robot.extra_acceleration)
    return time_path(
        joints,
        np.concatenate(speed),
        np.concatenate(acceleration),
        extra=extra,
        dt=dt,
        load=load,
        jerk=jerk_or_none,
        solver=solver,
    )


def _joint_limits(path: PhasePath, protocol: Protocol, kinematics: PathKinematics) -> tuple[Array, Array]:
    """Return the maximum speeds and accelerations (n,) of the driven joints, in m or rad per s and per s2.

    In a phase in joint space, a joint without limits of its own gets the tool limits of the phase type: if only a
    gripper's jaw moves, the tool is at rest, and no other limit would slow down the joint.
    """
    speed = kinematics.max_speed
    acceleration = kinematics.max_acceleration
    waypoint = protocol.waypoints.get(path.waypoint or "")
    by_joints = path.phase.by_joints and waypoint is not None and waypoint.joints is not None
    if not by_joints and not isinstance(path.phase, (Auxiliary, Free)):
        return speed, acceleration
    limits = protocol.limits[path.phase.type]
    turns = np.array(kinematics.revolute, bool)
    tool_speed = np.where(turns, limits.rotation_speed, limits.tip_speed)
    tool_acceleration = np.where(turns, limits.rotation_acceleration, limits.tip_acceleration)
    speed = np.where(np.isfinite(speed), speed, tool_speed)
    acceleration = np.where(np.isfinite(acceleration), acceleration, tool_acceleration)
    return speed, acceleration


def _frame_load(motion: Motion, limits: Limits, sd: Array, sdd: Array) -> tuple[Array, Array]:
    """Return speed and acceleration (k,) of the moved frame, each divided by its limit; sd and sdd are (k, 1).

    The larger of its origin's and its rotation's counts.
    """
    tip_speed = np.linalg.norm(motion.p1 * sd, axis=1)
    tip_acceleration = np.linalg.norm(motion.p1 * sdd + motion.p2 * sd**2, axis=1)
    rotation_speed = np.linalg.norm(motion.w1 * sd, axis=1)
    rotation_acceleration = np.linalg.norm(motion.w1 * sdd + motion.w2 * sd**2, axis=1)
    speed = np.maximum(tip_speed / limits.tip_speed, rotation_speed / limits.rotation_speed)
    acceleration = np.maximum(
        tip_acceleration / limits.tip_acceleration, rotation_acceleration / limits.rotation_acceleration
    )
    return speed, acceleration


def _norm_rate(d1: Array, d2: Array) -> tuple[Array, Array]:
    """Return first and second derivative (k,) of the arc length from the derivatives (k, 3) of the curve."""
    rate = np.linalg.norm(d1, axis=1)
    nonzero = np.where(rate > 0, rate, 1.0)  # at rest, the numerator is zero too
    return rate, np.einsum("ij,ij->i", d1, d2) / nonzero
