"""A snapshot of a World: poses of all links, vertices of deformables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.core.spatial import Array


@dataclass(frozen=True)
class WorldFrame:
    """Poses and vertices at one time, in the World frame.

    Attributes:
        t: time in s.
        link_poses: {name of a robot, prop or movable object: {link: T_world_link (4, 4)}}. The only link of a movable
            object has the name of the object.
        fields: {name of a deformable: vertices (n, 3) in m}.
    """

    t: float
    link_poses: Mapping[str, Mapping[str, Array]]
    fields: Mapping[str, Array]
