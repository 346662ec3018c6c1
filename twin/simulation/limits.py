"""Position and speed limits of joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class Limits:
    """Joint limits: lower, upper (n,) in m or rad, max_speed (n,) in m/s or rad/s; infinite without a limit."""

    lower: Array
    upper: Array
    max_speed: Array

    @classmethod
    def of(cls, mechanism: Mechanism) -> Limits:
        """Return the limits of a mechanism's active joints."""
        low, high = mechanism.limits.T
        return cls(low, high, np.array([j.max_speed or np.inf for j in mechanism.active]))

    def steps(self, q: Array, dt: float) -> tuple[Array, Array]:
        """Return the smallest and the largest change (n,) of q (n,) allowed within dt in s.

        A joint outside its limits may only move back towards them.
        """
        reach = self.max_speed * dt  # np.clip is not used: it is much slower for a few numbers
        lower = np.minimum(np.maximum(self.lower - q, -reach), reach)
        return lower, np.minimum(np.maximum(self.upper - q, -reach), reach)
