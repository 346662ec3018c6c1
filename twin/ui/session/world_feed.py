"""The deformables of a World in the pages: organs and vessels of a procedure, as the World has moved them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from twin.core.spatial import Array
from twin.simulation.frame import Frame
from twin.simulation.world import World
from twin.ui.session.feed import Surface


class WorldFeed:
    """A feed whose vertices are those of a World; a new World, after a restart, has the same deformables.

    Attributes:
        surfaces: triangles and colours by name.
        duration: 0, because nothing is played.
        touching: no links, because the World moves its deformables by itself.
    """

    duration = 0.0
    touching: Mapping[str, Sequence[str]] = {}

    def __init__(self, world: Callable[[], World]) -> None:
        """Prepare for the deformables of a World that a function returns."""
        self._world = world
        deformables = world().deformables
        self.surfaces = {d.name: Surface(d.mesh.triangles, d.mesh.color_rgba[:3]) for d in deformables}
        self._signals, self._shown = [d.signal for d in deformables], b""

    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Return whether a vertex has moved since the last call."""
        now = self._world().signals
        shown = b"".join(now[name].tobytes() for name in self._signals)
        moved, self._shown = shown != self._shown, shown
        return moved

    def at(self, t: float) -> Frame:
        """Return the present vertices, at a time in s."""
        return Frame(t, {}, self._world().fields())
