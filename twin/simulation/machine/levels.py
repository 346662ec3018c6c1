"""Run levels that the PLC allows, and how the control software reads them (as in uw-biorobotics/raven2)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum


class Level(IntEnum):
    """Run levels; the numbers are those that the PLC sends in two bits."""

    E_STOP = 0
    INIT = 1
    PEDAL_UP = 2
    PEDAL_DN = 3


class Plc:
    """The controller of power and brakes, which is independent of the software.

    The PLC goes to E_STOP if the stop button is pressed, or if the software has not changed the watchdog bit for
    `timeout` s. In E_STOP, the start button changes the level to INIT. When the software has initialised the arm, the
    pedal selects PEDAL_UP or PEDAL_DN.

    Attributes:
        level: the level that the PLC allows.
        reason: reason of the last stop; "" after a start.
    """

    def __init__(self, timeout: float) -> None:
        """Start in E_STOP; `timeout`: time-out of the watchdog in s."""
        self.level = Level.E_STOP
        self.reason = "not started"
        self._timeout = timeout
        self._bit = False
        self._changed = 0.0  # time in s of the last change of the watchdog bit

    def start(self, t: float) -> None:
        """Press the start button at t in s."""
        if self.level == Level.E_STOP:
            self.level = Level.INIT
            self.reason = ""
            self._changed = t

    def ready(self) -> None:
        """Allow PEDAL_UP, as after a start with an initialised arm."""
        self.level = Level.PEDAL_UP
        self.reason = ""
        self._changed = float("inf")  # the watchdog waits for the first change of the bit

    def stop(self, reason: str) -> None:
        """Press the stop button."""
        if self.level != Level.E_STOP:
            self.level = Level.E_STOP
            self.reason = reason

    def step(self, t: float, bit: bool, initialised: bool, pedal: bool) -> Level:
        """Return the new level at t in s, from the watchdog bit, `initialised` (the arm) and `pedal` (True: down)."""
        if bit != self._bit:
            self._bit = bit
            self._changed = t
        if self.level != Level.E_STOP and t - self._changed > self._timeout:
            self.stop(f"the watchdog bit has not changed for {self._timeout * 1e3:g} ms")
        if self.level == Level.E_STOP:
            return self.level
        if not initialised:
            self.level = Level.INIT
        elif pedal:
            self.level = Level.PEDAL_DN
        else:
            self.level = Level.PEDAL_UP
        return self.level


class Reader:
    """Reads the run level: the lowest level of all mechanisms, after `cycles` equal readings in succession."""

    def __init__(self, cycles: int) -> None:
        """Start in E_STOP; `cycles`: number of equal readings after which a level counts."""
        self.level = Level.E_STOP
        self._cycles = cycles
        self._read = Level.E_STOP
        self._count = 0

    def hold(self, level: Level) -> None:
        """Set the current level, without waiting for `cycles` readings."""
        self.level = level
        self._read = level
        self._count = self._cycles

    def read(self, levels: Sequence[Level]) -> Level:
        """Return the lowest level if it was the same in the last `cycles` calls, otherwise the previous result."""
        lowest = min(levels)
        if lowest == self._read:
            self._count += 1
        else:
            self._count = 1
        self._read = lowest
        if self._count >= self._cycles:
            self.level = lowest
        return self.level
