"""Pack the vertices of a scene's deformables for the frames of a stream, and report the first error in a deformable."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.ui.headset.scene_frame import pack_field
from twin.ui.session.deformable_feed import Feed, FollowingFeed, vertices_of

_EMPTY_FIELD = pack_field(np.zeros((0, 3)))


class DeformablePackets:
    """Deformables (fields) of a scene, packed for frames; an error in a deformable does not stop the robots.

    Attributes:
        feed: source of the vertices; None: there are no deformables.
        packed: packed vertices of each field, in the order of the feed's surfaces.
        send: function that sends a document to all clients.
    """

    def __init__(self, feed: Feed | None) -> None:
        """Set the source of the vertices, and pack the vertices at time 0."""
        self.feed = feed
        self.packed: tuple[bytes, ...] = ()
        self._error = ""  # the first error, after which deformables follow no links
        self.send: Callable[[JsonObject], object] = lambda document: None
        self.at(0.0)

    @property
    def needs(self) -> Mapping[str, Sequence[str]]:
        """Names of the links that `follow` needs, by robot; empty if the deformables do not follow links."""
        if isinstance(self.feed, FollowingFeed) and not self._error:
            return self.feed.touching
        return {}

    def follow(self, links: Callable[[], Mapping[str, Mapping[str, Array]]], passed: float, t: float) -> None:
        """Deform, according to the present link poses, the deformables that follow links.

        Args:
            links: function that returns poses T_world_link (4, 4), by robot and link, at least of the links in `needs`.
            passed: time in s since the last call.
            t: time in s of the scene.
        """
        if not isinstance(self.feed, FollowingFeed) or self._error:
            return
        try:
            has_moved = self.feed.follow(links(), passed)
        except Exception as error:  # an error in deformables must not stop the robots
            self._report_first_error(error)
            return
        if has_moved:
            self.at(t)

    def at(self, t: float) -> None:
        """Pack the deformables at a time in s. A field with an error gets no vertices; the first error is reported."""
        if self.feed is None:
            return
        fields = dict.fromkeys(self.feed.surfaces, _EMPTY_FIELD)
        try:
            frame = self.feed.at(t)
            for name, surface in self.feed.surfaces.items():
                fields[name] = pack_field(vertices_of(frame, name, surface))
        except Exception as error:  # an error in deformables must not stop the robots
            self._report_first_error(error)
        self.packed = tuple(fields.values())

    def _report_first_error(self, error: Exception) -> None:
        """Report the first error in deformables."""
        if self._error:
            return
        self._error = f"{type(error).__name__}: {error}"
        if isinstance(error, TwinError):
            self._error = str(error)
        logging.getLogger(__name__).warning("deformables: %s", self._error)
        self.send({"type": "error", "code": "failed", "message": self._error[:500]})
