"""A person's way through the holes of the eye phantom, for tests: where the tip is to go next, by looking at it."""

from __future__ import annotations

import numpy as np

from twin.api.scene_parts import members_of, robots_at
from twin.simulation import console_scene, rate_console
from twin.simulation.setup import Setup
from twin.simulation.tasks.holes.geometry import hole_goals

NEAR = 0.12e-3
"""Distance in m from a point at which the next point follows."""


class Way:
    """Points before, in and before each hole; `missing` is the way to the next point, in {H}."""

    def __init__(self, scene):
        members = members_of(robots_at(console_scene.led_by(scene)))
        setup = Setup(scene, members, scene.tasks["phantom"])
        self.kin = members["sher"].kin
        self.goals = hole_goals(setup, scene.tasks["phantom"])
        self.T_world_base = setup.places["sher"].T_world_base
        self.R_world_hand = rate_console.fixed_view(setup, scene.console)[:3, :3]
        self.points = [p for hole in self.goals.holes for p in (hole.before, hole.bottom, hole.before)]
        self._T = None

    def tip(self, q):
        """Return the tip (3,) in m in the World at joint values q (n,)."""
        self._T = self.kin.forward(np.asarray(q, float), self._T)
        return (self.T_world_base @ self._T @ self.goals.T_tool_tip)[:3, 3]

    def missing(self, q):
        """Return the way (3,) in m in {H} from the tip to the next point; None: all points were reached."""
        while self.points:
            way = self.points[0] - self.tip(q)
            if np.linalg.norm(way) > NEAR:
                return self.R_world_hand.T @ way
            self.points.pop(0)
        return None
