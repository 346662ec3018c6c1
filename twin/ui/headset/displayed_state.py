"""The state of a live robot that its clients see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonMapping
from twin.core.spatial import Array
from twin.ui.headset.stream_frames import near_signs, pose_of


@dataclass(frozen=True, eq=False)
class DisplayedState:
    """Poses and joint values that are sent to all clients, in double precision, in the base frame of the robot.

    A pose is seven numbers, as in the frames of the stream: x y z in m, quaternion x y z w.

    Attributes:
        poses: (links, 7) poses of the links.
        q: (joints,) active joint values in m or rad.
        ghost: (7,) the tool pose that the equations give, shown as a ghost; None without a ghost.
        reason: why the last request was refused; "" if it was not.
    """

    poses: Array
    q: Array
    ghost: Array | None = None
    reason: str = ""

    def continued_from(self, last: DisplayedState) -> DisplayedState:
        """Return this state with the sign of each quaternion that is nearer to that of the state displayed before.

        q and -q are the same rotation, but a client that interpolates between both would show a full turn.
        """
        ghost = self.ghost
        if ghost is not None and last.ghost is not None:
            ghost = near_signs(ghost[None], last.ghost[None])[0]
        return DisplayedState(near_signs(self.poses, last.poses), self.q, ghost, self.reason)

    def ghost_to_tool_distance(self, links: Sequence[str], tool: JsonMapping) -> float | None:
        """Return the distance in m between the origins of ghost and tool; None without a ghost.

        Args:
            links: names of the links, in the order of `poses`.
            tool: the entry `tool` of the robot's description: its link, and T_link_tool as seven numbers.
        """
        if self.ghost is None:
            return None
        T_base_tool = pose_of(self.poses[links.index(tool["link"])]) @ pose_of(tool["T_link_tool"])
        return float(np.linalg.norm(T_base_tool[:3, 3] - self.ghost[:3]))
