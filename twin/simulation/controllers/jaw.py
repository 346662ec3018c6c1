"""Move a jaw by a gripper, with a calibrated offset, a lower limit, and no jump after use of the clutch.

As in the da Vinci Research Kit, the jaw follows the gripper at up to 720 deg/s. After use of the clutch, the jaw
follows at up to 36 deg/s until it differs from the gripper by less than 2 deg.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.core.spatial import Array
from twin.core.units import DEG
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import HAND_GRIP, ROBOT_FOLLOWS, ROBOT_JAW

GRIPPER_TRAVEL = 60 * DEG
"""Travel of the gripper in rad that moves the jaw from its lower to its upper angle."""

_FAST_RATE = 720 * DEG
_SLOW_RATE = 36 * DEG
"""Largest rates of the jaw in rad/s, in normal use and after use of the clutch."""

_CAUGHT_UP = 2 * DEG
"""Difference between jaw and gripper in rad below which the slow rate ends."""


class Jaw:
    """Control law of the jaw of one arm, tick by tick.

    Attributes:
        angle: current angle of the jaw in rad.
        closed: smallest gripper angle in rad before the gripper first moved the jaw; at this angle, the gripper counts
            as closed.
    """

    def __init__(self, lower: float, upper: float, angle: float, dt: float) -> None:
        """Start at the jaw angle `angle`; the lower limit is `lower`, and an open gripper means `upper`, all in rad."""
        self.lower = lower
        self.upper = upper
        self.angle = angle
        self.dt = dt
        self.closed = math.inf
        self._is_slow = True
        self._has_followed = False

    def step(self, grip: float, follows: bool) -> float:
        """Return the jaw angle in rad after one tick; while the arm does not follow the hand, the jaw is at rest."""
        if not self._has_followed:
            self.closed = min(self.closed, grip)
        if not follows:
            self._is_slow = True
            return self.angle
        self._has_followed = True
        target = max(self.lower, self.lower + (grip - self.closed) * (self.upper - self.lower) / GRIPPER_TRAVEL)
        difference = target - self.angle
        if abs(difference) < _CAUGHT_UP:
            self._is_slow = False
        rate = _SLOW_RATE if self._is_slow else _FAST_RATE
        largest_step = rate * self.dt
        if abs(difference) <= largest_step:
            self.angle = target
        else:
            self.angle += math.copysign(largest_step, difference)
        return self.angle


class GripToJaw(Block):
    """Reads `<hand>.grip` and `<robot>.follows`; writes `<robot>.jaw` in rad."""

    def __init__(self, hand: str, robot: str, jaw: Jaw) -> None:
        """Connect a gripper to a jaw."""
        self.jaw = jaw
        self._grip = HAND_GRIP.of(hand)
        self._follows = ROBOT_FOLLOWS.of(robot)
        self._jaw = ROBOT_JAW.of(robot)
        self.outputs = {self._jaw: jaw.angle}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store views of the signals that this block reads."""
        self._read_grip = signals.now[self._grip].item
        self._read_follows = signals.now[self._follows].item
        self._output_angle = memory[self._jaw]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Move the jaw towards the gripper."""
        self._output_angle[0] = self.jaw.step(self._read_grip(), self._read_follows() > 0.5)
