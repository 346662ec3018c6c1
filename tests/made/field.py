"""A deformable whose vertices are a given function of time."""

from __future__ import annotations

from collections.abc import Callable

from twin.core.spatial import Array
from twin.model.deformable import Deformable
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import DEFORMABLE_VERTICES


class Field(Block):
    """Writes `<deformable>.vertices`, (3 n,) in m, vertex by vertex, in the frame of the deformable's body."""

    def __init__(self, deformable: Deformable, motion: Callable[[Array, float], Array]) -> None:
        """Store the deformable and `motion`: (vertices at rest (n, 3) in m, time in s) -> vertices (n, 3) in m."""
        self.name = DEFORMABLE_VERTICES.of(deformable.name)
        self.rest = deformable.mesh.vertices
        self.motion = motion
        self.outputs = {self.name: self.rest}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Return the vertices after the tick."""
        return {self.name: self.motion(self.rest, t)}
