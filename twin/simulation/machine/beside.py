"""Machine and model side by side: both get the same packets; what separates them is felt as a cue."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine import Machine
from twin.simulation.machine.plant import TICK


class Beside:
    """A machine, and a model of it: a machine with the physics of the robot's files and without faults.

    Attributes:
        machine, model: both.
        cue: the equation of the force.
        tips: (2, 3) tips of machine and model in base, m, as their encoders measure them.
        joints: (n,) joint values of the model minus those of the machine, rad or m.
        force: (3,) force of the cue in base, N; 0 unless both are in PEDAL_DN.
    """

    def __init__(self, machine: Machine, cue: Cue | None = None) -> None:
        """Start at the machine's joint values, in E_STOP; without a cue, one with its default parameters."""
        self.machine, self.cue = machine, cue or Cue()
        self.model = Machine(machine.parts, q=machine.plant.q)
        self.joints, self.force = np.zeros_like(machine.q), np.zeros(3)
        self.tips = self._tips()
        self._speeds = np.zeros((2, 3))

    def start(self) -> None:
        """Press the start button of both."""
        self.machine.start()
        self.model.start()

    def step(self, t: float, packets: Iterable[tuple[bytes, Any]] = ()) -> list[tuple[bytes, Any]]:
        """Run one tick of both at t in s; return the machine's packets to send back."""
        packets = list(packets)
        back = self.machine.step(t, packets)
        self.model.step(t, packets)
        before, self.tips = self.tips, self._tips()
        share = self.machine.parts.arithmetic.share
        self._speeds = self._speeds + share * ((self.tips - before) / TICK - self._speeds)
        self.joints = self.model.q - self.machine.q
        both = self.machine.level == self.model.level == Level.PEDAL_DN
        dp, dv = self.tips[1] - self.tips[0], self._speeds[1] - self._speeds[0]
        self.force = self.cue.force(dp, dv) if both else np.zeros(3)
        return back

    @property
    def deviation(self) -> float:
        """Distance of both tips in m."""
        return float(np.linalg.norm(self.tips[1] - self.tips[0]))

    def _tips(self) -> Array:
        forward = self.machine.parts.kin.forward
        return np.array([forward(self.machine.q)[:3, 3], forward(self.model.q)[:3, 3]])
