"""A snapshot of a World: poses of all links, vertices of deformables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.core.spatial import Array


@dataclass(frozen=True)
class Frame:
    """Poses and vertices at one time, in the World frame.

    Attributes:
        t: time in s.
        link_poses: T_world_link (4, 4), by name of the robot, prop or movable object, then by name of the link. The
            only link of a movable object has the name of the object.
        fields: vertices (n, 3) in m, by name of the deformable.
    """

    t: float
    link_poses: Mapping[str, Mapping[str, Array]]
    fields: Mapping[str, Array]
