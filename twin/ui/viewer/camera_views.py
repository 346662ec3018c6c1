"""The camera of the browsers: preset views from outside, along the shaft, and of endoscope and microscope."""

from __future__ import annotations

import numpy as np
import viser

from twin.core.spatial import Array
from twin.core.units import DEG
from twin.ui.viewer.front import Front
from twin.ui.viewer.surroundings import OUTSIDE_FOV_DEG, OUTSIDE_VIEWS

VIEWS = (*OUTSIDE_VIEWS, "along the shaft", "endoscope", "microscope")
"""Names of the preset views."""

ENDOSCOPE_FOV_DEG = 70
"""Vertical angle of view in deg of the camera in the endoscope view, as of a common laparoscope."""

_VERTICAL_COSINE = 0.9
"""Cosine of the angle between shaft and vertical above which the vertical is no upward direction beside the shaft."""


class CameraViews:
    """Preset views of the active robot. In the endoscope view, the handle (gizmo) at the tool is hidden.

    Attributes:
        middle: middle (3,) of the scene in m in the world frame.
        size: diagonal of the scene in m.
    """

    def __init__(self, front: Front, middle: Array, size: float) -> None:
        self._front = front
        self.middle = middle
        self.size = size
        self._is_gizmo_wanted = True
        self._is_endoscope_view = False

    def show_gizmo(self, visible: bool) -> None:
        """Show or hide the gizmo at the tool; it is always hidden in the endoscope view, which it would cover."""
        self._is_gizmo_wanted = visible
        self._front.gizmo.visible = visible and not self._is_endoscope_view

    def look(self, view: str, client: viser.ClientHandle | None) -> None:
        """Move the camera of a browser to a preset view; if `client` is None, move the cameras of all browsers."""
        clients = list(self._front.server.get_clients().values())
        if client is not None:
            clients = [client]
        eye, target, up = self.camera(view)
        is_endoscope_view = view == "endoscope"
        self._is_endoscope_view = is_endoscope_view
        self.show_gizmo(self._is_gizmo_wanted)
        fov_deg = ENDOSCOPE_FOV_DEG if is_endoscope_view else OUTSIDE_FOV_DEG
        for viewing_client in clients:
            with viewing_client.atomic():
                viewing_client.camera.up_direction = up
                viewing_client.camera.position = eye
                viewing_client.camera.look_at = target
                viewing_client.camera.fov = fov_deg * DEG
                viewing_client.camera.near = 0.001 if is_endoscope_view else 0.01

    def camera(self, view: str) -> tuple[Array, Array, Array]:
        """Return (camera position, target, up vector) of a preset view, each (3,) in m in the world frame."""
        robot = self._front.active
        node = self._front.nodes[robot.name]
        tip, axis = robot.movable.shaft()
        size = node.size * robot.scale
        up = np.array([0.0, 0.0, 1.0])
        if view in OUTSIDE_VIEWS:
            return self.middle + self.size * OUTSIDE_VIEWS[view], self.middle, up
        if view == "endoscope":
            lens, sight, above = (node.to_world(point) for point in robot.movable.camera())
            return lens, sight, (above - lens) / np.linalg.norm(above - lens)
        tip_world = node.to_world(tip)
        if view == "microscope":
            return tip_world + 0.25 * size * up + 0.05 * size * np.array([1.0, -1.0, 0]), tip_world, up
        along = node.to_world(tip + axis) - tip_world
        along /= np.linalg.norm(along)
        side = up
        # beside a vertical shaft, the vertical cannot be the upward direction of the picture
        if abs(along[2]) > _VERTICAL_COSINE:
            x_base = node.to_world(np.eye(3)[0]) - node.to_world(np.zeros(3))
            side = x_base / np.linalg.norm(x_base)
        return tip_world - 0.6 * size * along + 0.04 * size * side, tip_world, side
