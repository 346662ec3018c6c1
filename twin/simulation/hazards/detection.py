"""Detection of faults by the distance between machine and model: a fixed limit, and one that depends on the speed.

A machine whose masses and friction differ from the model's lags behind the model in proportion to the speed, so the
adaptive limit is floor + lead |v|, with v the low-passed speed of the model's tip. Released software checks only the
DAC and joint rates (`twin.simulation.machine.servo`); it has no model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from twin.core.spatial import Array
from twin.simulation.machine.plant import TICK

_SMOOTH = 0.02
"""Time constant in s of the low-pass of the model's speed."""


@dataclass(frozen=True)
class Adaptive:
    """Limit of the distance that grows with the speed of the model's tip.

    Attributes:
        floor: limit at rest in m.
        lead: additional limit per speed, in s.
    """

    floor: float
    lead: float

    def limits(self, tips: Array) -> Array:
        """Return the limit (k,) in m in each tick, for the tips (k, 3) of the model in m."""
        speeds = np.linalg.norm(np.diff(tips, axis=0, prepend=tips[:1]), axis=1) / TICK
        share = TICK / (_SMOOTH + TICK)
        return self.floor + self.lead * np.asarray(lfilter([share], [1, share - 1], speeds))
