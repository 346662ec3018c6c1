"""Play a planned trajectory as joint commands."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.trajectory import Trajectory
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND


class ProtocolPlayer(Block):
    """Writes `<robot>.command` (n,), the joint values of a trajectory; after its end, the robot is at rest."""

    def __init__(self, robot: str, trajectory: Trajectory) -> None:
        """Start at t = 0."""
        self.command = ROBOT_COMMAND.of(robot)
        self.trajectory = trajectory
        self.outputs = {self.command: trajectory.q[0]}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Write the joint values of the trajectory at t."""
        return {self.command: self.trajectory.joints(np.array([t]))[0]}
