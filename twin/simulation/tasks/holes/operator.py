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
        handle = operator.outputs["hand.handle"]
        self.outputs = self._signals(np.asarray(handle, float), 0.0, -1.0)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last goal."""
        values = self.operator.step(signals, t, dt)
        if self.operator.missed:
            self.missed = [self.operator.missed]
        if values is None:
            return None
        handle = np.asarray(values["hand.handle"], float)
        pedal = float(np.asarray(values["hand.pedal"]))
        goal = float(np.asarray(values["hand.goal"]))
        return self._signals(handle, pedal, goal)

    def _signals(self, handle: Array, pedal: float, goal: float) -> dict[str, ArrayLike]:
        T = self._kin.program.pose_of_coordinates.one(handle)
        turn = T[:3, :3] @ self._R_start.T
        R_hand_base = self._R_base_hand.T
        pose = spatial.pose(R_hand_base @ turn @ self._R_base_hand, R_hand_base @ T[:3, 3])
        return {
            f"{self.hand}.handle": handle,
            f"{self.hand}.pedal": pedal,
            f"{self.hand}.pose": pose.ravel(),
            f"{self.hand}.grip": 0.0,
            f"{self._device}.clutch": pedal,
            f"{self._device}.camera": 0.0,
            f"{self._device}.scale": self._scale,
            "surgeon.target": goal,
        }
