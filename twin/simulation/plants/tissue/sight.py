"""Compute the fraction of a vessel that the endoscope sees: in the picture, and not behind an organ."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core.spatial import Array, Index


class Sight:
    """Computes what the endoscope sees; instruments are ignored, because they are thin and move."""

    def __init__(self, camera: Callable[[], Array], view: float) -> None:
        """Store `camera`, which returns T_world_camera (4, 4) with z along the view, and the angle of view in rad."""
        self._camera = camera
        self._view = view

    def seen(self, points: Array, surfaces: Sequence[tuple[Array, Index]]) -> float:
        """Return the visible fraction of points (n, 3) in m; surfaces (vertices, triangles) hide points behind them."""
        T = self._camera()
        centre = T[:3, 3]
        local = (points - centre) @ T[:3, :3]
        depth = local[:, 2]
        off_axis = np.abs(local[:, :2]).max(axis=1)  # the picture is square
        in_picture = (depth > 0) & (off_axis <= depth * np.tan(self._view / 2))
        rays = points[in_picture] - centre
        blocked = np.zeros(len(rays), bool)
        for vertices, triangles in surfaces:
            blocked |= _blocked(centre, rays, vertices, triangles)
        return float((in_picture.sum() - blocked.sum()) / len(points))


def _blocked(start: Array, rays: Array, vertices: Array, triangles: Index) -> np.ndarray:
    """Return (n,) bool: whether a triangle is between `start` (3,) and the end start + ray of each ray (n, 3).

    The method is that of T. Moeller and B. Trumbore (1997); quantities that are equal for all rays are computed once.
    """
    p = vertices[triangles[:, 0]]
    first_edge = vertices[triangles[:, 1]] - p
    second_edge = vertices[triangles[:, 2]] - p
    from_p = start - p
    w = np.cross(from_p, first_edge)
    det = rays @ np.cross(second_edge, first_edge).T
    u = rays @ np.cross(second_edge, from_p).T
    v = rays @ w.T
    t = np.einsum("ij,ij->i", second_edge, w)
    # All four are multiplied by the determinant, which saves a division; its sign depends on the side of the triangle.
    sign = np.sign(det)
    det = np.abs(det)
    u = u * sign
    v = v * sign
    t = t * sign
    in_triangle = (u >= 0) & (v >= 0) & (u + v <= det)
    on_ray = (t > 0) & (t < det)
    return ((det > 0) & in_triangle & on_ray).any(axis=1)
