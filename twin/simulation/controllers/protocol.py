"""Playback of a planned protocol."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.trajectory import Trajectory
from twin.simulation.world import Block, Signals


class ProtocolPlayer(Block):
    """Writes `<robot>.command` (n,), the joints of a trajectory at the tick's time; at its end the robot rests."""

    def __init__(self, robot: str, trajectory: Trajectory) -> None:
        """Start at t = 0."""
        self.command, self.trajectory = f"{robot}.command", trajectory
        self.outputs = {self.command: trajectory.q[0]}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Return the joints of the trajectory at t."""
        return {self.command: self.trajectory.joints(np.array([t]))[0]}
