"""Simulated hand of an operator: sends a motion, multiplied by the motion scale, in steps of whole micrometres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.spatial import Array
from twin.core.units import UM
from twin.simulation.machine.itp import pack
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.settings import Settings

_CIRCLE_RADIUS = 0.012
"""Radius of the circle in m. ASSUMED."""

_TIME_PER_RADIAN = 0.2
"""Time in s for one radian of the circle, so that the speed is 60 mm/s. ASSUMED."""

_WANDER_AMPLITUDE = 0.06
"""Largest coordinate in m of the sines of the random motion of the hand; see `wander`. ASSUMED."""

_WANDER_HERTZ = (0.05, 0.4)
"""Range in Hz of the frequencies of these sines. ASSUMED."""

Motion = Callable[[float], Array]
"""Function from the time in s to the position (3,) of the hand in m; the position at time 0 is 0."""


def circle(t: float) -> Array:
    """Return the position (3,) in m, at t in s, of a hand that moves in a circle at 60 mm/s."""
    angle = t / _TIME_PER_RADIAN
    return _CIRCLE_RADIUS * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])


def wander(seed: int) -> Motion:
    """Return a random motion of the hand: each coordinate in m is a sum of three sines of 0.05 to 0.4 Hz."""
    rng = np.random.default_rng(seed)
    angular_rates = 2 * np.pi * rng.uniform(*_WANDER_HERTZ, (3, 3))
    phases = rng.uniform(0, 2 * np.pi, (3, 3))

    def motion(t: float) -> Array:
        # minus the sines at time 0, so that the motion begins at 0
        sines = np.sin(angular_rates * t + phases) - np.sin(phases)
        return _WANDER_AMPLITUDE / 3 * sines.sum(axis=1)

    return motion


class Hand:
    """Creates one packet per tick; the rounding error of a packet is added to the next one.

    A hand remembers how far it has moved: each run of a machine needs a new one.
    """

    def __init__(self, settings: Settings, scale: float, motion: Motion = circle) -> None:
        """Store the machine's settings; `scale`: tool motion divided by hand motion, `motion`: motion of the hand."""
        self._arm = settings.arm
        self._version = settings.packet_version
        self._scale = scale
        self._motion = motion
        self._hand_time = 0.0  # in s; it stops while the pedal is up
        self._sent_position = np.zeros(3)  # sum of all increments, in µm

    def packet(self, sequence: int, pace: float = 1.0, pedal: bool = True) -> bytes:
        """Return the next packet; `pace` multiplies the speed of the hand, which is at rest while the pedal is up."""
        if pedal:
            self._hand_time += pace * TICK
        position = self._scale / UM * self._motion(self._hand_time)
        # A packet has whole micrometres; the rest stays in the difference to what was sent.
        step = np.round(position - self._sent_position)
        self._sent_position += step
        no_rotation = (1, 0, 0, 0)
        grasp = 0
        values = np.array([*step, *no_rotation, grasp, float(pedal)])
        return pack(sequence, self._arm, values, self._version)
