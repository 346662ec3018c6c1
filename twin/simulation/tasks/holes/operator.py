"""The simulated operator of a task with holes: the one of `twin operate ROBOT`, with the signals of a console."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.devices.hand import ScriptedHand
from twin.simulation.devices.surgeon_hands import Seat, SimulatedHands
from twin.simulation.world import Signals
from twin.simulation.world.signal_kinds import (
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SCALE,
    HAND_GOAL,
    HAND_GRIP,
    HAND_HANDLE,
    HAND_PEDAL,
    HAND_POSE,
    SURGEON_TARGET,
)


class ScriptedPen(SimulatedHands):
    """Writes `<hand>.handle` (n,) and `<hand>.pedal` of a `ScriptedHand`, and what a report reads of a console.

    `<hand>.pose` (16,) is the handle as a pose in {H}, `<hand>.grip` is 0; the pedal is also `<device>.clutch`.
    """

    def __init__(self, hand: str, operator: ScriptedHand, seat: Seat, R_base_hand: Array, R_start: Array) -> None:
        """Connect an operator to a console.

        Args:
            hand: name of the hand.
            operator: the operator.
            seat: the console.
            R_base_hand: (3, 3) rotation of {H}, the frame of the hands, in the robot's base.
            R_start: (3, 3) rotation of the tool at the start, the attitude of an unrotated handle.
        """
        self.hand = hand
        self.operator = operator
        self.period = operator.period
        self.missed: list[str] = []
        self._kin: Kinematics = operator.kin
        self._device = seat.device
        self._scale = seat.scale
        self._R_base_hand = R_base_hand
        self._R_start = R_start
        handle = operator.outputs[HAND_HANDLE.name]
        self.outputs = self._signals(np.asarray(handle, float), 0.0, -1.0)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last goal."""
        values = self.operator.step(signals, t, dt)
        if self.operator.missed:
            self.missed = [self.operator.missed]
        if values is None:
            return None
        handle = np.asarray(values[HAND_HANDLE.name], float)
        pedal = float(np.asarray(values[HAND_PEDAL.name]))
        goal = float(np.asarray(values[HAND_GOAL.name]))
        return self._signals(handle, pedal, goal)

    def _signals(self, handle: Array, pedal: float, goal: float) -> dict[str, ArrayLike]:
        T = self._kin.program.pose_of_coordinates.one(handle)
        turn = T[:3, :3] @ self._R_start.T
        R_hand_base = self._R_base_hand.T
        pose = spatial.pose(R_hand_base @ turn @ self._R_base_hand, R_hand_base @ T[:3, 3])
        return {
            HAND_HANDLE.of(self.hand): handle,
            HAND_PEDAL.of(self.hand): pedal,
            HAND_POSE.of(self.hand): pose.ravel(),
            HAND_GRIP.of(self.hand): 0.0,
            DEVICE_CLUTCH.of(self._device): pedal,
            DEVICE_CAMERA.of(self._device): 0.0,
            DEVICE_SCALE.of(self._device): self._scale,
            SURGEON_TARGET.name: goal,
        }
