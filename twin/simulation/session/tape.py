"""Collect all signals of every tick of a World."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.world import Block, Signals


class Tape(Block):
    """Stores all signals at the end of every tick until `take` is called; it must be the last plant of a World."""

    outputs: Mapping[str, ArrayLike] = {}

    def __init__(self) -> None:
        self._rows: list[Array] = []
        self._width = 0

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Keep the row of this tick."""
        self._rows.append(signals.row.copy())  # the World writes the next tick into the same row
        self._width = len(signals.row)
        return {}

    def take(self) -> Array:
        """Return the rows (k, m) since the last call, and delete them from the tape."""
        rows = self._rows
        self._rows = []
        return np.array(rows, float).reshape(len(rows), self._width)
