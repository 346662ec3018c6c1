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

LONGEST_TAP = 0.25
"""Longest duration in s of a quick tap of the clutch (ASSUMED)."""

_ROUNDING = 1e-9
"""Time in s by which a tap may be longer: start and end of a tick are rounded."""


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
        self._pressed_since: float | None = None  # time in s at which the clutch was pressed; infinity: unknown
        self.outputs = {CONSOLE_MODE.name: TOOLS, CONSOLE_TAPS.name: 0.0}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store views of the signals that this block reads."""
        now = signals.now
        self._read_clutch = now[self._clutch].item
        self._read_camera = now[self._camera].item
        self._read_silent = now[self._silent].item if self._silent in now else None
        self._states = [now[ROBOT_PLANNED.of(n)] for n in self._planned]
        self._output_mode = memory[CONSOLE_MODE.name]
        self._output_taps = memory[CONSOLE_TAPS.name]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Read both pedals."""
        is_clutch_down = self._read_clutch() > 0.5
        is_camera_down = self._read_camera() > 0.5
        is_silent = self._read_silent is not None and self._read_silent() > 0.5
        if is_silent:
            self._pressed_since = math.inf if is_clutch_down else None
        elif is_clutch_down:
            if self._pressed_since is None:
                self._pressed_since = t
        elif self._pressed_since is not None:
            # With an unknown start, the difference is minus infinity: no tap.
            if 0 <= t - self._pressed_since <= LONGEST_TAP + _ROUNDING:
                self._taps += 1
            self._pressed_since = None
        if is_clutch_down or is_silent:
            self._output_mode[0] = FREE
        elif is_camera_down and not self._is_camera_at_rest():
            self._output_mode[0] = CAMERA
        else:
            self._output_mode[0] = TOOLS
        self._output_taps[0] = self._taps

    def _is_camera_at_rest(self) -> bool:
        """Return whether a plan keeps the camera at rest."""
        is_at_rest = False
        for state in self._states:
            if state[0] == AIM:
                return False  # the plan's goal is being chosen, and the view may follow it
            is_at_rest = is_at_rest or state[0] >= HELD
        return is_at_rest
