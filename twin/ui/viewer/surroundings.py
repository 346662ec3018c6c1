"""The room around the robots of a page: light, floor, and the views from outside."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import viser

from twin.core.spatial import Array
from twin.core.units import DEG

OUTSIDE_FOV_DEG = 40
"""Vertical angle of view in deg of the camera in the views from outside."""

OUTSIDE_VIEWS = {
    "overview": np.array([1.0, -1.35, 0.6]),
    "front": np.array([1.5, 0.0, 0.1]),
    "top": np.array([0.0, -0.01, 1.5]),
}
"""Views from outside: vector (3,) from the middle of the scene to the camera, in units of the scene's size."""


def corners(box: Array) -> Array:
    """Return the corners (8, 3) of a box, given as (2, 3): lowest and highest corner."""
    return np.array(list(itertools.product(*np.transpose(box))))


def extent(boxes: Iterable[Array]) -> tuple[Array, Array, float]:
    """Return lowest corner (3,), middle (3,) and diagonal of the box around boxes (2, 3)."""
    points = np.concatenate([corners(box) for box in boxes])
    low = points.min(axis=0)
    high = points.max(axis=0)
    return low, 0.5 * (low + high), float(np.linalg.norm(high - low))


def furnish(server: viser.ViserServer, middle: Array, size: float, floor: float) -> viser.GridHandle:
    """Add light and floor, and set the first view; return the floor.

    Args:
        server: the server of viser.
        middle: middle (3,) of the scene in m in the world frame.
        size: diagonal of the scene in m.
        floor: height of the floor in m.
    """
    scene = server.scene
    scene.set_up_direction("+z")
    scene.configure_default_lights(False)
    scene.configure_environment_map("studio", environment_intensity=0.25)
    scene.add_light_directional("/light/key", intensity=1.7, position=(1.2, -0.9, 2.2), cast_shadow=True)
    scene.add_light_directional("/light/fill", intensity=0.45, position=(-0.8, 1.6, 0.7))
    cell = 0.1 if size > 0.4 else 0.02
    server.initial_camera.position = middle + size * OUTSIDE_VIEWS["overview"]
    server.initial_camera.look_at = middle
    server.initial_camera.fov = OUTSIDE_FOV_DEG * DEG
    return scene.add_grid(
        "/floor", 60 * cell, 60 * cell, cell_size=cell, section_size=5 * cell, position=(middle[0], middle[1], floor),
        cell_color=(205, 211, 219), section_color=(186, 194, 204), shadow_opacity=0.3,
        fade_distance=25 * cell, fade_from="origin",
    )  # fmt: skip
