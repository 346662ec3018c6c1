"""Joint values of an arm that keeps its shaft in a port by its motion alone, within joint and speed limits.

Every pose on the way has its shaft in the port. If the limits allow only a part of the way of a tick, the arm makes
this part. If a limit stops the whole way, the arm makes the parts of it that remain: direction, depth or roll.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.kinematics.compiled import POSE_TOL
from twin.simulation.controllers.pivot import turned
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals

_NEAR = 0.05
"""Largest joint step in rad or m per tick; a larger one may belong to another working mode."""

_TRIES, _SAFE = 4, 0.98
"""Number of inverse solutions for one way; factor on the part of it that the limits should allow."""

_STUCK = 0.02
"""Part of the way below which its coordinates are tried one by one."""


class ThroughPort(Block):
    """Reads `<robot>.goal` (16,), a tool pose in base whose z axis is in the port, and `<robot>.encoder`.

    Writes `<robot>.command` (n,). The shaft is the z axis of the tool.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: Limits, p_port: Array) -> None:
        """Start at joint values q (n,), with the shaft in the port p_port (3,) in m in base."""
        self.robot, self.kin, self.limits, self.p_port = robot, kin, limits, p_port
        self._command = f"{robot}.command"
        self._given: tuple[bytes, bytes] = b"", b""
        self.outputs = {self._command: q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make one step towards the goal."""
        goal, q = signals[f"{self.robot}.goal"], signals[f"{self.robot}.encoder"]
        given = goal.tobytes(), q.tobytes()
        if given == self._given:
            return {}
        self._given = given
        low, high = self.limits.steps(q, dt)
        low, high = np.maximum(low, -_NEAR), np.minimum(high, _NEAR)
        dq, part = self._allowed(goal.reshape(4, 4), q, low, high)
        if part == 1.0:
            return {self._command: q + dq}
        T = self.kin.forward(q)
        way = self._way(T, goal.reshape(4, 4))
        step, part = self._along(T, np.zeros(4), way, q, (low, high))
        if part >= _STUCK:
            return {self._command: q + step}
        step, done = np.zeros_like(q), np.zeros(4)
        for alone in np.diag(way):
            further, part = self._along(T, done, alone, q, (low, high))
            if part > 0:
                step, done = further, done + part * alone
        return {self._command: q + step}

    def _along(self, T: Array, done: Array, way: Array, q: Array, steps: tuple[Array, Array]) -> tuple[Array, float]:
        """Return (joint step (n,), part of `way` (4,) that it makes after `done` (4,)); part 0 if the limits stop it."""
        part = 1.0 if np.abs(way).max() > 1e-9 else 0.0
        for _ in range(_TRIES):
            if part <= 0:
                break
            step, allowed = self._allowed(self._at(T, done + part * way), q, *steps)
            if allowed == 1.0:
                return step, part
            part *= allowed
        return np.zeros_like(q), 0.0

    def _allowed(self, T: Array, q: Array, low: Array, high: Array) -> tuple[Array, float]:
        """Return (joint step (n,) to a pose T, part of this step within the limits); 1 if all of it is."""
        *found, misfit = self.kin.program.inverse.one(T.ravel())
        dq = np.asarray(found) - q
        dq -= np.where(self.kin.revolute, 2 * np.pi * np.round(dq / (2 * np.pi)), 0.0)
        if not (np.isfinite(dq).all() and misfit <= POSE_TOL):
            return dq, 0.5
        if (dq >= low).all() and (dq <= high).all():
            return dq, 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.where(dq > high, high / dq, np.where(dq < low, low / dq, 1.0))
        return dq, _SAFE * max(float(parts.min()), 0.0)

    def _way(self, T: Array, goal: Array) -> Array:
        """Return the way (4,) from T to the goal: direction about x and y of the tool in rad, depth in m, roll in rad."""
        a, b = T[:3, 2], goal[:3, 2]
        v = T[:3, :3].T @ np.cross(a, b)
        size = float(np.linalg.norm(v))
        angle = np.arctan2(size, float(a @ b))
        tilt = v[:2] * (angle / size) if size > 1e-15 else v[:2]
        rest = (turned(a, b) @ T[:3, :3]).T @ goal[:3, :3]
        depth = float((goal[:3, 3] - self.p_port) @ b - (T[:3, 3] - self.p_port) @ a)
        return np.array([*tilt, depth, spatial.angle_about_z(rest)])

    def _at(self, T: Array, way: Array) -> Array:
        """Return the pose (4, 4) at the end of a way from T; its shaft is in the port."""
        R = T[:3, :3] @ spatial.exp_so3(np.array([way[0], way[1], 0.0])) @ spatial.rotation_z(way[3])
        depth = float((T[:3, 3] - self.p_port) @ T[:3, 2]) + way[2]
        return spatial.pose(R, self.p_port + depth * R[:, 2])
