"""A kinematic robot: its joints follow the command within limits and rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.limits import Limits
from twin.simulation.world import Block, Signals


class Kinematic(Block):
    """Takes `<robot>.command` (n,), the commanded joints; writes `<robot>.q`, their positions, and `<robot>.encoder`.

    The encoder reads the joints exactly. Controllers use it and not q, so that a hazard of the encoder reaches them.
    """

    def __init__(self, robot: str, q: ArrayLike, limits: Limits) -> None:
        """Start at q (n,) in m or rad."""
        self.robot, self.q, self.limits = robot, np.array(q, float), limits
        self._rests = False
        self.outputs = self._signals()

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Move towards the command."""
        command = signals[f"{self.robot}.command"]
        if self._rests and np.array_equal(command, self.q):
            return {}
        wanted = command - self.q
        lower, upper = self.limits.steps(self.q, dt)
        dq = np.minimum(np.maximum(wanted, lower), upper)
        # an allowed target is reached exactly, without rounding of a difference
        self.q = np.where(dq == wanted, command, self.q + dq)
        self._rests = not dq.any()
        return self._signals()

    def _signals(self) -> dict[str, Array]:
        return {f"{self.robot}.q": self.q, f"{self.robot}.encoder": self.q}
