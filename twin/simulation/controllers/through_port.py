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

_NEAR = 0.05
"""Largest joint step in rad or m per tick; a larger step may belong to another working mode."""

_TRIES, _SAFE = 4, 0.98
"""Maximum number of inverse kinematics calls per motion; safety factor of the motion's fraction within limits."""

_STUCK = 0.02
"""If less than this fraction of a motion is possible, its components (direction, depth, roll) are tried separately."""

_STILL = 1e-12
"""Size of a motion in m and rad that counts as zero."""


class ThroughPort(Block):
    """Reads `<robot>.goal` (16,), a tool pose in base whose z axis passes through the port, and `<robot>.encoder`.

    Writes `<robot>.command` (n,). The shaft is the z axis of the tool.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: JointLimits, p_port: Array) -> None:
        """Start at joint values q (n,), with the shaft in the port p_port (3,) in m in base."""
        self.robot, self.kin, self.limits = robot, kin, limits
        self._command = ROBOT_COMMAND.of(robot)
        self._pair, self._way = _way(p_port).bind()
        self._z, self._allowed = _allowed(kin, p_port).bind()
        parts = np.cumsum((16, 4, len(q), len(q)))
        self._T, self._at, self._q, self._low, self._high = np.split(self._z, parts)
        self._given: tuple[bytes, bytes] = b"", b""
        self.outputs = {self._command: q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make one step towards the goal."""
        goal, q = signals[ROBOT_GOAL.of(self.robot)], signals[ROBOT_ENCODER.of(self.robot)]
        given = goal.tobytes(), q.tobytes()
        if given == self._given:
            return {}
        self._given = given
        self._T[:] = self.kin.program.forward.one(q).ravel()
        self._pair[:16], self._pair[16:] = self._T, goal
        way = self._way()
        if not np.abs(way).max() > _STILL:
            return {}
        low, high = self.limits.steps(q, dt)
        self._q[:], self._low[:], self._high[:] = q, np.maximum(low, -_NEAR), np.minimum(high, _NEAR)
        step, part = self._along(np.zeros(4), way)
        if part >= _STUCK:
            return {self._command: q + step}
        step, displacement = np.zeros_like(q), np.zeros(4)
        for alone in np.diag(way):
            further, part = self._along(displacement, alone)
            if part > 0:
                step, displacement = further, displacement + part * alone
        return {self._command: q + step}

    def _along(self, done: Array, way: Array) -> tuple[Array, float]:
        """Return (joint step (n,) for the displacement done + fraction * way, fraction); zeros if it is blocked."""
        part = 1.0 if np.abs(way).max() > _STILL else 0.0
        for _ in range(_TRIES):
            if part <= 0:
                break
            self._at[:] = done + part * way
            out = self._allowed()
            if out[-1] == 1.0:
                return out[:-1], part
            part *= float(out[-1])
        return np.zeros_like(self._q), 0.0


def _way(p_port: Array) -> Evaluator:
    """Return the function from two poses (16 each) to the displacement `way` (4) from the first pose to the second.

    The values are the tilt about x and y of the tool in rad, the change of depth in m, and the roll in rad.
    """
    z = ca.SX.sym("z", 32)
    T, goal = symbolic.unflat(z[:16], 4, 4), symbolic.unflat(z[16:], 4, 4)
    a, b = T[:3, 2], goal[:3, 2]
    v = T[:3, :3].T @ ca.cross(a, b)
    size = symbolic.norm(v)
    tilt = v[:2] * ca.if_else(size > 1e-15, ca.atan2(size, ca.dot(a, b)) / ca.if_else(size > 1e-15, size, 1), 1)
    rest = (T[:3, :3] @ _tilted(tilt)).T @ goal[:3, :3]
    roll = ca.atan2(rest[1, 0] - rest[0, 1], rest[0, 0] + rest[1, 1])
    port = ca.DM(p_port)
    depth = ca.dot(goal[:3, 3] - port, b) - ca.dot(T[:3, 3] - port, a)
    return Evaluator("way_through_port", z, ca.vertcat(tilt, depth, roll))


def _allowed(kin: Kinematics, p_port: Array) -> Evaluator:
    """Return the function from a displacement to (joint step (n), fraction of this step that is within the limits).

    Its arguments are the start pose (16), the displacement (4), q (n), and the smallest and the largest joint step (n
    each). If the end of the displacement is out of reach, the fraction is 0.5.
    """
    n = len(kin.joints)
    z = ca.SX.sym("z", 20 + 3 * n)
    flat, way, q, low, high = ca.vertsplit(z, (0, 16, 20, 20 + n, 20 + 2 * n, 20 + 3 * n))
    T, port = symbolic.unflat(flat, 4, 4), ca.DM(p_port)
    R = T[:3, :3] @ _tilted(way[:2]) @ symbolic.rotation_z(way[3])
    depth = ca.dot(T[:3, 3] - port, T[:3, 2]) + way[2]
    found = kin.program.inverse.function(symbolic.flat(symbolic.pose(R, port + depth * R[:, 2])))
    turns = ca.DM(np.where(kin.revolute, 1 / (2 * np.pi), 0.0))
    step = found[:n] - q
    step -= 2 * np.pi * ca.floor(step * turns + 0.5)
    reached = ca.logic_and(ca.sumsqr(step) < np.inf, found[n] <= POSE_TOL)  # false for NaN
    within = ca.mmin(ca.vertcat(step >= low, step <= high))
    limit = ca.if_else(step > high, high, ca.if_else(step < low, low, step))
    parts = ca.if_else(step == limit, 1, limit / ca.if_else(step == 0, 1, step))
    part = ca.if_else(reached, ca.if_else(within, 1, _SAFE * ca.fmax(ca.mmin(parts), 0)), 0.5)
    return Evaluator("allowed_through_port", z, ca.vertcat(step, part))


def _tilted(tilt: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) of the rotation vector (tilt, 0)."""
    return symbolic.exp_so3(ca.vertcat(tilt, 0))
