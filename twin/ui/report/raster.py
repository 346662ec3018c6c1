"""Draw triangles as pixels, without graphics hardware: points on all triangles, the nearest one of a pixel is seen."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array

WIDTH, HEIGHT = 560, 460
"""Size of the picture in pixels."""

_FINE = 2
"""Each pixel is the mean of this number of points in each direction."""

_DENSITY = 2.0
"""Mean number of points of a triangle for each fine pixel that it covers."""

AHEAD = np.array([-1.0, 1.35, -0.55])
"""Viewing direction in the base frame, z up; the script of the page starts with the same one."""

_LIGHT = np.array([0.35, -0.5, 0.8])
_PAPER = 255
_MARK = (214, 40, 40)


def shaded(vertices: Array, triangles: np.ndarray, colors: np.ndarray, mark: Array | None) -> np.ndarray:
    """Return a picture (HEIGHT, WIDTH, 3) uint8 of triangles on white, seen along `AHEAD` without perspective.

    Args:
        vertices: (n, 3) in m, z up.
        triangles: (m, 3).
        colors: (m, 3) uint8, sRGB.
        mark: (3,) point with a ring around it, which nothing hides; None: no ring.
    """
    ahead = AHEAD / np.linalg.norm(AHEAD)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    width, height = WIDTH * _FINE, HEIGHT * _FINE
    flat = np.column_stack([vertices @ right, -(vertices @ up)])
    low = flat.min(axis=0)
    extent = np.ptp(flat, axis=0)
    scale = 0.94 * min(width / max(extent[0], 1e-9), height / max(extent[1], 1e-9))
    offset = 0.5 * (np.array([width, height]) - scale * extent) - scale * low
    places = scale * flat + offset
    depth = vertices @ ahead
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    brightness = 0.45 + 0.55 * np.abs(normals @ (_LIGHT / np.linalg.norm(_LIGHT))) / np.maximum(lengths, 1e-30)
    lit = np.clip(colors * brightness[:, None], 0, 255).astype(np.uint8)

    pa, pb, pc = (places[triangles[:, k]] for k in range(3))
    u, v = pb - pa, pc - pa
    area = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    counts = np.ceil(_DENSITY * area).astype(np.int64) + 1
    of_point = np.repeat(np.arange(len(triangles)), counts)
    number = np.arange(len(of_point)) - np.repeat(np.cumsum(counts) - counts, counts)
    # an additive recurrence with the plastic number covers each triangle evenly
    s = (0.5 + 0.7548776662466927 * number) % 1.0
    t = (0.5 + 0.5698402909980532 * number) % 1.0
    outside = s + t > 1.0
    s = np.where(outside, 1.0 - s, s)
    t = np.where(outside, 1.0 - t, t)
    spots = pa[of_point] + s[:, None] * u[of_point] + t[:, None] * v[of_point]
    x = np.clip(spots[:, 0].astype(np.int64), 0, width - 1)
    y = np.clip(spots[:, 1].astype(np.int64), 0, height - 1)
    corners = depth[triangles]
    z = corners[of_point, 0]
    z = z + s * (corners[of_point, 1] - corners[of_point, 0]) + t * (corners[of_point, 2] - corners[of_point, 0])
    pixels = np.full((height * width, 3), _PAPER, np.uint8)
    # far ones first, so that the nearest point of a pixel is written last
    order = np.argsort(-z, kind="stable")
    pixels[(y * width + x)[order]] = lit[of_point[order]]
    picture = pixels.reshape(height, width, 3)
    if mark is not None:
        at = scale * np.array([mark @ right, -(mark @ up)]) + offset
        rows, columns = np.mgrid[0:height, 0:width]
        distance = np.hypot(columns - at[0], rows - at[1])
        picture[(distance > 15 * _FINE) & (distance < 18 * _FINE)] = _MARK
    mean = picture.reshape(HEIGHT, _FINE, WIDTH, _FINE, 3).mean(axis=(1, 3))
    return mean.astype(np.uint8)
