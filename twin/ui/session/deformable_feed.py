"""Source of deformables for viewer and headset: surfaces whose vertices are a function of the scene's time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.simulation.frame import WorldFrame


@dataclass(frozen=True, eq=False)
class FieldSurface:
    """Constant data of a deformable: triangles and appearance.

    Attributes:
        triangles: (m, 3) indices of vertices, counter-clockwise as seen from outside; both sides are drawn.
        color: linear red, green and blue, each 0 to 1.
        opacity: 0 (invisible) to 1.
    """

    triangles: np.ndarray
    color: tuple[float, float, float] = (0.85, 0.45, 0.4)
    opacity: float = 1.0


class Feed(Protocol):
    """Source of deformables as a function of time; every call of `at` with the same time must return the same frame.

    Attributes:
        surfaces: surfaces by name, as in `Frame.fields`.
        duration: duration in s.
    """

    @property
    def surfaces(self) -> Mapping[str, FieldSurface]: ...  # noqa: D102
    @property
    def duration(self) -> float: ...  # noqa: D102
    def at(self, t: float) -> WorldFrame: ...  # noqa: D102


@runtime_checkable
class FollowingFeed(Feed, Protocol):
    """Source of deformables that depend on the displayed robots instead of the time.

    Attributes:
        touching: names of the links whose poses `follow` needs, by robot.
    """

    @property
    def touching(self) -> Mapping[str, Sequence[str]]: ...  # noqa: D102
    def follow(self, links: Mapping[str, Mapping[str, Array]], passed: float) -> bool:
        """Update the vertices to the present poses of the links; return whether a vertex has moved.

        Args:
            links: T_world_link (4, 4) by robot and link.
            passed: time in s since the last call.
        """
        ...


def vertices_of(frame: WorldFrame, name: str, surface: FieldSurface) -> Array:
    """Return the vertices (n, 3) of the surface `name` in a `WorldFrame`, in m in the world frame.

    Raises:
        TwinError: the vertices are missing or not finite, or a triangle refers to a vertex that does not exist.
    """
    if name not in frame.fields:
        raise TwinError(f"field '{name}' is missing in the frame at t = {frame.t:g} s")
    vertices = np.asarray(frame.fields[name], float)
    needed = int(np.max(surface.triangles, initial=-1)) + 1
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < needed:
        raise TwinError(
            f"field '{name}': the vertices have the shape {vertices.shape}; the triangles need ({needed}, 3)"
        )
    if not np.isfinite(vertices).all():
        invalid_count = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
        raise TwinError(
            f"field '{name}': {invalid_count} of {len(vertices)} vertices are not finite at t = {frame.t:g} s"
        )
    return vertices
