"""Pack link poses of several robots for the stream; the signs of quaternions do not flip between two pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.ui.headset import stream_frames as wire


class PosePacker:
    """Link poses of several robots.

    Attributes:
        bodies: names of the links of each robot, by robot; in the order of the links in a frame.
    """

    def __init__(self, bodies: Mapping[str, Sequence[str]], bases: Mapping[str, Array]) -> None:
        """Set link names and base pose T_world_base (4, 4) of each robot; both mappings are by robot."""
        self.bodies = {robot: tuple(names) for robot, names in bodies.items()}
        self._T_base_world = {robot: spatial.inverse(bases[robot]) for robot in bodies}
        self._sevens: dict[str, Array] = {}

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        links = []
        for robot, names in self.bodies.items():
            for name in names:
                links.append(f"{robot}/{name}")
        return tuple(links)

    def set_poses(self, links: Mapping[str, Mapping[str, Array]]) -> None:
        """Store the link poses T_world_link (4, 4) of all robots, by robot and link."""
        Ts_base_link = []
        for robot, names in self.bodies.items():
            Ts_world_link = np.stack([links[robot][name] for name in names])
            Ts_base_link.append(self._T_base_world[robot] @ Ts_world_link)
        # the poses of all robots are converted in one call, which is faster
        poses = wire.sevens(np.concatenate(Ts_base_link))
        first = 0
        for robot, names in self.bodies.items():
            last = first + len(names)
            self._sevens[robot] = wire.near_signs(poses[first:last], self._sevens.get(robot))
            first = last

    def pack(self, name: str, seq: int, server_time: float, q: Array) -> bytes:
        """Return the part of a scene's frame for the robot `name` with the active joint values q (n,).

        `seq` is the number of the frame, `server_time` the time of the poses in s on the monotonic clock.
        """
        poses = self._sevens[name]
        return wire.pack(seq, server_time, 0.0, 0, wire.pack_body(poses, q, None), len(poses), len(q))
