"""Run a machine and its model on the same packets; their deviation causes the cue, a force on the operator's hand."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.comparison import MachineComparison
from twin.simulation.machine.levels import Level
from twin.simulation.machine.receiver import Sender
from twin.simulation.machine.simulated_machine import Machine


class MachineAndModel:
    """Runs a machine and its model; the model has the physics of the robot's files, and no faults.

    Attributes:
        machine, model: the machine and its model.
        compared: comparison of the joint values that the encoders of machine and model measure.
        force: (3,) force of the cue in N in base; 0 unless machine and model are in PEDAL_DN.
    """

    def __init__(self, machine: Machine, cue: Cue | None = None) -> None:
        """Create the model at the machine's joint values, in E_STOP; `cue`: force law; None: the default `Cue`."""
        self.machine = machine
        self.model = Machine(machine.parts, q=machine.plant.q)
        self.compared = MachineComparison(machine.parts, cue or Cue(), machine.q)
        self.force = np.zeros(3)

    def start(self) -> None:
        """Press the start buttons of machine and model."""
        self.machine.start()
        self.model.start()

    def step(self, t: float, packets: Iterable[tuple[bytes, Sender]] = ()) -> list[tuple[bytes, Sender]]:
        """Run one tick of machine and model at t in s; return the packets that the machine sends back."""
        packets = list(packets)
        answers = self.machine.step(t, packets)
        self.model.step(t, packets)
        self.compared.step(self.machine.q, self.model.q)
        self.force = np.zeros(3)
        if self.machine.level == self.model.level == Level.PEDAL_DN:
            self.force = self.compared.force
        return answers

    @property
    def deviation(self) -> float:
        """Distance in m between the tips of machine and model."""
        return self.compared.deviation
