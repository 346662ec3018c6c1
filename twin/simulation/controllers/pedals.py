"""Two pedals that select instruments, camera or nothing for the hands; a quick tap of the clutch changes the arm."""

from __future__ import annotations

import math

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

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, float | Array]:
        """Read both pedals."""
        now = signals.now
        clutch, camera = now[self._clutch].item() > 0.5, now[self._camera].item() > 0.5
        silent = self._silent in now and now[self._silent].item() > 0.5
        if silent:
            self._since = math.inf if clutch else None
        elif clutch:
            self._since = t if self._since is None else self._since
        elif self._since is not None:
            self._taps += 0 <= t - self._since <= self.tap + 1e-9
            self._since = None
        return {
            "console.mode": FREE if clutch or silent else CAMERA if camera else TOOLS,
            "console.taps": float(self._taps),
        }
