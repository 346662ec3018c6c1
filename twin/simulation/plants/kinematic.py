"""A robot without dynamics: its joints follow the command within position and speed limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals


class Kinematic(Block):
    """Reads joint commands `<robot>.command` (n,); writes joint values as `<robot>.q` and `<robot>.encoder`.

    The encoder is exact. Controllers read the encoder instead of q, so that a hazard of the encoder affects them.
    """

    def __init__(self, robot: str, q: ArrayLike, limits: Limits) -> None:
        """Start at q (n,) in m or rad."""
        self.robot, self.q, self.limits = robot, np.array(q, float), limits
        self._rests = False
        self.outputs = self._signals()

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Move the joints towards the command."""
        command = signals[f"{self.robot}.command"]
        if self._rests and np.array_equal(command, self.q):
            return {}
        wanted = command - self.q
        lower, upper = self.limits.steps(self.q, dt)
        dq = np.minimum(np.maximum(wanted, lower), upper)
        # a target within the limits is reached exactly, without rounding errors of the difference
        self.q = np.where(dq == wanted, command, self.q + dq)
        self._rests = not dq.any()
        return self._signals()

    def _signals(self) -> dict[str, Array]:
        return {f"{self.robot}.q": self.q, f"{self.robot}.encoder": self.q}
