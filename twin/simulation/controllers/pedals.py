"""Two pedals that select instruments, camera or nothing for the hands; a quick tap of the clutch changes the arm."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.core.spatial import Array
from twin.simulation.world import Block, Signals

TOOLS, FREE, CAMERA = 0.0, 1.0, 2.0
"""Values of `console.mode`: the hands control the instruments; nothing (clutch); the camera."""

TAP = 0.25
"""Longest duration in s of a quick tap of the clutch (ASSUMED)."""


class Pedals(Block):
    """Reads `<device>.clutch` and `<device>.camera`; writes `console.mode` and `console.taps` (number of quick taps).

    The clutch has priority: with both pedals pressed, the hands control nothing. The hands also control nothing while
    the device is silent (its signal `<device>.silent`, if it exists, is 1); silence does not count as a tap.
    """

    def __init__(self, device: str, tap: float = TAP) -> None:
        """Connect to the pedals of a device; both pedals start released."""
        self.tap = tap
        self._clutch, self._camera, self._silent = (f"{device}.{n}" for n in ("clutch", "camera", "silent"))
        self._taps = 0
        self._since: float | None = None  # time in s at which the clutch was pressed; infinity: unknown
        self.outputs = {"console.mode": TOOLS, "console.taps": 0.0}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Keep views of the signals."""
        now = signals.now
        self._clutched, self._camera_down = now[self._clutch].item, now[self._camera].item
        self._is_silent = now[self._silent].item if self._silent in now else None
        self._mode, self._count = memory["console.mode"], memory["console.taps"]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Read both pedals."""
        clutch, camera = self._clutched() > 0.5, self._camera_down() > 0.5
        silent = self._is_silent is not None and self._is_silent() > 0.5
        if silent:
            self._since = math.inf if clutch else None
        elif clutch:
            self._since = t if self._since is None else self._since
        elif self._since is not None:
            self._taps += 0 <= t - self._since <= self.tap + 1e-9
            self._since = None
        self._mode[0] = FREE if clutch or silent else CAMERA if camera else TOOLS
        self._count[0] = self._taps
