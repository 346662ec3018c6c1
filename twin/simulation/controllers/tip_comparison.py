"""Compare two joint configurations of one arm: by the positions of its tip, and by the angles that turn its tool."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array, length
from twin.kinematics import Kinematics


class TipComparison:
    """Compares two joint configurations of one arm by the positions of its tip."""

    def __init__(self, kin: Kinematics, is_angle: Array) -> None:
        """Prepare for an arm with the equations `kin`; `is_angle` (n,): whether each joint value is an angle."""
        self._kin = kin
        self._turns_tool = np.asarray(is_angle, bool) & ~kin.auxiliary
        self._auxiliary = np.flatnonzero(kin.auxiliary)[:1]

    def apart(self, q: Array, q_other: Array) -> float:
        """Return the distance in m between the tips at the joint values q and `q_other` (n,)."""
        return length(self.tip(q) - self.tip(q_other))

    def tip(self, q: Array) -> Array:
        """Return the position of the tip (3,) in m in base."""
        return self._kin.forward(q)[:3, 3]

    def turned(self, q: Array, q_other: Array) -> float:
        """Return the largest difference in rad between q and `q_other` (n,) among the joints that turn the tool."""
        return float(np.abs(q - q_other)[self._turns_tool].max(initial=0.0))

    def opening(self, q: Array) -> float:
        """Return the opening of the jaws in rad; 0 without jaws."""
        return float(q[self._auxiliary].sum())
