"""Simulate motors and links of a machine with closed loops: a compiled tick (`tick_kernel`), then the loops close.

After a tick, Newton's method closes the loops at the new values of the active joints. Two carriages on one rail that
would come closer than their minimum distance touch instead: they go on with their mean rate, without rebound; at a hard
stop, both stop. The linkage jams if no state of the passive joints closes the loops, or if the state is so near a
singularity, or so far from the previous one, that the platform could change to another assembly: then the joints stay
where they are, at rest.
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
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.tick_kernel import tick_kernel

JAM_MARGIN = 0.02
"""Margin of the loops (see `ClosedStates`) down to which the linkage moves (ASSUMED); 0 is a singularity."""

LARGEST_STEP = 0.02
"""Maximum change in a tick of a joint value in m or rad, and of a number of a ball joint's quaternion (ASSUMED)."""

_CONTACT_PASSES = 64
"""Maximum number of passes over the carriages of all rails until all keep their distances."""

_CONTACT_TOLERANCE = 1e-12
"""Difference in m up to which two carriages count as touching."""


class LoopPlant(MotorPlant):
    """Simulates a robot with closed loops that moves under motor torques."""

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
        for lower, upper, minimum in gaps:
            self._gaps.append((names.index(lower), names.index(upper), minimum))
        self.jams = 0
        self.reset(self._solver.q)

    def another(self, physics: Physics | None = None) -> Self:
        """Return a plant of the same robot, in the posture of the CAD and at rest, without compiling again.

        Raises:
            MechanismError: a parameter is impossible.
        """
        plant = super().another(physics)
        plant.jams = 0
        plant.reset(self._solver.q)
        return plant

    def reset(self, q: ArrayLike, qd: ArrayLike = 0.0) -> None:
        """Set joint values (n,) and rates (n,); the loops are closed from the posture of the CAD.

        Raises:
            MechanismError: the loops cannot be closed at q, or the linkage would jam there.
        """
        values = np.asarray(q, float)
        solved = self._solver.forward_many(values[None])
        if not np.isfinite(solved.Ts_base_tool).all():
            raise MechanismError(
                f"{self._arm.mechanism.name}: the loops cannot be closed at q = {np.round(values, 6).tolist()}"
            )
        if not solved.margin[0] > JAM_MARGIN:
            raise MechanismError(
                f"{self._arm.mechanism.name}: q = {np.round(values, 6).tolist()} is at a singularity of the loops: "
                f"their margin is {solved.margin[0]:.3g}, and must be above {JAM_MARGIN:g}"
            )
        rates = np.broadcast_to(np.asarray(qd, float), self._count)
        self._state = np.concatenate([values, rates, solved.states[0]])

    def advance(self, torques: Array) -> None:
        """Advance by one tick under motor torques (n,) in N m or N.

        Raises:
            MechanismError: a torque, or a rate after the tick, is not finite; the state has not changed.
        """
        count = self._count
        old = self._state
        new_state = self._step(old, torques, self._parameters)
        if not np.isfinite(new_state).all():
            raise MechanismError(
                f"{self._arm.mechanism.name}: the rates after a tick are not finite, with motor torques "
                f"{np.asarray(torques).tolist()}; give finite torques that the masses of the robot can take"
            )
        states = None
        if self._keep_apart(new_state, old):
            states = self._solver.close(new_state[:count], old[2 * count :], JAM_MARGIN)
        if states is None or not self._is_near(np.concatenate([new_state[:count], states]), old):
            self.jams += 1
            new_state = np.concatenate([old[:count], np.zeros(count)])
            states = old[2 * count :]
        self._state = np.concatenate([new_state, states])

    def _is_near(self, values: Array, old: Array) -> bool:
        """Return whether values of all active joints, then of the passive ones, can follow those of the `old` state."""
        n = self._count
        before = np.concatenate([old[:n], old[2 * n :]])
        return bool(np.abs(values - before).max() <= LARGEST_STEP)

    def _keep_apart(self, new_state: Array, old: Array) -> bool:
        """Keep the distances of the carriages in new joint values and rates (2 n,); return whether all are kept.

        Carriages that were too close in the `old` state may stay so, but come no closer.
        """
        gaps = []
        for lower, upper, minimum in self._gaps:
            distance_before = old[upper] - old[lower]
            if distance_before < minimum - _CONTACT_TOLERANCE:
                gaps.append((lower, upper, distance_before))
            else:
                gaps.append((lower, upper, minimum))
        # a contact may push a carriage against the next one on its rail: repeat until nothing touches
        for _ in range(_CONTACT_PASSES):
            any_touched = False
            for gap in gaps:
                if self._separate(new_state, *gap):
                    any_touched = True
            if not any_touched:
                return True
        for lower, upper, minimum in gaps:
            if not new_state[upper] - new_state[lower] >= minimum - _CONTACT_TOLERANCE:
                return False
        return True

    def _separate(self, new_state: Array, lower: int, upper: int, minimum: float) -> bool:
        """Move two carriages apart, and let them touch, if they come closer than a minimum distance in m.

        Args:
            new_state: (2 n,) joint values and rates, which this function changes.
            lower: index of the joint of the lower carriage.
            upper: index of the joint of the upper carriage.
            minimum: their minimum distance in m.

        Returns:
            Whether they touched.
        """
        count = self._count
        overlap = minimum - (new_state[upper] - new_state[lower])
        if not overlap > _CONTACT_TOLERANCE:
            return False
        low = self.physics.stops[0][lower]
        high = self.physics.stops[1][upper]
        # A carriage at its hard stop does not yield; then the other one moves back alone, and both are at rest.
        space_below = max(new_state[lower] - low, 0.0)
        space_above = max(high - new_state[upper], 0.0)
        down = min(overlap / 2, space_below)
        up = min(overlap - down, space_above)
        down = min(overlap - up, space_below)
        new_state[lower] -= down
        new_state[upper] += up
        rate = (new_state[count + lower] + new_state[count + upper]) / 2
        if down < overlap / 2 or up < overlap / 2:
            rate = 0.0
        if new_state[count + lower] >= new_state[count + upper]:  # else they already move apart
            new_state[count + lower] = rate
            new_state[count + upper] = rate
        return True
