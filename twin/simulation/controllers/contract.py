"""Requirements on any teleoperation controller, tested with an ideal tool."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.teleoperation import Teleoperation

_DISTANCE, _HOLD = 0.03, 4.0
"""Displacement of the handle in the test, in the unit of the handle's coordinates; duration of each step in s."""


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
    out = [np.asarray(tool, float)]
    for x, pressed in zip(handle, pedal, strict=True):
        out.append(out[-1] + controller.dt * controller.step(x, out[-1], bool(pressed)))
    return np.array(out)


def clutch(make: Callable[[], Teleoperation]) -> ClutchReport:
    """Test the clutch: press, release, move the handle by `_DISTANCE`, press again; each step lasts `_HOLD`.

    The controller passes if the tool does not move after the second press.
    """
    controller = make()
    n, ticks = len(controller.offset), round(_HOLD / controller.dt)
    away = np.zeros(n)
    away[0] = _DISTANCE
    phases = ((np.zeros(n), True), (np.zeros(n), False), (away, False), (away, True))
    handle = np.concatenate([np.tile(x, (ticks, 1)) for x, _ in phases])
    pedal = np.concatenate([np.full(ticks, p) for _, p in phases])
    tool = play(controller, handle, pedal, np.zeros(n))
    jump = float(np.linalg.norm(tool[-1] - tool[3 * ticks]))
    return ClutchReport(_DISTANCE, jump, jump <= 1e-9 * _DISTANCE)
