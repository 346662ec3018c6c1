"""The pulse that one arm gives to a hand when its jaws grasp an object."""

from __future__ import annotations

import numpy as np

PULSE = 1.0
"""Force in N along +x of {H} of the pulse when the jaws grasp an object, as printed in the paper."""

PULSE_TIME = 3e-3
"""Duration of this pulse in s, as printed in the paper."""

_AGAIN = 0.25
"""Shortest time in s between the end of a grasp and the pulse of the next one; ASSUMED, so that a slipping grip
does not cause several pulses."""


class GraspPulse:
    """Follows what the gripper of one arm holds; an object that it holds all the time causes one pulse."""

    def __init__(self) -> None:
        self._was_holding = False  # in the last tick
        self._ended = -np.inf  # end of the last grasp in s
        self._until = -np.inf  # end of the last pulse in s

    def acts(self, holds: bool, t: float) -> bool:
        """Return whether the pulse acts at time t in s; to be called in each tick, with whether the gripper holds."""
        begins = holds and not self._was_holding
        if begins and t - self._ended > _AGAIN:
            self._until = t + PULSE_TIME - 1e-9
        if self._was_holding and not holds:
            self._ended = t
        self._was_holding = holds
        return t < self._until
