"""The mid-level controller of the SHER 3.0 simulation paper: handle and pedal to rates of the tool, eqs (5)-(7).

Coordinates are whatever the robot's equations use (SHER: x, y, z in m, psi, theta in rad), one scale for each.
The paper's Ms is 5x5 while its poses have six freedoms; so it is read here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array

Clutch = Literal["printed", "corrected"]
"""Eq. (7). printed: the offset counts at the tick of the pedal's rising edge alone, and the tool jumps one tick
later. corrected: it is kept until the next rising edge."""


@dataclass(frozen=True)
class Gains:
    """Gains, each (n,) or a number for all coordinates.

    No value is printed. ASSUMED defaults: scale 0.1 (a tenth of the hand's motion), 5 /s without integral and
    derivative, so that nothing overshoots.

    Attributes:
        scale: Ms, tool motion for each handle motion.
        kp, ki, kd: of eq. (5), in 1/s, 1/s^2 and 1.
        limit: largest rate that may be asked of the tool, in m/s or rad/s.
    """

    scale: Array | float = 0.1
    kp: Array | float = 5.0
    ki: Array | float = 0.0
    kd: Array | float = 0.0
    limit: Array | float = np.inf


class Teleoperation:
    """Turns handle positions Xo, tool positions X and the pedal Mp into tool rates u, tick by tick.

    Attributes:
        gains, dt, clutch: as given.
        offset: (n,) Mc, the clutch compensation in use.
    """

    def __init__(self, gains: Gains, dt: float, clutch: Clutch = "corrected", coordinates: int = 5) -> None:
        """Set up for `coordinates` coordinates and ticks of dt in s.

        Raises:
            KinematicsError: dt is not positive, or the clutch is unknown.
        """
        if not dt > 0:
            raise KinematicsError(f"dt is {dt} s; it must be above 0")
        if clutch not in ("printed", "corrected"):
            raise KinematicsError(f"there is no clutch '{clutch}': printed or corrected")
        self.gains, self.dt, self.clutch = gains, dt, clutch
        self.offset = np.zeros(coordinates)
        self._sum, self._last = np.zeros(coordinates), np.zeros(coordinates)
        self._pressed = False

    def step(self, handle: Array, tool: Array, pedal: bool) -> Array:
        """Return u (n,), the rate asked of the tool, in m/s or rad/s; zero while the pedal is up.

        Args:
            handle: Xo (n,) position of the handle.
            tool: X (n,) position of the tool.
            pedal: Mp, whether the pedal is pressed.
        """
        g = self.gains
        apart = g.scale * np.asarray(handle, float) - np.asarray(tool, float)
        rising = pedal and not self._pressed
        if rising:
            self.offset = apart  # eq. (7)
        elif self.clutch == "printed":
            self.offset = np.zeros_like(apart)
        self._pressed = bool(pedal)
        if not pedal:  # in words only: the pedal gates the output
            return np.zeros_like(apart)
        e = apart - self.offset  # eq. (6)
        if rising:  # else integral and derivative would kick
            self._sum, self._last = np.zeros_like(e), e
        total = self._sum + e * self.dt
        u = g.kp * e + g.ki * total + g.kd * (e - self._last) / self.dt  # eq. (5)
        bounded = np.clip(u, -np.asarray(g.limit), g.limit)
        self._sum = np.where(bounded == u, total, self._sum)  # no wind-up while the output is held
        self._last = e
        return bounded
