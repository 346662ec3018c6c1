"""Send link poses to the browser as complete frames, including very small changes.

The setters of viser handles ignore changes below the tolerance of numpy.allclose (5 um at 0.5 m). Each setter also
sends a separate message, so that a browser may show links from two different frames together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from viser import _messages as messages

from twin.core.spatial import Array

if TYPE_CHECKING:
    import viser


class _Node:
    """Access to viser's internal data of one scene node: its pose messages, their queue, and the pose in the handle."""

    def __init__(self, handle: viser.SceneNodeHandle) -> None:
        self._state = handle._impl
        self._queue = self._state.api._queue_scene_message  # adds the owner and queues a message, like the setters
        # viser sends at most 128 messages at once; frames with more than 64 nodes would be split.
        self._state.api._websock_interface.get_message_buffer().max_window_size += 2

    @property
    def position(self) -> Array:
        """Position (3,) in m that was last queued for the clients."""
        return self._state.position

    @property
    def wxyz(self) -> Array:
        """Quaternion (4,), w first, that was last queued for the clients."""
        return self._state.wxyz

    def move(self, position: Array) -> None:
        """Queue a position (3,) in m for the clients; the handle keeps a reference to the array."""
        self._state.position = position
        self._queue(messages.SetPositionMessage(self._state.name, tuple(position.tolist())))

    def turn(self, wxyz: Array) -> None:
        """Queue a quaternion (4,), w first, for the clients; the handle keeps a reference to the array."""
        self._state.wxyz = wxyz
        self._queue(messages.SetOrientationMessage(self._state.name, tuple(wxyz.tolist())))


class FrameWriter:
    """Writer that sends the poses of many viser scene nodes as one frame.

    The nodes must belong to the server, not to a client. Only one thread may write at a time. If a client does not read
    a frame in time, the whole frame is dropped.
    """

    def __init__(self, server: viser.ViserServer, handles: Sequence[viser.SceneNodeHandle]) -> None:
        self._server = server
        self._nodes = [_Node(handle) for handle in handles]

    def write(self, positions: Array, wxyzs: Array) -> None:
        """Send positions (n, 3) in m and unit quaternions (n, 4), w first; both are in the frames of the parent nodes.

        A position or quaternion that is bit-identical to the last one of the same node is not sent again.
        """
        n = len(self._nodes)
        positions, wxyzs = np.array(positions, float), np.array(wxyzs, float)  # copied, as handles keep references
        if positions.shape != (n, 3) or wxyzs.shape != (n, 4):
            raise ValueError(
                f"poses of {n} nodes must be ({n}, 3) and ({n}, 4), not {positions.shape} and {wxyzs.shape}"
            )
        has_moved = _differ(positions, [node.position for node in self._nodes])
        turned = _differ(wxyzs, [node.wxyz for node in self._nodes])
        with self._server.atomic():  # no other update is sent in between
            for i, node in enumerate(self._nodes):
                if has_moved[i]:
                    node.move(positions[i])
                if turned[i]:
                    node.turn(wxyzs[i])
        self._server.flush()


def _differ(new: Array, old: list[Array]) -> list[bool]:
    """Return, for each row of `new` (n, m), whether at least one bit differs from the same row of `old`."""
    return (new.view(np.int64) != np.array(old, float).reshape(new.shape).view(np.int64)).any(axis=1).tolist()
