"""Detection of faults by the distance between machine and model: a limit that grows with the speed.

If masses and friction of the machine differ from those of the model, the machine lags behind the model in proportion to
the speed. Therefore, the adaptive limit is floor + lead |v|, where |v| is the low-passed speed of the model's tip.
Released software has no model; it checks only the DAC and joint rates (`twin.simulation.machine.servo`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from twin.core.spatial import Array
from twin.simulation.machine.physics import TICK

_SPEED_TIME_CONSTANT = 0.02
"""Time constant in s of the low-pass of the model's speed."""


@dataclass(frozen=True)
class AdaptiveLimit:
    """Limit of the distance that grows with the speed of the model's tip.

    Attributes:
        floor: limit at rest in m.
        lead: increase of the limit in m per m/s of tip speed, that is, in s.
    """

    floor: float
    lead: float

    def limits(self, tips: Array) -> Array:
        """Return the limit (k,) in m in each tick, for the tips (k, 3) of the model in m."""
        # prepended, so that there is a speed for each tick; the first one is 0
        steps = np.diff(tips, axis=0, prepend=tips[:1])
        speeds = np.linalg.norm(steps, axis=1) / TICK
        # first-order low-pass: each tick adds this share of the difference
        share = TICK / (_SPEED_TIME_CONSTANT + TICK)
        smooth_speeds = np.asarray(lfilter([share], [1, share - 1], speeds))
        return self.floor + self.lead * smooth_speeds
