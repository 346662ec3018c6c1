"""Position and speed limits of joints, and the step of one tick that they allow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.evaluator import Evaluator
from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class JointLimits:
    """Joint limits: lower, upper (n,) in m or rad, max_speed (n,) in m/s or rad/s; infinite without a limit."""

    lower: Array
    upper: Array
    max_speed: Array

    @classmethod
    def of(cls, mechanism: Mechanism) -> JointLimits:
        """Return the limits of a mechanism's active joints."""
        low, high = mechanism.limits.T
        max_speed = np.full(len(low), np.inf)
        for i, joint in enumerate(mechanism.active):
            if joint.max_speed:
                max_speed[i] = joint.max_speed
        return cls(low, high, max_speed)

    def steps(self, q: Array, dt: float) -> tuple[Array, Array]:
        """Return the smallest and the largest change (n,) of q (n,) allowed within dt in s.

        A joint outside its limits may only move back towards them.
        """
        lower, upper = self._steps.one(np.append(q, dt))
        return lower, upper

    def steps_of(self, q: ca.SX, dt: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the same two results as `steps`, as expressions for compiled functions."""
        largest_step = ca.DM(self.max_speed) * dt
        lower = ca.fmin(ca.fmax(ca.DM(self.lower) - q, -largest_step), largest_step)
        upper = ca.fmin(ca.fmax(ca.DM(self.upper) - q, -largest_step), largest_step)
        return lower, upper

    @cached_property
    def _steps(self) -> Evaluator:
        n = len(self.lower)
        z = ca.SX.sym("z", n + 1)
        return Evaluator("steps", z, ca.vertcat(*self.steps_of(z[:n], z[n])), (2, n))

    @cached_property
    def follow(self) -> ca.Function:
        """Function (q (n), command (n), dt in s) -> q (n) after dt: equal to the command if the limits allow it."""
        n = len(self.lower)
        q = ca.SX.sym("q", n)
        command = ca.SX.sym("command", n)
        dt = ca.SX.sym("dt")
        lower, upper = self.steps_of(q, dt)
        step_to_command = command - q
        dq = ca.fmin(ca.fmax(step_to_command, lower), upper)
        # A command within the limits is reached without the rounding errors of a difference.
        return ca.Function("follow", [q, command, dt], [ca.if_else(dq == step_to_command, command, q + dq)])
