"""Compute joint values that keep the shaft of an arm in a port, within joint and speed limits.

At every intermediate pose, the shaft is in the port. If the limits allow only a part of the motion of a tick, the arm
executes this part. If a limit blocks the whole motion, the arm executes the components that are still possible:
direction, depth or roll.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator
from twin.kinematics import Kinematics
from twin.kinematics.compiled import POSE_TOL
from twin.simulation.limits import JointLimits
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND, ROBOT_ENCODER, ROBOT_GOAL

_LARGEST_STEP = 0.05
"""Largest joint step in rad or m per tick; a larger step may belong to another working mode."""

_LARGEST_CALLS = 4
"""Maximum number of inverse kinematics calls per motion."""

_SAFETY = 0.98
"""Safety factor of the fraction of a motion that is within the limits: joints do not move in proportion to it."""

_NO_TURN = 1e-15
"""Sine of an angle up to which two directions are one, and define no axis."""

_UNREACHED_FRACTION = 0.5
"""Fraction of a motion that is tried next if its end is out of reach."""

_BLOCKED_FRACTION = 0.02
"""If less than this fraction of a motion is possible, its components (direction, depth, roll) are tried separately."""

_SMALLEST_MOTION = 1e-12
"""Size of a motion in m and rad that counts as zero."""


class ThroughPort(Block):
    """Reads `<robot>.goal` (16,), a tool pose in base whose z axis passes through the port, and `<robot>.encoder`.

    Writes `<robot>.command` (n,). The shaft is the z axis of the tool.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: JointLimits, p_port: Array) -> None:
        """Start at joint values q (n,), with the shaft in the port p_port (3,) in m in base."""
        self.robot = robot
        self.kin = kin
        self.limits = limits
        self._command = ROBOT_COMMAND.of(robot)
        self._pose_pair, self._displacement = _displacement_of(p_port).bind()
        # The attributes below are views into the inputs of the compiled function.
        z, self._allowed = _allowed(kin, p_port).bind()
        n = len(q)
        ends = np.cumsum((16, 4, n, n))
        self._start_pose, self._tried_displacement, self._start_q, self._smallest_step, self._largest_step = np.split(
            z, ends
        )
        self._last_inputs: tuple[bytes, bytes] = (b"", b"")
        self.outputs = {self._command: q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make one step towards the goal."""
        goal = signals[ROBOT_GOAL.of(self.robot)]
        q = signals[ROBOT_ENCODER.of(self.robot)]
        inputs = (goal.tobytes(), q.tobytes())
        if inputs == self._last_inputs:
            return {}
        self._last_inputs = inputs
        self._start_pose[:] = self.kin.program.forward.one(q).ravel()
        self._pose_pair[:16] = self._start_pose
        self._pose_pair[16:] = goal
        displacement = self._displacement()
        if not np.abs(displacement).max() > _SMALLEST_MOTION:
            return {}
        low, high = self.limits.steps(q, dt)
        self._start_q[:] = q
        self._smallest_step[:] = np.maximum(low, -_LARGEST_STEP)
        self._largest_step[:] = np.minimum(high, _LARGEST_STEP)
        step, part = self._along(np.zeros(4), displacement)
        if part >= _BLOCKED_FRACTION:
            return {self._command: q + step}
        # blocked: tilt about x, tilt about y, depth and roll one after the other, each as far as it goes
        step = np.zeros_like(q)
        done_displacement = np.zeros(4)
        for component in np.diag(displacement):
            next_step, part = self._along(done_displacement, component)
            if part > 0:
                step = next_step
                done_displacement = done_displacement + part * component
        return {self._command: q + step}

    def _along(self, done_displacement: Array, displacement: Array) -> tuple[Array, float]:
        """Return (joint step (n,) for `done_displacement` + fraction * `displacement`, fraction); zeros if blocked."""
        fraction = 1.0
        if not np.abs(displacement).max() > _SMALLEST_MOTION:
            fraction = 0.0
        for _ in range(_LARGEST_CALLS):
            if fraction <= 0:
                break
            self._tried_displacement[:] = done_displacement + fraction * displacement
            result = self._allowed()
            part_within_limits = result[-1]
            if part_within_limits == 1.0:
                return result[:-1], fraction
            fraction *= float(part_within_limits)
        return np.zeros_like(self._start_q), 0.0


def _displacement_of(p_port: Array) -> Evaluator:
    """Return the function from two poses (16 each) to the displacement (4) from the first pose to the second.

    The values are the tilt about x and y of the tool in rad, the change of depth in m, and the roll in rad.
    """
    z = ca.SX.sym("z", 32)
    T = symbolic.unflat(z[:16], 4, 4)
    goal = symbolic.unflat(z[16:], 4, 4)
    shaft = T[:3, 2]
    goal_shaft = goal[:3, 2]
    # axis of the smallest rotation between the shafts, in the tool, times the sine of its angle
    axis = T[:3, :3].T @ ca.cross(shaft, goal_shaft)
    sine = symbolic.norm(axis)
    turns = sine > _NO_TURN
    angle = ca.atan2(sine, ca.dot(shaft, goal_shaft))
    tilt = axis[:2] * ca.if_else(turns, angle / ca.if_else(turns, sine, 1), 1)
    # what remains after the tilt is a rotation about the shaft
    R_rest = (T[:3, :3] @ _tilted(tilt)).T @ goal[:3, :3]
    roll = ca.atan2(R_rest[1, 0] - R_rest[0, 1], R_rest[0, 0] + R_rest[1, 1])
    port = ca.DM(p_port)
    depth = ca.dot(goal[:3, 3] - port, goal_shaft) - ca.dot(T[:3, 3] - port, shaft)
    return Evaluator("way_through_port", z, ca.vertcat(tilt, depth, roll))


def _allowed(kin: Kinematics, p_port: Array) -> Evaluator:
    """Return the function from a displacement to (joint step (n), fraction of this step that is within the limits).

    Its arguments are the start pose (16), the displacement (4), q (n), and the smallest and the largest joint step (n
    each). If the end of the displacement is out of reach, the fraction is `_UNREACHED_FRACTION`.
    """
    n = len(kin.joints)
    z = ca.SX.sym("z", 20 + 3 * n)
    flat, displacement, q, low, high = ca.vertsplit(z, (0, 16, 20, 20 + n, 20 + 2 * n, 20 + 3 * n))
    T = symbolic.unflat(flat, 4, 4)
    port = ca.DM(p_port)
    R = T[:3, :3] @ _tilted(displacement[:2]) @ symbolic.rotation_z(displacement[3])
    depth = ca.dot(T[:3, 3] - port, T[:3, 2]) + displacement[2]
    end = symbolic.pose(R, port + depth * R[:, 2])
    # joint values, then the error of the pose at these values
    solution = kin.program.inverse.function(symbolic.flat(end))
    step = solution[:n] - q
    # of angles that differ by full turns, the nearest to q counts
    turns_per_rad = ca.DM(np.where(kin.revolute, 1 / (2 * np.pi), 0.0))
    step -= 2 * np.pi * ca.floor(step * turns_per_rad + 0.5)
    is_reached = ca.logic_and(ca.sumsqr(step) < np.inf, solution[n] <= POSE_TOL)  # false for NaN
    is_within = ca.mmin(ca.vertcat(step >= low, step <= high))
    limit = ca.if_else(step > high, high, ca.if_else(step < low, low, step))
    parts = ca.if_else(step == limit, 1, limit / ca.if_else(step == 0, 1, step))
    part_within_limits = _SAFETY * ca.fmax(ca.mmin(parts), 0)
    part_if_reached = ca.if_else(is_within, 1, part_within_limits)
    part = ca.if_else(is_reached, part_if_reached, _UNREACHED_FRACTION)
    return Evaluator("allowed_through_port", z, ca.vertcat(step, part))


def _tilted(tilt: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) of the rotation vector (tilt, 0)."""
    return symbolic.exp_so3(ca.vertcat(tilt, 0))
