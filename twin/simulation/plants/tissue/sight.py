"""Compute the fraction of a vessel that the endoscope sees: in the picture, and not behind an organ."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core.spatial import Array, Index


class Sight:
    """Computes what the endoscope sees; instruments are ignored, because they are thin and move."""

    def __init__(self, camera: Callable[[], Array], view: float) -> None:
        """Store `camera`, which returns T_world_camera (4, 4) with z along the view, and the angle of view in rad."""
        self._camera, self._view = camera, view

    def seen(self, points: Array, surfaces: Sequence[tuple[Array, Index]]) -> float:
        """Return the visible fraction of points (n, 3) in m; surfaces (vertices, triangles) hide points behind them."""
        T = self._camera()
        local = (points - T[:3, 3]) @ T[:3, :3]
        flat = np.abs(local[:, :2]).max(axis=1)
        visible = (local[:, 2] > 0) & (flat <= local[:, 2] * np.tan(self._view / 2))
        rays = points[visible] - T[:3, 3]
        blocked = np.zeros(len(rays), bool)
        for vertices, triangles in surfaces:
            blocked |= _blocked(T[:3, 3], rays, vertices, triangles)
        return float((visible.sum() - blocked.sum()) / len(points))


def _blocked(start: Array, rays: Array, vertices: Array, triangles: Index) -> np.ndarray:
    """Return (n,) bool: whether a triangle is between `start` (3,) and the end start + ray of each ray (n, 3).

    The method is that of T. Moeller and B. Trumbore (1997); quantities that are equal for all rays are computed once.
    """
    p, q, r = (vertices[triangles[:, k]] for k in range(3))
    e, g, s = q - p, r - p, start - p
    w = np.cross(s, e)
    det, u, v = rays @ np.cross(g, e).T, rays @ np.cross(g, s).T, rays @ w.T
    t = np.einsum("ij,ij->i", g, w)
    sign = np.sign(det)
    det, u, v, t = np.abs(det), u * sign, v * sign, t * sign
    return ((det > 0) & (u >= 0) & (v >= 0) & (u + v <= det) & (t > 0) & (t < det)).any(axis=1)
