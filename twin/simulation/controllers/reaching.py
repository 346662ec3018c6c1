"""Compute joint values for a commanded tool pose, tick by tick, within joint and speed limits."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.controllers.velocity import Solver, step
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals

_NEAR = 0.05
"""Largest joint step in rad or m per tick for which the closed-form inverse is used.

A larger step may belong to another working mode.
"""


class PoseToJoints(Block):
    """Reads `<robot>.goal` (16,), the tool pose in base, and `<robot>.encoder`; writes `<robot>.command` (n,).

    The closed-form inverse is used if its result is near and within the limits; otherwise a Jacobian step, as far as
    the limits allow. A joint that does not move the tool follows `<robot>.jaw` in rad if this signal exists; otherwise
    it is at rest.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: Limits, solver: Solver = "damped") -> None:
        """Start at joint values q (n,)."""
        self.robot, self.kin, self.limits = robot, kin, limits
        self.solver: Solver = solver
        self._T = kin.forward(q)
        self._given: tuple[bytes, bytes, bytes] | None = None
        self._said: dict[str, Array] = {}
        self.outputs = {f"{robot}.command": q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make one step towards the goal."""
        q, goal = signals[f"{self.robot}.encoder"], signals[f"{self.robot}.goal"].reshape(4, 4)
        jaw = signals[f"{self.robot}.jaw"] if f"{self.robot}.jaw" in signals else q[self.kin.auxiliary]
        given = (q.tobytes(), goal.tobytes(), jaw.tobytes())
        if self.kin.closed_inverse and given == self._given:
            return self._said  # unchanged input: return the previous result
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
        # Comparisons with NaN (no inverse) are false.
        near = (step >= np.maximum(lower, -_NEAR)) & (step <= np.minimum(upper, _NEAR))
        return found if near.all() else None
