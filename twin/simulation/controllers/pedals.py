"""Two pedals select what the hands control: instruments, camera or nothing; a tap on one changes to another arm."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from twin.core.spatial import Array
from twin.simulation.controllers.plan_states import AIM, HELD
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    CONSOLE_TAPS,
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SILENT,
    ROBOT_PLANNED,
)

TOOLS, FREE, CAMERA = 0.0, 1.0, 2.0
"""Values of `console.mode`, for what the hands control: the instruments, nothing (clutch pressed), or the camera."""

TAP = 0.25
"""Longest duration in s of a quick tap of the clutch (ASSUMED)."""


class Pedals(Block):
    """Reads `<device>.clutch` and `<device>.camera`; writes `console.mode` and `console.taps` (number of quick taps).

    The clutch has priority: with both pedals pressed, the hands control nothing. The hands also control nothing while
    the device is silent (its signal `<device>.silent`, if it exists, is 1); silence does not count as a tap.

    With `planned`, this block also reads `<robot>.planned` of the arms in `planned`: while a motion is planned or
    executed, the camera is at rest, because its arm is an obstacle. The camera can move while a hand moves the target.
    """

    def __init__(self, device: str, planned: Sequence[str] = ()) -> None:
        """Connect to the pedals of a device; both pedals start released."""
        self._planned = tuple(planned)
        self._clutch = DEVICE_CLUTCH.of(device)
        self._camera = DEVICE_CAMERA.of(device)
        self._silent = DEVICE_SILENT.of(device)
        self._taps = 0
        self._since: float | None = None  # time in s at which the clutch was pressed; infinity: unknown
        self.outputs = {CONSOLE_MODE.name: TOOLS, CONSOLE_TAPS.name: 0.0}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store views of the signals that this block reads."""
        now = signals.now
        self._clutched = now[self._clutch].item
        self._camera_down = now[self._camera].item
        self._is_silent = now[self._silent].item if self._silent in now else None
        self._states = [now[ROBOT_PLANNED.of(n)] for n in self._planned]
        self._mode = memory[CONSOLE_MODE.name]
        self._count = memory[CONSOLE_TAPS.name]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Read both pedals."""
        clutch = self._clutched() > 0.5
        camera = self._camera_down() > 0.5
        silent = self._is_silent is not None and self._is_silent() > 0.5
        if silent:
            self._since = math.inf if clutch else None
        elif clutch:
            if self._since is None:
                self._since = t
        elif self._since is not None:
            # With an unknown start, the difference is minus infinity: no tap.
            if 0 <= t - self._since <= TAP + 1e-9:
                self._taps += 1
            self._since = None
        if clutch or silent:
            self._mode[0] = FREE
        elif camera and not self._rests():
            self._mode[0] = CAMERA
        else:
            self._mode[0] = TOOLS
        self._count[0] = self._taps

    def _rests(self) -> bool:
        """Return whether a plan keeps the camera at rest."""
        rests = False
        for state in self._states:
            if state[0] == AIM:
                return False  # the plan's goal is being chosen, and the view may follow it
            rests = rests or state[0] >= HELD
        return rests
