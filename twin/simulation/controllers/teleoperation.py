"""The mid-level controller of the SHER 3.0 simulation paper: tool rates from handle and pedal, eqs (5) to (7).

The coordinates are those of the robot's equations (SHER: x, y, z in m, psi, theta in rad), each with its own scale. The
paper's Ms is 5x5 although its poses have six degrees of freedom; this file uses as many coordinates as the robot's
equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array, near_coordinates
from twin.kinematics import Kinematics
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import HAND_HANDLE, HAND_PEDAL, ROBOT_ENCODER, ROBOT_RATE

Clutch = Literal["printed", "corrected"]
"""Reading of eq. (7).

"printed": the offset is applied only in the tick of the pedal's rising edge, and the tool jumps one tick later.
"corrected": the offset is applied until the next rising edge.
"""


@dataclass(frozen=True)
class Gains:
    """Gains of the controller, each (n,) or one number for all coordinates.

    The paper prints no values. ASSUMED defaults: scale 0.1 (a tenth of the hand's motion) and proportional gain 5 /s,
    without integral and derivative gain, so that the tool does not overshoot.

    Attributes:
        scale: Ms, tool motion divided by handle motion.
        kp, ki, kd: gains of eq. (5), in 1/s, 1/s^2 and 1.
        limit: maximum rate of the tool, in m/s or rad/s.
    """

    scale: Array | float = 0.1
    kp: Array | float = 5.0
    ki: Array | float = 0.0
    kd: Array | float = 0.0
    limit: Array | float = np.inf


def scales_of(kin: Kinematics, scale: float) -> Array:
    """Return the scale (n,) of each coordinate of a robot's equations: lengths are scaled, angles are not."""
    units = kin.formula.coordinates.units
    scales = np.full(len(units), scale, float)
    for i, unit in enumerate(units):
        if unit == "rad":
            scales[i] = 1.0
    return scales


class Teleoperation:
    """Computes tool rates u from handle positions Xo, tool positions X and the pedal Mp, tick by tick.

    Attributes:
        gains, dt, clutch: as passed to the constructor.
        offset: (n,) Mc, the current clutch compensation.
    """

    def __init__(self, gains: Gains, dt: float, clutch: Clutch = "corrected", coordinates: int = 5) -> None:
        """Set up the controller for poses with `coordinates` numbers, and for ticks of dt in s.

        Raises:
            KinematicsError: dt is not positive, or `clutch` is unknown.
        """
        if not dt > 0:
            raise KinematicsError(f"dt is {dt} s; it must be above 0")
        if clutch not in ("printed", "corrected"):
            raise KinematicsError(f"there is no clutch '{clutch}'; give 'printed' or 'corrected'")
        self.gains = gains
        self.dt = dt
        self.clutch: Clutch = clutch
        self.offset = np.zeros(coordinates)
        self._error_integral = np.zeros(coordinates)
        self._last_error = np.zeros(coordinates)
        self._was_pressed = False

    def rescale(self, scale: Array, handle: Array) -> None:
        """Set the scale (n,); with the offset corrected for the handle at `handle` (n,), the error does not jump.

        The printed eq. (7) has no offset after the rising edge, so that the tool jumps with it.
        """
        self.offset = self.offset + (scale - self.gains.scale) * handle
        self.gains = replace(self.gains, scale=scale)

    def goal(self, handle: Array) -> Array:
        """Return the tool position (n,) at which the error of eq. (6) is zero for the handle at `handle` (n,)."""
        return self.gains.scale * handle - self.offset

    def step(self, handle: Array, tool: Array, pedal: bool) -> Array:
        """Return u (n,), the commanded tool rate in m/s or rad/s; zero while the pedal is up.

        Args:
            handle: (n,) Xo, position of the handle.
            tool: (n,) X, position of the tool.
            pedal: Mp, whether the pedal is pressed.
        """
        g = self.gains
        difference = g.scale * np.asarray(handle, float) - np.asarray(tool, float)
        is_rising = pedal and not self._was_pressed
        if is_rising:
            self.offset = difference  # eq. (7)
        elif self.clutch == "printed":
            self.offset = np.zeros_like(difference)
        self._was_pressed = bool(pedal)
        if not pedal:  # stated in the paper's text only: the output is zero while the pedal is up
            return np.zeros_like(difference)
        e = difference - self.offset  # eq. (6)
        if is_rising:  # without this reset, integral and derivative would cause a jump
            self._error_integral = np.zeros_like(e)
            self._last_error = e
        integral = self._error_integral + e * self.dt
        u = g.kp * e + g.ki * integral + g.kd * (e - self._last_error) / self.dt  # eq. (5)
        bounded = np.clip(u, -np.asarray(g.limit), g.limit)
        # no integrator wind-up while the output is limited
        self._error_integral = np.where(bounded == u, integral, self._error_integral)
        self._last_error = e
        return bounded


class HandToTool(Block):
    """Reads `<device>.handle` (n,), `<device>.pedal`, `<robot>.encoder`; writes the tool rate `<robot>.rate` (n,)."""

    def __init__(
        self, robot: str, device: str, kin: Kinematics, q: Array, law: Teleoperation, scale: str | None = None
    ) -> None:
        """Start at joint values q (n,); the period of this block is `law.dt`.

        `scale`: name of a signal with the scale of the lengths; None: the scale of `law` does not change. Angles are
        never scaled.
        """
        self.robot = robot
        self._scale_signal = scale
        self._is_length = np.array([unit == "m" for unit in kin.formula.coordinates.units])
        self.device = device
        self.kin = kin
        self.law = law
        self.period = law.dt
        self._T_base_tool = kin.forward(q)
        self._tool = kin.program.coordinates_of_pose.one(self._T_base_tool.ravel())
        self.outputs = {ROBOT_RATE.of(robot): np.zeros_like(law.offset)}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Evaluate the control law."""
        self._T_base_tool = self.kin.forward(signals[ROBOT_ENCODER.of(self.robot)], self._T_base_tool)
        tool = self.kin.program.coordinates_of_pose.one(self._T_base_tool.ravel())
        self._tool = near_coordinates(tool, self._tool, ~self._is_length)
        handle = signals[HAND_HANDLE.of(self.device)]
        if self._scale_signal is not None:
            scale = np.where(self._is_length, signals.now[self._scale_signal][0], 1.0)
            if not np.array_equal(scale, self.law.gains.scale):
                self.law.rescale(scale, handle)
        pedal = bool(signals[HAND_PEDAL.of(self.device)][0] > 0.5)
        return {ROBOT_RATE.of(self.robot): self.law.step(handle, self._tool, pedal)}
