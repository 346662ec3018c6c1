"""Compute joint values for a commanded tool pose, tick by tick, within joint and speed limits."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.flow import Evaluator
from twin.kinematics import Kinematics
from twin.kinematics.compiled import POSE_TOL
from twin.simulation.controllers.velocity import Solver, step
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals

_NEAR = 0.05
"""Largest joint step in rad or m per tick for which the closed-form inverse is used.

A larger step may belong to another working mode.
"""


class PoseToJoints(Block):
    """Reads `<robot>.goal` (16,), the tool pose in base, and `<robot>.encoder`; writes `<robot>.command` (n,).

    The closed-form inverse is used if its result is within the limits and near the current joint values. Otherwise, a
    Jacobian step is made as far as the limits allow. A joint that does not move the tool follows `<robot>.jaw` in rad;
    without this signal, the joint is at rest.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: Limits, solver: Solver = "damped") -> None:
        """Start at joint values q (n,)."""
        self.robot, self.kin, self.limits = robot, kin, limits
        self.solver: Solver = solver
        self._T = kin.forward(q)
        self._encoder, self._goal, self._jaw = (f"{robot}.{n}" for n in ("encoder", "goal", "jaw"))
        self._command, self._auxiliary = f"{robot}.command", np.flatnonzero(kin.auxiliary)
        self._z, self._near = _near_inverse(kin, limits).bind() if kin.closed_inverse else (np.zeros(17 + len(q)), None)
        self._given: tuple[bytes, bytes] | None = None
        self._said: dict[str, Array] = {}
        self.outputs = {self._command: q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make one step towards the goal."""
        z, now = self._z, signals.now
        q, goal = now[self._encoder], now[self._goal]
        jaw = now[self._jaw] if self._jaw in now else q[self._auxiliary]
        z[:16], z[16:-1], z[-1] = goal, q, dt
        command = self._near() if self._near else None
        if command is not None and not math.isnan(command[0]):
            self._given = None
        else:
            given = (z.tobytes(), jaw.tobytes())
            if self._near and given == self._given:
                return self._said  # unchanged input: return the previous result
            self._given = given
            if not self.kin.closed_forward:
                self._T = self.kin.forward(q, self._T)
            command = step(self.kin, q, goal.reshape(4, 4), dt, self.limits, self.solver, seed=self._T).q
        command[self._auxiliary] = jaw
        self._said = {self._command: command}
        return self._said


def _near_inverse(kin: Kinematics, limits: Limits) -> Evaluator:
    """Return the function (pose (16), q (n), dt in s) -> q (n) by the closed-form inverse, with angles nearest to q.

    All results are NaN if the pose is not rigid or out of reach, or if a joint step exceeds a limit or `_NEAR`.
    Auxiliary joints keep their values.
    """
    n = len(kin.joints)
    z = ca.SX.sym("z", 16 + n + 1)
    q, dt = z[16 : 16 + n], z[16 + n]
    inverse = kin.program.inverse.function(z[:16])
    found, misfit = inverse[:n], inverse[n]
    turns = ca.DM(np.where(kin.revolute, 1 / (2 * np.pi), 0.0))
    found -= 2 * np.pi * ca.floor((found - q) * turns + 0.5)
    found = ca.if_else(ca.DM(kin.auxiliary.astype(float)), q, found)
    lower, upper = limits.steps_of(q, dt)
    step = found - q
    # Comparisons with NaN (no inverse) are false.
    above, below = step >= ca.fmax(lower, -_NEAR), step <= ca.fmin(upper, _NEAR)
    near = ca.logic_and(ca.mmin(ca.vertcat(above, below)), misfit <= POSE_TOL)
    return Evaluator("near_inverse", z, ca.if_else(near, found, np.nan))
