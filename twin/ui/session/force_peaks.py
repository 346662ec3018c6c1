"""Store the largest force on each hand between two displayed frames, because a force pulse can be shorter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.core.spatial import Array
from twin.simulation.world import Block, Signals


class ForcePeaks(Block):
    """Block of a World, without outputs: stores the largest `<hand>.force` (3,) in N since the last call of `take`."""

    def __init__(self, hands: Sequence[str]) -> None:
        """Watch the forces on the hands with these names."""
        self.outputs = {}
        self._names = {hand: f"{hand}.force" for hand in hands}
        self._peaks = {hand: np.zeros(3) for hand in hands}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Update the largest forces with the forces of this tick."""
        for hand, name in self._names.items():
            force, peak = signals.now[name], self._peaks[hand]
            if force @ force > peak @ peak:
                self._peaks[hand] = force.copy()
        return {}

    def take(self) -> dict[str, Array]:
        """Return, for each hand, the largest force (3,) in N since the last call, in {H}, the axes of the picture."""
        taken, self._peaks = self._peaks, {hand: np.zeros(3) for hand in self._peaks}
        return taken
