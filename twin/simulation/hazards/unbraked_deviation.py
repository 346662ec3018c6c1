"""How far the tip of a machine gets from that of its model while no brake holds it, in a session with a trainee."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.spatial import Array
from twin.simulation.hazards.traced_run import SETTLED
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_and_model import MachineAndModel

_MM = 1e3


class UnbrakedDeviation:
    """Largest distance between the true tips of machine and model while the machine is not braked.

    Attributes:
        peak: the distance in mm.
    """

    def __init__(self, pair: MachineAndModel, forward: Callable[[Array], Array]) -> None:
        """Store machine and model; `forward`: T_base_tool (4, 4) of joint values (n,)."""
        self.peak = 0.0
        self._pair = pair
        self._forward = forward
        # Before the machine has followed once, it counts as braked.
        self._ticks = SETTLED  # since the machine followed
        self._model_tip = np.zeros(3)
        self._restarted = False
        # Tip of the machine minus that of the model, when the arm began to follow after a restart.
        self._offset = np.zeros(3)

    def restart(self) -> None:
        """Count the machine as braked until it follows again, then from where it is."""
        self._ticks = SETTLED
        self._restarted = True

    def step(self) -> None:
        """Measure the distance after a tick of machine and model."""
        tip = self._forward(self._pair.machine.plant.q)[:3, 3]
        if self._pair.machine.plc.level == Level.PEDAL_DN:
            self._model_tip = self._forward(self._pair.model.plant.q)[:3, 3]
            if self._restarted:
                self._offset = tip - self._model_tip
            self._restarted = False
            self._ticks = 0
        self._ticks += 1
        if self._ticks <= SETTLED:
            distance = float(np.linalg.norm(tip - self._model_tip - self._offset)) * _MM
            self.peak = max(self.peak, distance)
