"""Packets for a machine whose increments follow a goal smoothly: a critically damped filter with speed limits.

In each tick of duration h, the rate v of the filter at the distance d from the goal becomes

    v' = (v + h w^2 d) / (1 + h w)^2      with the natural frequency w = `_FREQUENCY` (implicit Euler method)

within limits of rate and acceleration. The positions of the filter are sent as increments in whole micrometres; what is
rounded off is sent with later packets.
"""

from __future__ import annotations

import math

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import UM
from twin.simulation.controllers.trainer_states import TrainerLimits

_FREQUENCY = 40.0
"""Natural frequency in rad/s of the filter that follows the goal (ASSUMED)."""

_LARGEST_JAW_STEP = 2.0
"""Largest increment of the jaws in one packet, in steps of the machine (ASSUMED)."""


class PacketSmoother:
    """Computes packets whose increments add up to a motion that follows a goal smoothly.

    Attributes:
        sent: (4, 4) pose after all increments sent so far.
    """

    def __init__(self, limits: TrainerLimits, jaw_step: float, dt: float) -> None:
        """Prepare for packets every dt s, in which one unit of jaw motion opens the jaws by `jaw_step` in rad."""
        self._limits = limits
        self._jaw_step = jaw_step
        self._dt = dt
        self.begin(np.eye(4), 0.0)

    def set_limits(self, limits: TrainerLimits) -> None:
        """Use other limits of the speeds from the next packet on."""
        self._limits = limits

    def begin(self, T: Array, jaw: float) -> None:
        """Start at rest at a pose (4, 4) of the tool and an opening of the jaws in rad."""
        self.sent = T.copy()
        self._position = T[:3, 3].copy()
        self._rate = np.zeros(3)
        self._turn_rate = np.zeros(3)
        self._opening = jaw

    @property
    def opening(self) -> float:
        """Opening of the jaws in rad after all increments sent so far."""
        return self._opening

    def values(self, goal: Array, jaw: float) -> Array:
        """Return the values (9,) of the next packet, with the pedal down, to a goal (4, 4) and a jaw opening in rad."""
        dt = self._dt
        self._rate = _next_rate(self._rate, goal[:3, 3] - self._position, self._limits.speed, dt)
        self._position = self._position + dt * self._rate
        # The rounded rest is sent with later packets, because `sent` has only what was sent.
        steps = np.round((self._position - self.sent[:3, 3]) / UM)
        rotation = _rotation_vector(goal[:3, :3] @ self.sent[:3, :3].T)
        self._turn_rate = _next_rate(self._turn_rate, rotation, self._limits.turn, dt)
        wx, wy, wz = (dt * self._turn_rate).tolist()
        half_angle = 0.5 * math.hypot(wx, wy, wz)
        vector_per_rotation = 0.5  # limit of sin(half) / (2 half)
        if half_angle > 0:
            vector_per_rotation = 0.5 * math.sin(half_angle) / half_angle
        quat_wxyz = [math.cos(half_angle), vector_per_rotation * wx, vector_per_rotation * wy, vector_per_rotation * wz]
        self.sent[:3, 3] += UM * steps
        if half_angle > 0:
            self.sent[:3, :3] = spatial.matrix_from_quat_wxyz(quat_wxyz) @ self.sent[:3, :3]
        jaw_steps = min(max(round((jaw - self._opening) / self._jaw_step), -_LARGEST_JAW_STEP), _LARGEST_JAW_STEP)
        self._opening += self._jaw_step * jaw_steps
        return np.array([*steps, *quat_wxyz, jaw_steps, 1.0])


def _rotation_vector(R: Array) -> Array:
    """Return the rotation vector (3,) of a rotation; faster than `spatial.log_so3` for angles below 30 deg."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = math.hypot(*v.tolist())
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if sine > 0.5 or trace < 1:
        return spatial.log_so3(R)
    if sine == 0:
        return v
    return v * (math.asin(sine) / sine)


def _next_rate(v: Array, displacement: Array, largest: float, dt: float) -> Array:
    """Return the rate (at most `largest`) of a critically damped filter after one tick; `displacement`: what remains.

    The acceleration is limited to `_FREQUENCY` * `largest` / e. This limit does not delay a stop, because the filter
    needs no larger acceleration to stop at a goal from the rate `largest`. Without the limit, a jump of the goal would
    start the arm so suddenly that the speed of its tip exceeds `largest`.
    """
    next_v = (v + dt * _FREQUENCY**2 * displacement) / (1 + dt * _FREQUENCY) ** 2  # implicit Euler method
    change = _limited(next_v - v, dt * _FREQUENCY * largest / math.e)
    return _limited(v + change, largest)


def _limited(v: Array, largest: float) -> Array:
    """Return a vector (3,), shortened to the length `largest` if it is longer."""
    size = math.hypot(*v.tolist())
    return v * (largest / size) if size > largest else v
