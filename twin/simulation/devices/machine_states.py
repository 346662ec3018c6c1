"""A device that writes the states of a machine as signals, so that a session can be replayed without the machine."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.simulation.machine.state_packets import State
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_DESIRED, ROBOT_MEASURED, ROBOT_RUN

ANSWERS, LEVEL, SEQUENCE, TICK = range(4)
"""Indices in `<robot>.run`: whether the machine answers (0 or 1); run level; numbers of the last packet and tick."""


class MachineStates(Block):
    """Writes the newest state: joint values `<robot>.measured` and `<robot>.desired` (n,), and `<robot>.run` (4,)."""

    def __init__(self, robot: str, q: Array) -> None:
        """Start at joint values q (n,), with a machine that does not answer."""
        self._measured = ROBOT_MEASURED.of(robot)
        self._desired = ROBOT_DESIRED.of(robot)
        self._run = ROBOT_RUN.of(robot)
        self._state: State | None = None
        self.outputs = {self._measured: q, self._desired: q, self._run: np.zeros(4)}

    def give(self, state: State | None) -> None:
        """Set the newest state for the next tick; None: the machine does not answer, and its last state is kept."""
        self._state = state

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike]:
        """Write the newest state."""
        state = self._state
        if state is None:
            # the last values are kept, except that the machine does not answer
            return {self._run: signals[self._run] * (0, 1, 1, 1)}
        run = [1.0, state.level, state.sequence, state.tick]
        return {self._measured: state.q, self._desired: state.wanted, self._run: run}
