"""The soft organs of a scene in the pages, deformed by the displayed robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.body import Body
from twin.model.tissue import Tissue
from twin.simulation.console_scene import ORGANS
from twin.simulation.frame import Frame
from twin.simulation.plants.tissue import Organs, Tool
from twin.ui.session.feed import Surface

_BEHIND = 2
"""Maximum number of steps of the organs for each picture. Two steps make up for one late picture; more steps would make
the next picture late, too. On a slower page, the organs lag behind the links."""

_AWAY = spatial.pose(p=np.array([0.0, 0.0, 100.0]))
"""Pose of the links before the first picture, far from the organs. A link that is inside an organ in the first picture
thus counts as having jumped into the organ; the link touches the organ only after it has been outside."""


class OrganFeed:
    """Source of the vertices of organs; the vertices do not depend on time, but move when links touch the organs.

    Attributes:
        surfaces: triangles and colours by organ.
        duration: 0, because organs have no protocol.
        touching: names of the links that can touch organs, by robot.
    """

    duration = 0.0

    def __init__(self, tissues: Sequence[Tissue], links: Mapping[str, Sequence[Body]]) -> None:
        """Build the organs; `links`: bodies that can touch the organs, by robot."""
        self.surfaces = {t.name: Surface(t.surface.triangles, t.color_rgba[:3]) for t in tissues}
        self.touching = {robot: tuple(b.name for b in bodies) for robot, bodies in links.items()}
        tools = [Tool(robot, body) for robot, bodies in links.items() for body in bodies]
        self.organs = Organs(tissues, tools, [_AWAY] * len(tools), ORGANS)
        self._left, self._first = 0.0, True
        self._fields = {t.name: t.surface.vertices for t in tissues}

    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Deform the organs by the links that touch them; return whether an organ has moved.

        `links` contains T_world_link (4, 4) by robot and link, at least for the links in `touching`; `passed` is the
        time in s since the last call.
        """
        poses = [links[tool.robot][tool.body.name] for tool in self.organs.tools]
        self._left = min(self._left + passed / ORGANS, float(_BEHIND))
        steps, self._first = max(int(self._left + 1e-9), int(self._first)), False
        self._left = max(self._left - steps, 0.0)
        moved = False
        for _ in range(steps):
            moved |= self.organs.step(poses)
        if moved:
            self._fields = {name: self.organs.vertices(name) for name in self.surfaces}
        return moved

    def at(self, t: float) -> Frame:
        """Return the present vertices as a frame of time `t` in s."""
        return Frame(t, {}, self._fields)
