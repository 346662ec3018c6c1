"""Force on a hand whose tool cannot follow: the limit of the arm acts like a surface, by eq. (5) of the console."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.console import Console, console


class SoftWall:
    """Force law of one hand; the depth in the surface is the distance of the tool from its goal."""

    def __init__(self, laws: Console | None = None) -> None:
        """Begin outside the surface; `laws` are the equations of the console, None: the correct reading."""
        self.laws = laws or console()
        self._depth = 0.0

    def force(self, way: Array, dt: float) -> Array:
        """Return the force (3,) in N on the hand.

        Args:
            way: (3,) vector in m from the tool to its goal, in the frame of the force; zero if the tool can follow.
            dt: time in s since the last call.
        """
        depth = float(np.linalg.norm(way))
        rate, self._depth = (depth - self._depth) / dt, depth
        return np.zeros(3) if depth == 0 else self.laws.force(depth, rate) * np.asarray(way, float) / depth
