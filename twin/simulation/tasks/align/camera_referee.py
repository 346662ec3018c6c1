"""Measure time and camera moves while a person performs the camera task, for the scoreboard of a page.

AlignErr, the angle between line and upper side, is not shown before the end, so that the person relies on the picture.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.simulation.console_scene import PEDALS
from twin.simulation.controllers.pedals import CAMERA
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import CAMERA_AT, CONSOLE_MODE, DEVICE_CAMERA


class CameraReferee(Block):
    """Reads `console.mode`, `pedals.camera` and `<camera>.at` at the end of every sample; it writes no signal.

    Attributes:
        complete: always False, because only the person decides when the camera is aligned.
        moves: number of presses of the camera pedal in which the camera moved.
        time: time in s from the first moment at which the hands control the camera to the last motion of the camera.
    """

    outputs: Mapping[str, ArrayLike] = {}
    complete = False
    ending = ""

    def __init__(self, camera: str, period: float) -> None:
        """Begin with no sample; `camera`: name of the camera's arm, `period`: time in s between two samples."""
        self.period = period
        self.moves = 0
        self.time = 0.0
        self._at_name = CAMERA_AT.of(camera)
        self._last_at: Array | None = None
        self._begin_time: float | None = None
        self._has_moved = False  # in the present press of the camera pedal

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Read the signals at the end of this tick."""
        at = signals.now[self._at_name].copy()
        previous_at = self._last_at
        self._last_at = at
        is_pressed = signals.now[DEVICE_CAMERA.of(PEDALS)].item() > 0.5
        if not is_pressed:
            self._has_moved = False
        if signals.now[CONSOLE_MODE.name].item() != CAMERA:
            return {}
        if self._begin_time is None:
            self._begin_time = t
        if previous_at is not None and not np.array_equal(at, previous_at):
            if not self._has_moved:
                self.moves += 1
            self._has_moved = True
            self.time = t - self._begin_time
        return {}

    def content(self) -> JsonObject:
        """Return the scoreboard as plain data, with the same keys as for the peg board; rings and events are empty."""
        rows = [["Time", f"{self.time:.1f} s"], ["Camera moves", str(self.moves)]]
        text = "Press Camera and drag: bring the grey line onto the upper side of the green plate; then End the task"
        return {"rows": rows, "rings": [], "events": [], "next": text}
