"""Which part of a vessel the endoscope sees: what is in the picture and not behind an organ."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core.spatial import Array, Index


class Sight:
    """The endoscope's view. Instruments are not in the way: they are thin and move."""

    def __init__(self, camera: Callable[[], Array], view: float) -> None:
        """`camera` returns T_world_camera (4, 4), z along the view; `view`: height of the picture as an angle in rad."""
        self._camera, self._view = camera, view

    def seen(self, points: Array, surfaces: Sequence[tuple[Array, Index]]) -> float:
        """Return the fraction of points (n, 3) in m that the camera sees past surfaces (vertices, triangles)."""
        T = self._camera()
        local = (points - T[:3, 3]) @ T[:3, :3]
        flat = np.abs(local[:, :2]).max(axis=1)
        visible = (local[:, 2] > 0) & (flat <= local[:, 2] * np.tan(self._view / 2))
        for k in np.flatnonzero(visible).tolist():
            visible[k] = not any(_blocked(T[:3, 3], points[k], v, f) for v, f in surfaces)
        return float(visible.mean())


def _blocked(a: Array, b: Array, vertices: Array, triangles: Index) -> bool:
    """Return whether the line from a to b (3,) passes a triangle (T. Moeller and B. Trumbore, 1997)."""
    p, q, r = (vertices[triangles[:, k]] for k in range(3))
    d, e, g = b - a, q - p, r - p
    h = np.cross(d, g)
    det = np.einsum("ij,ij->i", e, h)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = a - p
        u = np.einsum("ij,ij->i", s, h) / det
        w = np.cross(s, e)
        v = w @ d / det
        t = np.einsum("ij,ij->i", g, w) / det
        return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1)).any())
