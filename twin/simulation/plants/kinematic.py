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
        self.q = np.array(q, float)
        n = len(self.q)
        self._z, self._follow = limits.follow.bind()
        self._from, self._to = self._z[:n], self._z[n : 2 * n]
        self._command, self._q, self._encoder = (f"{robot}.{n}" for n in ("command", "q", "encoder"))
        self.outputs = self._signals()

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Move the joints towards the command."""
        self._from[...], self._to[...], self._z[-1] = self.q, signals.now[self._command], dt
        q = self._follow()
        if q.tobytes() == self.q.tobytes():
            return {}
        self.q = q
        return self._signals()

    def _signals(self) -> dict[str, Array]:
        return {self._q: self.q, self._encoder: self.q}
