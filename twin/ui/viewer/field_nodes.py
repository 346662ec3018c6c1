"""Deformables (fields) in the viewer: each field of the feed is a mesh whose vertices change with time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import viser

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import srgb
from twin.ui.session.deformable_feed import Feed, FollowingFeed, vertices_of


class FieldNodes:
    """Scene nodes of a feed's fields, below /fields; vertices are in m in the world frame.

    Attributes:
        broken: text of the newest error of the feed, in `follow` or in `show`; "" until there is one.
    """

    def __init__(self, server: viser.ViserServer, feed: Feed) -> None:
        self._server, self._feed = server, feed
        self._meshes: dict[str, viser.MeshHandle] = {}
        self.broken = ""
        self._error_shown = False  # whether `show` has returned the text of an error

    def follow(self, links: Callable[[str], Mapping[str, Array]], passed: float) -> bool:
        """Deform, according to the present link poses, the fields that follow links; return whether a vertex has moved.

        `links` returns the poses T_world_link (4, 4), by link, of the robot with the given name; `passed` is the time
        in s since the last call. After an error, whose text the next `show` returns, fields follow no links.
        """
        if not isinstance(self._feed, FollowingFeed) or self.broken:
            return False
        try:
            return self._feed.follow({robot: links(robot) for robot in self._feed.touching}, passed)
        except Exception as error:  # an error in deformables must not stop the page
            self.broken = f"{type(error).__name__}: {error}"
            return True

    def show(self, t: float) -> str:
        """Show all fields at a time in s; return the text of the first error once, otherwise "".

        The error may be one of `follow`. Fields without vertices are not drawn.
        """
        try:
            frame = self._feed.at(t)
        except Exception as error:  # an error in deformables must not stop the page
            self.broken = f"{type(error).__name__}: {error}"
            for handle in self._meshes.values():
                handle.visible = False
            return self._first_error()
        with self._server.atomic():
            for name, surface in self._feed.surfaces.items():
                try:
                    vertices = vertices_of(frame, name, surface).astype(np.float32)
                except TwinError as error:
                    self.broken = str(error)
                    if name in self._meshes:
                        self._meshes[name].visible = False
                    continue
                if name in self._meshes:
                    self._meshes[name].vertices = vertices
                    self._meshes[name].visible = True
                else:
                    red, green, blue = (round(255 * srgb(c)) for c in surface.color)
                    self._meshes[name] = self._server.scene.add_mesh_simple(
                        f"/fields/{name}", vertices, np.asarray(surface.triangles, np.uint32), color=(red, green, blue),
                        opacity=surface.opacity if surface.opacity < 1 else None, side="double",
                    )  # fmt: skip
        return self._first_error()

    def _first_error(self) -> str:
        """Return the text of an error if none was returned before, otherwise ""."""
        if self._error_shown or not self.broken:
            return ""
        self._error_shown = True
        return self.broken
