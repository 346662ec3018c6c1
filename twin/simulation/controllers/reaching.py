"""Joints for a commanded pose, tick by tick, within joint limits and rates."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.controllers.velocity import Solver, step
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals

_NEAR = 0.05
"""Largest step in rad or m within one tick for which the closed-form inverse is used.

A larger step may lead to another posture.
"""


class PoseToJoints(Block):
    """Reads `<robot>.goal` (16,), pose of the tool in base, and `<robot>.encoder`; writes `<robot>.command` (n,).

    The closed-form inverse is used if it is near and within the limits; else a step by the Jacobian, as far as the
    limits allow. A joint that does not move the tool follows `<robot>.jaw` in rad, if there is such a signal, else it
    is at rest.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: Limits, solver: Solver = "damped") -> None:
        """Start at joints q (n,)."""
        self.robot, self.kin, self.limits = robot, kin, limits
        self.solver: Solver = solver
        self._T = kin.forward(q)
        self._given: tuple[bytes, bytes, bytes] | None = None
        self._said: dict[str, Array] = {}
        self.outputs = {f"{robot}.command": q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Do one step towards the goal."""
        q, goal = signals[f"{self.robot}.encoder"], signals[f"{self.robot}.goal"].reshape(4, 4)
        jaw = signals[f"{self.robot}.jaw"] if f"{self.robot}.jaw" in signals else q[self.kin.auxiliary]
        given = (q.tobytes(), goal.tobytes(), jaw.tobytes())
        if self.kin.closed_inverse and given == self._given:
            return self._said  # the same question has the same answer
        self._given = given
        command = self._closed(q, goal, dt)
        if command is None:
            if not self.kin.closed_forward:
                self._T = self.kin.forward(q, self._T)
            command = step(self.kin, q, goal, dt, self.limits, self.solver, seed=self._T).q
        command[self.kin.auxiliary] = jaw
        self._said = {f"{self.robot}.command": command}
        return self._said

    def _closed(self, q: Array, goal: Array, dt: float) -> Array | None:
        if not self.kin.closed_inverse:
            return None
        found = self.kin.inverse_near(goal, q)
        if found is None:
            return None
        lower, upper = self.limits.steps(q, dt)
        step = found - q
        # Comparisons with NaN, where there is no inverse, are false.
        near = (step >= np.maximum(lower, -_NEAR)) & (step <= np.minimum(upper, _NEAR))
        return found if near.all() else None
