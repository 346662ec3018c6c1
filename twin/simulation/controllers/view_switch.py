"""Switch what the viewer draws as a solid, the machine or its model, by a tap of the camera pedal."""

from __future__ import annotations

from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import CONSOLE_VIEW, DEVICE_CAMERA

VIEW = CONSOLE_VIEW.name
"""Signal that selects what the viewer draws as a solid: the machine (0) or its model (1)."""

_ROUNDING = 1e-9
"""Time in s by which a tap may be longer: start and end of a tick are rounded."""


class ViewSwitch(Block):
    """Reads `<device>.camera`; writes `console.view`, which a quick tap of the camera pedal changes."""

    def __init__(self, device: str, tap: float) -> None:
        """Connect to a device; `tap`: longest duration of a quick tap in s."""
        self._camera = DEVICE_CAMERA.of(device)
        self._tap = tap
        self._view = 0.0
        self._pressed_since: float | None = None  # time in s at which the pedal was pressed
        self.outputs = {VIEW: 0.0}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, float]:
        """Read the pedal."""
        if signals.now[self._camera].item() > 0.5:
            if self._pressed_since is None:
                self._pressed_since = t
        elif self._pressed_since is not None:
            if t - self._pressed_since <= self._tap + _ROUNDING:
                self._view = 1.0 - self._view
            self._pressed_since = None
        return {VIEW: self._view}
