"""A translucent disc at the tool where a limit stops a drag, across the closed way."""

from __future__ import annotations

import numpy as np
import viser

from twin.core import spatial
from twin.core.spatial import Array

_COLOR = (222, 48, 48)
_DISC_CORNERS = 48

MIN_DISTANCE = 5e-4
"""Minimum distance in m between hand and tool; a smaller one has no visible direction."""


class LimitWall:
    """The disc in the scene; hidden until `show`."""

    def __init__(self, server: viser.ViserServer, radius: float) -> None:
        """Add the disc; `radius` is in m."""
        angles = 2 * np.pi * np.arange(_DISC_CORNERS) / _DISC_CORNERS
        rim = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_DISC_CORNERS)])
        vertices = np.vstack([np.zeros((1, 3)), rim])
        corner = np.arange(_DISC_CORNERS)
        faces = np.column_stack([np.zeros(_DISC_CORNERS, int), 1 + corner, 1 + (corner + 1) % _DISC_CORNERS])
        self._disc = server.scene.add_mesh_simple(
            "/wall", vertices, faces, color=_COLOR, opacity=0.3, side="double", cast_shadow=False, receive_shadow=False,
            visible=False,
        )  # fmt: skip

    def show(self, tool: Array, hand: Array) -> None:
        """Place the disc at the tool (3,), across the way to the hand (3,), both in m in the world frame."""
        offset = hand - tool
        distance = float(np.linalg.norm(offset))
        if distance < MIN_DISTANCE:
            self.hide()
            return
        z = offset / distance
        # any direction across z serves, because the disc is round
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
        R = spatial.frame_from_axes(z, x)[:3, :3]
        self._disc.position = tool
        self._disc.wxyz = spatial.quat_from_matrix_wxyz(R)
        self._disc.visible = True

    def hide(self) -> None:
        """Hide the disc."""
        if self._disc.visible:
            self._disc.visible = False
