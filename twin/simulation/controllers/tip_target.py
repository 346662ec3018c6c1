"""Move the tip of an instrument to a position in the World, with the shaft through a port."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array, length
from twin.core.units import MM
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_GOAL, ROBOT_TIP_TARGET

_LEAST_DEPTH = 10 * MM
"""Minimum distance in m of the tip from the port; at smaller distances, the shaft has no definite direction."""


class TipTarget(Block):
    """Reads `<robot>.target` (3,), a position in m in the World; writes `<robot>.goal` (16,), the tool pose in base.

    The wrist stays straight, so that the shaft is on the line from the port to the tip. The roll about the shaft
    changes as little as possible from the start.
    """

    def __init__(self, robot: str, T_world_base: Array, port: Array, T_world_tool: Array) -> None:
        """Start at the tool pose T_world_tool (4, 4); `port` (3,) is the position of the port in m in the World.

        Raises:
            WorldError: the tip is too near to the port at the start.
        """
        self._target = ROBOT_TIP_TARGET.of(robot)
        self._goal = ROBOT_GOAL.of(robot)
        self._port = np.array(port, float)
        self._T_base_world = spatial.inverse(T_world_base)
        self._x_start = T_world_tool[:3, 0].copy()
        distance = length(T_world_tool[:3, 3] - port)
        if distance < _LEAST_DEPTH:
            raise WorldError(
                f"{robot}: its tip is {distance / MM:.1f} mm from its port at the start; start it at least "
                f"{_LEAST_DEPTH / MM:g} mm inside"
            )
        self._last_goal = self._pose(T_world_tool[:3, 3])
        self._last_target = b""
        self.outputs = {self._goal: self._last_goal.ravel()}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Compute the tool pose for the target; ignore a target that is too near to the port or not below the port."""
        p = signals.now[self._target]
        if p.tobytes() != self._last_target:  # a new target; comparing bytes is faster than comparing arrays
            self._last_target = p.tobytes()
            from_port = p - self._port
            if from_port[2] < 0 and length(from_port) >= _LEAST_DEPTH:
                self._last_goal = self._pose(p)
        return {self._goal: self._last_goal.ravel()}

    def _pose(self, target: Array) -> Array:
        """Return the tool pose (4, 4) in base for a target (3,) in m in the World."""
        from_port = target - self._port
        z = from_port / length(from_port)
        x = self._x_start - z * (z @ self._x_start)  # the part of the first x axis across the shaft
        x /= length(x)
        R_world_tool = np.column_stack([x, np.cross(z, x), z])
        return self._T_base_world @ spatial.pose(R_world_tool, target)
