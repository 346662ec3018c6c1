"""A robot without dynamics: its joints follow the command within position and speed limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twin.core.spatial import Array
from twin.formula.evaluator import attach
from twin.simulation.limits import JointLimits
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND, ROBOT_ENCODER, ROBOT_Q


class Kinematic(Block):
    """Reads joint commands `<robot>.command` (n,); writes joint values as `<robot>.q` and `<robot>.encoder`.

    The encoder is exact. Controllers read the encoder instead of q; therefore a hazard of the encoder affects the
    controllers.
    """

    def __init__(self, robot: str, q: ArrayLike, limits: JointLimits) -> None:
        """Start at joint values q (n,) in m or rad."""
        self.q = np.array(q, float)
        self._tick_duration = np.zeros(1)
        self._command_signal = ROBOT_COMMAND.of(robot)
        self._q_signal = ROBOT_Q.of(robot)
        self._encoder_signal = ROBOT_ENCODER.of(robot)
        self._limits = limits
        self.outputs = {self._q_signal: self.q.copy(), self._encoder_signal: self.q.copy()}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Compile the step, which reads the command directly from the memory of its signal."""
        self._next_q, self._compute = attach(
            self._limits.follow, self.q, signals.now[self._command_signal], self._tick_duration
        )
        self._output_memory = memory[self._q_signal], memory[self._encoder_signal]

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Move the joints towards the command."""
        self._tick_duration[0] = dt
        self._compute()
        q, encoder = self._output_memory
        self.q[...] = self._next_q
        q[...] = self._next_q
        encoder[...] = self._next_q
