"""The scripted hand of an operator: it leads the tool in a circle, scaled down, by packets of whole micrometres."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.simulation.machine.itp import pack
from twin.simulation.machine.plant import TICK
from twin.simulation.machine.settings import Settings

_SPEED = 0.06
"""Speed of the hand in m/s. ASSUMED."""

_RADIAN = 0.2
"""Time in s for one radian of the circle. ASSUMED."""

_MICRO = 1e-6


class Hand:
    """Makes one packet a tick; what is rounded in one packet is sent in the next."""

    def __init__(self, settings: Settings, scale: float) -> None:
        """Define the machine's side of the network, and the motion scale from hand to tool."""
        self._arm, self._version = settings.arm, settings.packet_version
        self._step, self._angle = _SPEED * scale * TICK / _MICRO, 0.0
        self._asked, self._sent = np.zeros(3), np.zeros(3)

    def packet(self, sequence: int, pace: float = 1.0, pedal: bool = True) -> bytes:
        """Return the next packet; `pace` 1 is the normal speed, and the hand stands while the pedal is up."""
        pace = pace if pedal else 0.0
        self._angle += pace * TICK / _RADIAN
        self._asked += pace * self._step * np.array([np.cos(self._angle), np.sin(self._angle), 0.0])
        step: Array = np.round(self._asked - self._sent)
        self._sent += step
        return pack(sequence, self._arm, np.array([*step, 1, 0, 0, 0, 0, float(pedal)]), self._version)
