"""Machine and model side by side: both get the same packets; what separates them is felt as a cue."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.comparison import Comparison
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine import Machine


class Beside:
    """A machine, and a model of it: a machine with the physics of the robot's files and without faults.

    Attributes:
        machine, model: both.
        compared: both as their encoders measure them.
        force: (3,) force of the cue in base, N; 0 unless both are in PEDAL_DN.
    """

    def __init__(self, machine: Machine, cue: Cue | None = None) -> None:
        """Start at the machine's joint values, in E_STOP; without a cue, one with its default parameters."""
        self.machine = machine
        self.model = Machine(machine.parts, q=machine.plant.q)
        self.compared, self.force = Comparison(machine.parts, cue or Cue(), machine.q), np.zeros(3)

    def start(self) -> None:
        """Press the start button of both."""
        self.machine.start()
        self.model.start()

    def step(self, t: float, packets: Iterable[tuple[bytes, Any]] = ()) -> list[tuple[bytes, Any]]:
        """Run one tick of both at t in s; return the machine's packets to send back."""
        packets = list(packets)
        back = self.machine.step(t, packets)
        self.model.step(t, packets)
        self.compared.step(self.machine.q, self.model.q)
        both = self.machine.level == self.model.level == Level.PEDAL_DN
        self.force = self.compared.force if both else np.zeros(3)
        return back

    @property
    def deviation(self) -> float:
        """Distance of both tips in m."""
        return self.compared.deviation
