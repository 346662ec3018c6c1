"""Link poses of several robots as parts of a scene's frame, with quaternions whose signs do not jump."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.ui.headset import protocol as wire


class Posed:
    """Robots by name, each with its links in order.

    Attributes:
        bodies: names of the links of each robot.
    """

    def __init__(self, bodies: Mapping[str, Sequence[str]], bases: Mapping[str, Array]) -> None:
        """Prepare for robots with the base poses T_world_base (4, 4)."""
        self.bodies = {n: tuple(names) for n, names in bodies.items()}
        self._T_base_world = {n: spatial.inverse(bases[n]) for n in bodies}
        self._sevens: dict[str, Array] = {}

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return tuple(f"{robot}/{name}" for robot, names in self.bodies.items() for name in names)

    def look(self, links: Mapping[str, Mapping[str, Array]]) -> None:
        """Set the poses T_world_link (4, 4) of all robots."""
        drawn = [self._T_base_world[n] @ np.stack([links[n][b] for b in names]) for n, names in self.bodies.items()]
        counts = np.cumsum([len(Ts) for Ts in drawn])[:-1]
        for name, poses in zip(self.bodies, np.split(wire.sevens(np.concatenate(drawn)), counts), strict=True):
            self._sevens[name] = wire.near_signs(poses, self._sevens.get(name))

    def pack(self, name: str, seq: int, server_time: float, q: Array) -> bytes:
        """Return the part of a robot with joint values q (n,) in a scene's frame."""
        poses = self._sevens[name]
        return wire.pack(seq, server_time, 0.0, 0, wire.pack_body(poses, q, None), len(poses), len(q))
