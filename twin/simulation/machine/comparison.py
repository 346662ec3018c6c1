"""Compare a machine with its model: deviation of the tips, their filtered velocities, and the force of the cue."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array, length
from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK


class MachineComparison:
    """Compares joint values of a machine with those of its model.

    Attributes:
        cue: computes the haptic force on the hand of the operator from the difference between the tips; see `Cue`.
        tips: (2, 3) positions of the tip of the machine and the tip of the model in base in m.
        speeds: (2, 3) velocities of both tips in m/s, after the low-pass filter of the control software.
        joints: (n,) joint values of the model minus those of the machine, rad or m.
    """

    def __init__(self, parts: Parts, cue: Cue, q: Array) -> None:
        """Start with machine and model at rest at joint values q (n,)."""
        self.cue = cue
        self._forward = parts.kin.forward
        self._has_loops = bool(parts.arm.mechanism.loops)
        self._last_poses: list[Array | None] = [None, None]  # of both tools, from which loops are closed
        self._share = parts.arithmetic.share
        self.rest(q, q)

    def rest(self, machine: Array, model: Array) -> None:
        """Set the joint values (n,) of machine and model, at rest."""
        self.tips = self._tips(machine, model)
        self.speeds = np.zeros((2, 3))
        self.joints = model - machine

    def step(self, machine: Array, model: Array, ticks: int = 1) -> None:
        """Update the joint values (n,) of machine and model, `ticks` ticks after the previous update."""
        previous = self.tips
        self.tips = self._tips(machine, model)
        share = self._share
        if ticks != 1:
            share = 1 - (1 - share) ** ticks  # `ticks` steps of the filter at a constant velocity
        velocities = (self.tips - previous) / (ticks * TICK)
        self.speeds = self.speeds + share * (velocities - self.speeds)
        self.joints = model - machine

    @property
    def deviation(self) -> float:
        """Distance in m between the tips of machine and model."""
        return length(self.tips[1] - self.tips[0])

    @property
    def force(self) -> Array:
        """Force of the cue (3,) in N in base."""
        return self.cue.force(self.tips[1] - self.tips[0], self.speeds[1] - self.speeds[0])

    def _tips(self, machine: Array, model: Array) -> Array:
        """Return the tips (2, 3) in m in base, at joint values (n,) of machine and model."""
        tips = []
        for i, q in enumerate((machine, model)):
            if self._has_loops:
                T = self._forward(q, self._last_poses[i])
                self._last_poses[i] = T
            else:
                T = self._forward(q)
            tips.append(T[:3, 3])
        return np.array(tips)
