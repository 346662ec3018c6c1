"""A temporary offset: an encoder that miscounts, a converter that jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Hazard


class Spike(Hazard):
    """Adds `by` (n,) or a number to a signal from `start` until `stop`, both in s."""

    def __init__(self, signal: str, start: float, stop: float, by: ArrayLike) -> None:
        """Disturb a signal."""
        self.signal, self.start, self.stop, self.by = signal, start, stop, np.asarray(by, float)

    def change(self, t: float, value: Array) -> Array:
        """Return the value that is read instead."""
        return value + self.by if self.start <= t < self.stop else value
