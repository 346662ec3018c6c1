"""How far the tip of a machine gets from that of its model while no brake holds it, in a session with a trainee."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.spatial import Array
from twin.simulation.campaigns.traced_run import SETTLED
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_and_model import MachineAndModel

MM_PER_M = 1e3
"""Millimetres in a metre: outcomes of campaigns are in mm."""


class UnbrakedDeviation:
    """Largest distance between the true tips of machine and model while the machine is not braked.

    What is compared with the true tip of the machine depends on the state of the machine:

    | state | compared with |
    |---|---|
    | not yet followed, or restarted and not yet followed again | nothing: the brakes hold the arm |
    | follows (PEDAL_DN) | the true tip of the model |
    | has followed, less than `SETTLED` ticks ago | the tip of the model at that time |
    | later | nothing: the brakes hold the arm |

    After a restart, the tip of the model is displaced by the distance that the tips had when the machine first followed
    again: the restart leaves the two arms at different joint values, which is no consequence of a fault.

    Attributes:
        peak: the distance in mm.
    """

    def __init__(self, pair: MachineAndModel, forward: Callable[[Array], Array]) -> None:
        """Store machine and model; `forward`: T_base_tool (4, 4) of joint values (n,)."""
        self.peak = 0.0
        self._pair = pair
        self._forward = forward
        self._has_followed = False  # since the start or the last restart
        self._ticks_since_following = 0
        self._is_restarted = False  # and has not followed since
        self._model_tip = np.zeros(3)  # when the machine last followed
        self._offset = np.zeros(3)  # tip of the machine minus that of the model, when it first followed after a restart

    def restart(self) -> None:
        """Count the machine as braked until it follows again, then from where it is."""
        self._has_followed = False
        self._is_restarted = True

    def step(self) -> None:
        """Measure the distance after a tick of machine and model."""
        tip = self._forward(self._pair.machine.plant.q)[:3, 3]
        if self._pair.machine.plc.level == Level.PEDAL_DN:
            self._model_tip = self._forward(self._pair.model.plant.q)[:3, 3]
            if self._is_restarted:
                self._offset = tip - self._model_tip
            self._is_restarted = False
            self._has_followed = True
            self._ticks_since_following = 0
        else:
            self._ticks_since_following += 1
        if self._has_followed and self._ticks_since_following < SETTLED:
            distance = float(np.linalg.norm(tip - self._model_tip - self._offset)) * MM_PER_M
            self.peak = max(self.peak, distance)
