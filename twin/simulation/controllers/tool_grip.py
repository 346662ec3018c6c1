"""Open and close the jaws of a tool, or switch its cautery, by a gripper, without a jump after use of the clutch."""

from __future__ import annotations

from collections.abc import Mapping

from twin.core.spatial import Array
from twin.core.units import DEG
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import HAND_GRIP, ROBOT_FOLLOWS, ROBOT_OPENING, ROBOT_PEDAL

HALF_GRIP = 20 * DEG
"""Angle of a gripper in rad above which it is open: half of its travel."""


class GripToTool(Block):
    """Reads `<hand>.grip` in rad and `<robot>.follows`; writes `<robot>.opening` (0 or 1) and `<robot>.pedal` (0 or 1).

    The jaws are open at the start. While the robot does not follow the hand, the jaws do not move. Afterwards, the
    gripper controls the jaws again only after it has had the same state (open or closed) as the jaws: a gripper that is
    closed at the start must be opened before it can close the jaws. If a person opens the gripper to take control (of
    a gamepad: pulls the trigger), the end of this pull is no command either: otherwise a clip applier would lose its
    clip, and a hook would burn. The pedal is 1 while the gripper is open and controls the jaws; only a tool with energy
    uses the pedal.
    """

    def __init__(self, hand: str, robot: str) -> None:
        """Connect a gripper to a tool."""
        self._grip = HAND_GRIP.of(hand)
        self._follows = ROBOT_FOLLOWS.of(robot)
        self._opening = ROBOT_OPENING.of(robot)
        self._pedal = ROBOT_PEDAL.of(robot)
        self._is_open = True
        self._has_control = False  # whether the gripper controls the jaws
        self._was_closed = False  # whether the gripper was closed since the robot last followed the hand
        self._is_taking_control = False  # whether the gripper was opened before the robot followed, and is still open
        self.outputs = {self._opening: 1.0, self._pedal: 0.0}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Store views of the signals that this block reads."""
        self._read_grip = signals.now[self._grip].item
        self._read_follows = signals.now[self._follows].item
        self._output_opening = memory[self._opening]
        self._output_pedal = memory[self._pedal]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Let the gripper control the jaws."""
        is_open = self._read_grip() > HALF_GRIP
        if self._read_follows() <= 0.5:
            self._has_control = False
            self._was_closed = self._was_closed or not is_open
            self._is_taking_control = self._was_closed and is_open
        elif self._is_taking_control:
            self._is_taking_control = is_open
            self._was_closed = False
        elif self._has_control or is_open is self._is_open:
            self._has_control = True
            self._was_closed = False
            self._is_open = is_open
        self._output_opening[0] = float(self._is_open)
        self._output_pedal[0] = float(self._has_control and self._is_open)
