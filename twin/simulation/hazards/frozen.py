"""A frozen signal, such as a stuck pedal or lost packets."""

from __future__ import annotations

from twin.core.spatial import Array
from twin.simulation.world import Hazard


class Frozen(Hazard):
    """Holds the last value before `start` until `stop`, both in s."""

    def __init__(self, signal: str, start: float, stop: float) -> None:
        """Define the frozen signal and the times in s."""
        self.signal, self.start, self.stop = signal, start, stop
        self._kept: Array | None = None

    def change(self, t: float, value: Array) -> Array:
        """Return the value that the other blocks read."""
        if self.start <= t < self.stop and self._kept is not None:
            return self._kept
        self._kept = value
        return value
