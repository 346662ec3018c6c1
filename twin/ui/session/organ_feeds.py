"""The soft organs of a scene in the pages, deformed by the displayed robots, or in a procedure by the World."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body
from twin.model.tissue import Tissue
from twin.simulation.console_scene import ORGANS
from twin.simulation.frame import WorldFrame
from twin.simulation.plants.tissue import Organs, Tool
from twin.simulation.world import World
from twin.simulation.world.signal_kinds import ORGAN_FREED, ORGAN_NODES
from twin.ui.session.deformable_feed import FieldSurface

_MAX_STEPS = 2
"""Maximum number of steps of the organs for each picture. Two steps make up for one late picture; more steps would make
the next picture late, too. On a slower page, the organs lag behind the links."""

_FAR_POSE = spatial.pose(p=np.array([0.0, 0.0, 100.0]))
"""Pose of the links before the first picture, far from the organs. A link that is inside an organ in the first picture
thus counts as having jumped into the organ; the link touches the organ only after it has been outside."""

_OCTAHEDRON = 2.5 * MM * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""Corners (6, 3), in m from the position of a cell, of the octahedron that marks a cell attached to the organ's bed."""

_OCTAHEDRON_FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
"""Indices (8, 3) of the corners of the octahedron's triangles, counter-clockwise as seen from outside."""

_BED_COLOR = (0.9, 0.75, 0.35)
"""Linear red, green and blue of the octahedra."""


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
        self.surfaces: dict[str, FieldSurface] = {}
        self._fields: dict[str, Array] = {}
        for tissue in tissues:
            self.surfaces[tissue.name] = FieldSurface(tissue.surface.triangles, tissue.color_rgba[:3])
            self._fields[tissue.name] = tissue.surface.vertices
        self.touching: dict[str, tuple[str, ...]] = {}
        tools = []
        for robot, bodies in links.items():
            self.touching[robot] = tuple(body.name for body in bodies)
            for body in bodies:
                tools.append(Tool(robot, body))
        self.organs = Organs(tissues, tools, [_FAR_POSE] * len(tools), ORGANS)
        self._due_steps = 0.0
        self._is_first = True

    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Deform the organs by the links that touch them; return whether an organ has moved.

        `links` contains T_world_link (4, 4) by robot and link, at least for the links in `touching`; `passed` is the
        time in s since the last call.
        """
        poses = [links[tool.robot][tool.body.name] for tool in self.organs.tools]
        self._due_steps = min(self._due_steps + passed / ORGANS, float(_MAX_STEPS))
        steps = int(self._due_steps + 1e-9)  # a whole number of steps may be a rounding error too small
        if self._is_first:
            steps = max(steps, 1)
            self._is_first = False
        self._due_steps = max(self._due_steps - steps, 0.0)
        has_moved = False
        for _ in range(steps):
            has_moved |= self.organs.step(poses)
        if has_moved:
            self._fields = {name: self.organs.vertices(name) for name in self.surfaces}
        return has_moved

    def at(self, t: float) -> WorldFrame:
        """Return the present vertices as a frame of time `t` in s."""
        return WorldFrame(t, {}, self._fields)


class WorldFeed:
    """Source of the deformables of a World; the World of a new attempt must have the same deformables.

    The surface `<organ>_bed` has an octahedron at each cell of an organ that is still attached to the organ's bed.

    Attributes:
        surfaces: triangles and colours by name.
        duration: 0, because no protocol is played.
        touching: empty, because the World itself computes which links touch the deformables.
    """

    duration = 0.0
    touching: Mapping[str, Sequence[str]] = {}

    def __init__(self, world: Callable[[], World], organ: Tissue) -> None:
        """Read the deformables of the World that `world` returns; mark the attached cells of `organ`."""
        self._world = world
        self._organ = organ
        self._bed = f"{organ.name}_bed"
        self.surfaces: dict[str, FieldSurface] = {}
        self._signals: list[str] = []
        for deformable in world().deformables:
            mesh = deformable.mesh
            self.surfaces[deformable.name] = FieldSurface(mesh.triangles, mesh.color_rgba[:3])
            self._signals.append(deformable.signal)
        self._signals.append(ORGAN_FREED.of(organ.name))
        marks = [_OCTAHEDRON_FACES + len(_OCTAHEDRON) * cell for cell in range(len(organ.pinned_nodes))]
        self.surfaces[self._bed] = FieldSurface(np.concatenate(marks), _BED_COLOR)
        self._shown_state = b""

    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Return whether a vertex has moved since the last call."""
        signals = self._world().signals
        values = b"".join(signals[name].tobytes() for name in self._signals)
        has_moved = values != self._shown_state
        self._shown_state = values
        return has_moved

    def at(self, t: float) -> WorldFrame:
        """Return the present vertices as a frame of time `t` in s."""
        world = self._world()
        name = self._organ.name
        nodes = world.signals[ORGAN_NODES.of(name)].reshape(-1, 3)
        cells = nodes[self._organ.pinned_nodes]
        attached = world.signals[ORGAN_FREED.of(name)] < 0.5
        # The octahedron of a cell that is free shrinks to a point: the triangles of a surface never change.
        marks = cells[:, None] + attached[:, None, None] * _OCTAHEDRON
        return WorldFrame(t, {}, world.fields() | {self._bed: marks.reshape(-1, 3)})
