"""Simulate motors and links of a machine: compute the joint state from motor torques, in ticks that are compiled once.

`tick_kernel` has the equations and the method. `cable_plant` is the same with cables that stretch, and `loop_plant` for
mechanisms with closed loops.
"""

from __future__ import annotations

from copy import copy
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.tick_kernel import tick_kernel


class MotorPlant:
    """Simulates a robot that moves under motor torques.

    Attributes:
        q, qd: (n,) joint values in rad or m, and rates.
        physics: parameters; change them with `set`.
        jams: number of ticks in which a linkage with closed loops jammed (see `loop_plant`).
    """

    jams = 0

    def __init__(self, arm: Arm, physics: Physics | None = None) -> None:
        """Compile the equations of a robot, or load them from the cache.

        Raises:
            MechanismError: the mechanism has loops (see `loop_plant`), or a parameter is impossible.
        """
        if arm.mechanism.loops:
            raise MechanismError(f"{arm.mechanism.name} has loops: use a LoopPlant")
        self._arm = arm
        self.set(physics or Physics.of(arm))
        self._step = tick_kernel(arm).single()
        self._count = len(arm.mechanism.active)
        self._state = np.zeros(2 * self._count)

    def another(self, physics: Physics | None = None) -> Self:
        """Return a plant of the same robot (and cables), at joint values 0 and at rest, without compiling again.

        Raises:
            MechanismError: a parameter is impossible.
        """
        plant = copy(self)
        plant._state = np.zeros_like(self._state)
        plant.set(physics or self.physics)
        return plant

    @property
    def q(self) -> Array:
        """Joint values (n,) of the links."""
        return self._state[: self._count]

    @property
    def qd(self) -> Array:
        """Rates (n,) of the links."""
        return self._state[self._count : 2 * self._count]

    @property
    def encoded(self) -> Array:
        """Joint values (n,) that the encoders of the motors measure: without cables, those of the joints."""
        return self.q

    def set(self, physics: Physics) -> None:
        """Use other parameters from the next tick on.

        Raises:
            MechanismError: a parameter is impossible.
        """
        self._parameters = physics.checked(self._arm)
        self.physics = physics

    def reset(self, q: ArrayLike, qd: ArrayLike = 0.0) -> None:
        """Set joint values (n,) and rates (n,)."""
        rates = np.broadcast_to(np.asarray(qd, float), self._count)
        self._state = np.concatenate([np.asarray(q, float), rates])

    def advance(self, torques: Array) -> None:
        """Advance by one tick under motor torques (n,) in N m or N."""
        self._state = self._step(self._state, torques, self._parameters)
