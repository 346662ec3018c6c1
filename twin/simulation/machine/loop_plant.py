"""Simulate motors and links of a machine with closed loops: the compiled tick of `motor_plant`, then the loops close.

After a tick, Newton's method closes the loops at the new values of the active joints. Two carriages on one rail that
would come closer than their minimum distance touch instead: they go on with their mean rate, without rebound. If no
state of the passive joints closes the loops, the linkage jams: the joints stay where they are, at rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.motor_plant import MotorPlant, Physics, tick_kernel


class LoopPlant(MotorPlant):
    """Simulates a robot with closed loops that moves under motor torques.

    Attributes:
        jams: number of ticks in which the linkage jammed.
    """

    def __init__(self, arm: Arm, physics: Physics | None = None, gaps: Iterable[tuple[str, str, float]] = ()) -> None:
        """Compile the equations of a robot, or load them from the cache.

        Args:
            arm: the robot with its masses.
            physics: parameters; None: those of the robot's files.
            gaps: (lower joint, upper joint, minimum distance in m) of carriages on one rail.

        Raises:
            MechanismError: a parameter is impossible, or a passive joint cannot be simulated (see `motion`).
            AssemblyError: the loops do not close as drawn.
        """
        self._arm = arm
        self.set(physics or Physics.of(arm))
        self._solver = LoopSolver(arm.mechanism)
        self._step = tick_kernel(arm, self._solver).single()
        self._count = len(arm.mechanism.active)
        names = [joint.name for joint in arm.mechanism.active]
        self._gaps: list[tuple[int, int, float]] = []
        for lower, upper, least in gaps:
            self._gaps.append((names.index(lower), names.index(upper), least))
        self.jams = 0
        self.reset(self._solver.q)

    def another(self, physics: Physics | None = None) -> Self:
        """Return a plant of the same robot, in the posture of the CAD and at rest, without compiling again.

        Raises:
            MechanismError: a parameter is impossible.
        """
        other = super().another(physics)
        other.jams = 0
        other.reset(self._solver.q)
        return other

    def reset(self, q: ArrayLike, qd: ArrayLike = 0.0) -> None:
        """Set joint values (n,) and rates (n,); the loops are closed from the posture of the CAD.

        Raises:
            MechanismError: the loops cannot be closed at q.
        """
        values = np.asarray(q, float)
        found = self._solver.forward_many(values[None])
        if not np.isfinite(found.Ts_base_tool).all():
            raise MechanismError(
                f"{self._arm.mechanism.name}: the loops cannot be closed at q = {np.round(values, 6).tolist()}"
            )
        rates = np.broadcast_to(np.asarray(qd, float), self._count)
        self._state = np.concatenate([values, rates, found.states[0]])

    def advance(self, torques: Array) -> None:
        """Advance by one tick under motor torques (n,) in N m or N."""
        n = self._count
        old = self._state
        moved = self._step(old, torques, self._parameters)
        for lower, upper, least in self._gaps:
            self._touch(moved, lower, upper, least)
        states = self._solver.close(moved[:n], old[2 * n :])
        if states is None:
            self.jams += 1
            moved = np.concatenate([old[:n], np.zeros(n)])
            states = old[2 * n :]
        self._state = np.concatenate([moved, states])

    def _touch(self, moved: Array, lower: int, upper: int, least: float) -> None:
        """Keep two carriages at their minimum distance, if new joint values and rates (2 n,) bring them closer."""
        n = self._count
        overlap = least - (moved[upper] - moved[lower])
        closing = moved[n + lower] - moved[n + upper]
        if not (overlap > 0 and closing > 0):
            return
        moved[lower] -= overlap / 2
        moved[upper] += overlap / 2
        mean = (moved[n + lower] + moved[n + upper]) / 2
        moved[n + lower] = mean
        moved[n + upper] = mean
