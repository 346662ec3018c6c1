"""Send link poses to the browser as complete frames, including very small moves.

The setters of a viser handle ignore changes that numpy.allclose calls equal (up to 5 um at 0.5 m), and send their
messages separately, so that a browser may show links of two different frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from viser import _messages as messages

from twin.core.spatial import Array

if TYPE_CHECKING:
    import viser


class _Node:
    """Access to internals of viser: pose messages, the queue of a scene, a handle's own copy of its pose."""

    def __init__(self, handle: viser.SceneNodeHandle) -> None:
        self._state: Any = handle._impl
        self._queue = self._state.api._queue_scene_message  # stamps the owner, then queues as the setters do
        # viser sends at most 128 messages at once: frames of more than 64 nodes would be split.
        self._state.api._websock_interface.get_message_buffer().max_window_size += 2

    @property
    def position(self) -> Array:
        """Position (3,) in m that clients have."""
        return self._state.position

    @property
    def wxyz(self) -> Array:
        """Quaternion (4,), w first, that clients have."""
        return self._state.wxyz

    def move(self, position: Array) -> None:
        """Queue a position (3,) in m; the handle keeps the array."""
        self._state.position = position
        self._queue(messages.SetPositionMessage(self._state.name, tuple(position.tolist())))

    def turn(self, wxyz: Array) -> None:
        """Queue a quaternion (4,), w first; the handle keeps the array."""
        self._state.wxyz = wxyz
        self._queue(messages.SetOrientationMessage(self._state.name, tuple(wxyz.tolist())))


class FrameWriter:
    """Writer that sends the poses of many viser scene nodes as one frame.

    The nodes belong to the server, not to one client; only one thread may write at a time. A frame that a client does
    not read in time is dropped completely.
    """

    def __init__(self, server: viser.ViserServer, handles: Sequence[viser.SceneNodeHandle]) -> None:
        self._server = server
        self._nodes = [_Node(handle) for handle in handles]

    def write(self, positions: Array, wxyzs: Array) -> None:
        """Show positions (n, 3) in m and unit quaternions (n, 4), w first, in the parents' frames.

        Values that are bit-identical to those of the clients are not sent again.
        """
        n = len(self._nodes)
        positions, wxyzs = np.array(positions, float), np.array(wxyzs, float)  # copies: the handles keep the rows
        if positions.shape != (n, 3) or wxyzs.shape != (n, 4):
            raise ValueError(f"poses of {n} nodes are ({n}, 3) and ({n}, 4), not {positions.shape} and {wxyzs.shape}")
        moved = _differ(positions, [node.position for node in self._nodes])
        turned = _differ(wxyzs, [node.wxyz for node in self._nodes])
        with self._server.atomic():  # an update cannot begin meanwhile
            for i, node in enumerate(self._nodes):
                if moved[i]:
                    node.move(positions[i])
                if turned[i]:
                    node.turn(wxyzs[i])
        self._server.flush()


def _differ(new: Array, old: list[Array]) -> list[bool]:
    """Return (n,) whether each row of `new` (n, m) differs in any bit from the same row of `old`."""
    return (new.view(np.int64) != np.array(old, float).reshape(new.shape).view(np.int64)).any(axis=1).tolist()
