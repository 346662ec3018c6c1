"""A temporary offset of a signal, such as an encoder that miscounts or a jump of a converter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Hazard


class Spike(Hazard):
    """Adds `by`, (n,) or one number, to a signal from `start` until `stop`, both in s."""

    def __init__(self, signal: str, start: float, stop: float, by: ArrayLike) -> None:
        """Define the disturbed signal, the times in s and the offset."""
        self.signal, self.start, self.stop, self.by = signal, start, stop, np.asarray(by, float)

    def change(self, t: float, value: Array) -> Array:
        """Return the value that the other blocks read."""
        return value + self.by if self.start <= t < self.stop else value
