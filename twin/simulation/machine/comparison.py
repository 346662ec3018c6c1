"""How far a machine is from its model: tips, their speeds through the software's low-pass, and the force of the cue."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.machine import Parts
from twin.simulation.machine.plant import TICK


class Comparison:
    """Compares joint values of a machine with those of its model.

    Attributes:
        cue: the equation of the force.
        tips: (2, 3) tips of machine and model in base, m.
        speeds: (2, 3) their velocities in m/s, through the low-pass.
        joints: (n,) joint values of the model minus those of the machine, rad or m.
    """

    def __init__(self, parts: Parts, cue: Cue, q: Array) -> None:
        """Begin with both at rest at joint values q (n,)."""
        self.cue, self._forward, self._share = cue, parts.kin.forward, parts.arithmetic.share
        self.rest(q, q)

    def rest(self, machine: Array, model: Array) -> None:
        """Take joint values (n,) of both, at rest."""
        self.tips, self.speeds = self._tips(machine, model), np.zeros((2, 3))
        self.joints = model - machine

    def step(self, machine: Array, model: Array, ticks: int = 1) -> None:
        """Take joint values (n,) of both, a number of ticks after the last ones."""
        before, self.tips = self.tips, self._tips(machine, model)
        share = self._share if ticks == 1 else 1 - (1 - self._share) ** ticks
        self.speeds = self.speeds + share * ((self.tips - before) / (ticks * TICK) - self.speeds)
        self.joints = model - machine

    @property
    def deviation(self) -> float:
        """Distance of both tips in m."""
        return float(np.linalg.norm(self.tips[1] - self.tips[0]))

    @property
    def force(self) -> Array:
        """Force of the cue (3,) in base, N."""
        return self.cue.force(self.tips[1] - self.tips[0], self.speeds[1] - self.speeds[0])

    def _tips(self, machine: Array, model: Array) -> Array:
        return np.array([self._forward(machine)[:3, 3], self._forward(model)[:3, 3]])
