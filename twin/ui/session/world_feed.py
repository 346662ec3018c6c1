"""Source of deformables for the pages: organs and vessels of a procedure, with vertices computed by the World."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.tissue import Tissue
from twin.simulation.frame import Frame
from twin.simulation.world import World
from twin.ui.session.feed import Surface

_BALL = 2.5 * MM * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""Corners (6, 3), in m from the position of a cell, of the octahedron that marks a cell attached to the organ's bed."""

_FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
"""Indices (8, 3) of the corners of the octahedron's triangles, counter-clockwise as seen from outside."""

_BED = (0.9, 0.75, 0.35)
"""Linear red, green and blue of the octahedra."""


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
        self._world, self._organ, self._bed = world, organ, f"{organ.name}_bed"
        deformables = world().deformables
        self.surfaces = {d.name: Surface(d.mesh.triangles, d.mesh.color_rgba[:3]) for d in deformables}
        marks = np.concatenate([_FACES + len(_BALL) * k for k in range(len(organ.held))])
        self.surfaces[self._bed] = Surface(marks, _BED)
        self._signals, self._shown = [*(d.signal for d in deformables), f"{organ.name}.freed"], b""

    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Return whether a vertex has moved since the last call."""
        now = self._world().signals
        shown = b"".join(now[name].tobytes() for name in self._signals)
        moved, self._shown = shown != self._shown, shown
        return moved

    def at(self, t: float) -> Frame:
        """Return the present vertices as a frame of time `t` in s."""
        world, name = self._world(), self._organ.name
        cells = world.signals[f"{name}.nodes"].reshape(-1, 3)[self._organ.held]
        holds = world.signals[f"{name}.freed"] < 0.5
        marks = cells[:, None] + holds[:, None, None] * _BALL
        return Frame(t, {}, world.fields() | {self._bed: marks.reshape(-1, 3)})
