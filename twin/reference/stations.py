"""A path of a mechanism with stations (states on the path with closed loops), and bounds of the motion between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.reference.closing import Closing


@dataclass(frozen=True)
class Stations:
    """A path with its stations, and bounds of the motion of each coordinate.

    Attributes:
        path: the path q(s).
        closing: closes the loops of the mechanism.
        s: (k,) values of s at the stations.
        X: (k, nq) configurations at the stations.
        fine: (m,) values of s from 0 to 1 for `moved`.
        moved: (m, nv) in m or rad, upper bound of the path length of each coordinate from s = 0 to each s in `fine`.
    """

    path: Callable[[Array], Array]
    closing: Closing
    s: Array
    X: Array
    fine: Array
    moved: Array

    def at(self, s: Array) -> Array | None:
        """Return configurations (k, nq) of the path at s (k,); None if the loops do not close."""
        q = self.path(s)
        closing = self.closing
        if closing.linear is not None:
            return closing.placed(q)
        i = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        part = (s - self.s[i]) / (self.s[i + 1] - self.s[i])
        guess = closing.between(self.X[i], self.X[i + 1], part)
        X, closed = closing.near(guess, q)
        if not closed.all():
            return None
        return X

    def ahead(self, s: Array, width: float) -> Array:
        """Return upper bounds (k, nv) of each coordinate's motion from s (k,), within width / 2 on either side of s."""
        low = self._moved_until(s - 0.5 * width)
        middle = self._moved_until(s)
        high = self._moved_until(s + 0.5 * width)
        return np.maximum(high - middle, middle - low)

    def _moved_until(self, s: Array) -> Array:
        """Return `moved` (k, nv) at s (k,), interpolated between the values of `fine`."""
        i = np.clip(np.searchsorted(self.fine, s, side="right") - 1, 0, len(self.fine) - 2)
        part = (s - self.fine[i]) / (self.fine[i + 1] - self.fine[i])
        increase = self.moved[i + 1] - self.moved[i]
        return self.moved[i] + part[:, None] * increase
