"""Requirements on any teleoperation controller, tested with an ideal tool."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array, length
from twin.simulation.controllers.teleoperation import Teleoperation

_DISTANCE = 0.03
"""Displacement of the handle in the test, in the unit of the handle's coordinates."""

_STEP_TIME = 4.0
"""Duration of each step of the test in s."""


@dataclass(frozen=True)
class ClutchReport:
    """Tool motion when the pedal is pressed again after the handle was moved with the pedal up.

    Attributes:
        handle: displacement of the handle while the pedal was up, in the unit of its coordinates.
        jump: distance that the tool moved after the pedal was pressed again, in the unit of `handle`.
        keeps: whether `jump` is at most 1e-9 of `handle`.
    """

    handle: float
    jump: float
    keeps: bool


def play(controller: Teleoperation, handle: Array, pedal: Array, tool: Array) -> Array:
    """Return the positions (k + 1, n) of an ideal tool, first `tool` (n,), for handles (k, n) and pedals (k,)."""
    position = np.asarray(tool, float)
    positions = [position]
    for x, pressed in zip(handle, pedal, strict=True):
        rate = controller.step(x, position, bool(pressed))
        position = position + controller.dt * rate
        positions.append(position)
    return np.array(positions)


def clutch_report(new_controller: Callable[[], Teleoperation]) -> ClutchReport:
    """Test the clutch: press, release, move the handle by `_DISTANCE`, press again; each step lasts `_STEP_TIME`.

    The controller passes if the tool does not move after the second press.
    """
    controller = new_controller()
    n = len(controller.offset)
    ticks = round(_STEP_TIME / controller.dt)
    start = np.zeros(n)
    displaced = np.zeros(n)
    displaced[0] = _DISTANCE
    handle = np.repeat([start, start, displaced, displaced], ticks, axis=0)
    pedal = np.repeat([True, False, False, True], ticks)
    tool = play(controller, handle, pedal, start)
    jump = length(tool[-1] - tool[3 * ticks])
    return ClutchReport(_DISTANCE, jump, jump <= 1e-9 * _DISTANCE)
