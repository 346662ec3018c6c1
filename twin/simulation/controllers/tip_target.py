"""Move the tip of an instrument to a position in the World, with the shaft through a port."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.simulation.world import Block, Signals

_INSIDE = 10 * MM
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
        self._target, self._goal, self._port = f"{robot}.target", f"{robot}.goal", np.array(port, float)
        self._T_base_world, self._x = spatial.inverse(T_world_base), T_world_tool[:3, 0].copy()
        if (far := float(np.linalg.norm(T_world_tool[:3, 3] - port))) < _INSIDE:
            raise WorldError(
                f"{robot}: its tip is {far / MM:.1f} mm from its port at the start; start it at least "
                f"{_INSIDE / MM:g} mm inside"
            )
        self._last, self._given = self._pose(T_world_tool[:3, 3]), b""
        self.outputs = {self._goal: self._last.ravel()}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Compute the tool pose for the target; ignore a target that is too near to the port or not below the port."""
        p = signals.now[self._target]
        if p.tobytes() != self._given:
            self._given = p.tobytes()
            way = p - self._port
            if way[2] < 0 and np.linalg.norm(way) >= _INSIDE:
                self._last = self._pose(p)
        return {self._goal: self._last.ravel()}

    def _pose(self, p: Array) -> Array:
        z = (p - self._port) / np.linalg.norm(p - self._port)
        x = self._x - z * (z @ self._x)
        x /= np.linalg.norm(x)
        return self._T_base_world @ spatial.pose(np.column_stack([x, np.cross(z, x), z]), p)
