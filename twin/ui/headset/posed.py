"""Pack link poses of several robots for the stream; the signs of quaternions do not flip between two pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.ui.headset import protocol as wire


class Posed:
    """Link poses of several robots.

    Attributes:
        bodies: names of the links of each robot, by robot; in the order of the links in a frame.
    """

    def __init__(self, bodies: Mapping[str, Sequence[str]], bases: Mapping[str, Array]) -> None:
        """Set link names and base pose T_world_base (4, 4) of each robot; both mappings are by robot."""
        self.bodies = {n: tuple(names) for n, names in bodies.items()}
        self._T_base_world = {n: spatial.inverse(bases[n]) for n in bodies}
        self._sevens: dict[str, Array] = {}

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return tuple(f"{robot}/{name}" for robot, names in self.bodies.items() for name in names)

    def look(self, links: Mapping[str, Mapping[str, Array]]) -> None:
        """Store the link poses T_world_link (4, 4) of all robots, by robot and link."""
        drawn = [self._T_base_world[n] @ np.stack([links[n][b] for b in names]) for n, names in self.bodies.items()]
        counts = np.cumsum([len(Ts) for Ts in drawn])[:-1]
        for name, poses in zip(self.bodies, np.split(wire.sevens(np.concatenate(drawn)), counts), strict=True):
            self._sevens[name] = wire.near_signs(poses, self._sevens.get(name))

    def pack(self, name: str, seq: int, server_time: float, q: Array) -> bytes:
        """Return the part of a scene's frame for the robot `name` with the active joint values q (n,).

        `seq` is the number of the frame, `server_time` the time of the poses in s on the monotonic clock.
        """
        poses = self._sevens[name]
        return wire.pack(seq, server_time, 0.0, 0, wire.pack_body(poses, q, None), len(poses), len(q))
