"""Draw triangles as pixels, without graphics hardware: points on all triangles, the nearest one of a pixel is seen."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from twin.core.spatial import Array

PICTURE_WIDTH, PICTURE_HEIGHT = 560, 460
"""Size of the picture in pixels."""

_SUPERSAMPLING = 2
"""Each pixel is the mean of this number of points in each direction."""

_POINTS_PER_PIXEL = 2.0
"""Mean number of points of a triangle for each fine pixel that it covers."""

_MAX_POINTS = 3e7
"""Maximum number of points of a picture; a picture that needs more has fewer fine pixels."""

_POINTS_PER_BATCH = 4_000_000
"""Number of points that are computed together."""

VIEW_DIRECTION = np.array([-1.0, 1.35, -0.55])
"""Viewing direction in the base frame, z up; the script of the page starts with the same one."""

_LAMP_DIRECTION = np.array([0.35, -0.5, 0.8])
"""Direction to the lamp in the base frame."""

_AMBIENT_BRIGHTNESS = 0.45
"""Brightness, as a share, of a triangle whose plane contains the direction to the lamp."""

_FILLED_SHARE = 0.94
"""Share of the picture that the robot fills in the direction in which it is larger."""

_RING_RADII = (15 * _SUPERSAMPLING, 18 * _SUPERSAMPLING)
"""Inner and outer radius of the ring around the mark, in fine pixels."""

_BACKGROUND_GREY = 255
_RING_COLOR = (214, 40, 40)


def shaded_picture(vertices: Array, triangles: np.ndarray, colors: np.ndarray, mark: Array | None) -> np.ndarray:
    """Return a picture of triangles on white, seen along `VIEW_DIRECTION` without perspective.

    The picture is (PICTURE_HEIGHT, PICTURE_WIDTH, 3) uint8, sRGB.

    Args:
        vertices: (n, 3) in m, z up.
        triangles: (m, 3).
        colors: (m, 3) uint8, sRGB.
        mark: (3,) point with a ring around it, which nothing hides; None: no ring.
    """
    ahead = VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    width = PICTURE_WIDTH * _SUPERSAMPLING
    height = PICTURE_HEIGHT * _SUPERSAMPLING
    # columns grow to the right, rows grow downwards
    flat = np.column_stack([vertices @ right, -(vertices @ up)])
    low = flat.min(axis=0)
    extent = np.ptp(flat, axis=0)
    pixels_per_metre = _FILLED_SHARE * min(width / max(extent[0], 1e-9), height / max(extent[1], 1e-9))
    offset = 0.5 * (np.array([width, height]) - pixels_per_metre * extent) - pixels_per_metre * low
    places = pixels_per_metre * flat + offset
    lit = _lit_colors(vertices, triangles, colors)

    # many large triangles one behind the other: a coarser picture, of which each pixel is still that of the nearest
    point_count = _POINTS_PER_PIXEL * float(np.sum(_areas(places, triangles)))
    coarseness = min(1.0, np.sqrt(_MAX_POINTS / max(point_count, 1.0)))
    columns = max(1, round(coarseness * width))
    rows = max(1, round(coarseness * height))
    coarse_places = places * [columns / width, rows / height]
    small = _fine_picture(coarse_places, vertices @ ahead, triangles, lit, (columns, rows))
    of_row = np.arange(height) * rows // height
    of_column = np.arange(width) * columns // width
    picture = small[of_row[:, None], of_column]
    if mark is not None:
        place = pixels_per_metre * np.array([mark @ right, -(mark @ up)]) + offset
        _draw_ring(picture, place)
    mean = picture.reshape(PICTURE_HEIGHT, _SUPERSAMPLING, PICTURE_WIDTH, _SUPERSAMPLING, 3).mean(axis=(1, 3))
    return mean.astype(np.uint8)


def _lit_colors(vertices: Array, triangles: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Return the colours (m, 3) uint8 of triangles under the lamp; both sides of a triangle are lit alike."""
    a = vertices[triangles[:, 0]]
    b = vertices[triangles[:, 1]]
    c = vertices[triangles[:, 2]]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    towards_lamp = np.abs(normals @ (_LAMP_DIRECTION / np.linalg.norm(_LAMP_DIRECTION)))
    # a triangle without area has no normal: it gets the ambient brightness
    brightness = _AMBIENT_BRIGHTNESS + (1 - _AMBIENT_BRIGHTNESS) * towards_lamp / np.maximum(lengths, 1e-30)
    return np.clip(colors * brightness[:, None], 0, 255).astype(np.uint8)


def _draw_ring(picture: np.ndarray, place: Array) -> None:
    """Draw the ring of the mark into a picture (rows, columns, 3); its place (2,) is column and row in fine pixels."""
    height, width, _ = picture.shape
    y, x = np.mgrid[0:height, 0:width]
    distance = np.hypot(x - place[0], y - place[1])
    inner, outer = _RING_RADII
    picture[(distance > inner) & (distance < outer)] = _RING_COLOR


def _areas(places: Array, triangles: np.ndarray) -> Array:
    """Return the area (m,) in square pixels of each triangle; `places` (n, 2) are the vertices in pixels."""
    corners = places[triangles[:, 0]]
    u = places[triangles[:, 1]] - corners
    v = places[triangles[:, 2]] - corners
    return 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _fine_picture(
    places: Array, depth: Array, triangles: np.ndarray, lit: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """Return a picture (height, width, 3) uint8 of triangles on white.

    Args:
        places: (n, 2) vertices in pixels: column, row.
        depth: (n,) distance of each vertex along the viewing direction.
        triangles: (m, 3).
        lit: (m, 3) uint8 colour of each triangle.
        size: (width, height) in pixels.
    """
    width, height = size
    counts = np.ceil(_POINTS_PER_PIXEL * _areas(places, triangles)).astype(np.int64) + 1
    pixels = np.full((height * width, 3), _BACKGROUND_GREY, np.uint8)
    nearest = np.full(height * width, np.inf)
    # as many triangles at a time as have `_POINTS_PER_BATCH` points, because each point takes about 100 bytes
    part = np.cumsum(counts) // _POINTS_PER_BATCH
    _, begins = np.unique(part, return_index=True)
    for begin, end in pairwise([*begins, len(triangles)]):
        of_point, spots, z = _points(places, depth, triangles[begin:end], counts[begin:end])
        x = np.clip(spots[:, 0].astype(np.int64), 0, width - 1)
        y = np.clip(spots[:, 1].astype(np.int64), 0, height - 1)
        pixel = y * width + x
        nearest_points = np.flatnonzero(z < nearest[pixel])
        # far ones first, so that the nearest point of a pixel is written last
        order = nearest_points[np.argsort(-z[nearest_points], kind="stable")]
        pixels[pixel[order]] = lit[begin + of_point[order]]
        nearest[pixel[order]] = z[order]
    return pixels.reshape(height, width, 3)


def _points(places: Array, depth: Array, triangles: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, Array, Array]:
    """Return (triangle (k,), place (k, 2) in pixels, depth (k,)) of points on triangles, `counts` (m,) on each one."""
    of_point = np.repeat(np.arange(len(triangles)), counts)
    first_of_triangle = np.cumsum(counts) - counts
    number = np.arange(len(of_point)) - np.repeat(first_of_triangle, counts)
    # an additive recurrence with the plastic number covers each triangle evenly
    s = (0.5 + 0.7548776662466927 * number) % 1.0
    t = (0.5 + 0.5698402909980532 * number) % 1.0
    outside = s + t > 1.0
    s = np.where(outside, 1.0 - s, s)
    t = np.where(outside, 1.0 - t, t)
    # barycentric interpolation: from corner a by s towards b, and by t towards c
    a = triangles[:, 0]
    b = triangles[:, 1]
    c = triangles[:, 2]
    along_ab = (places[b] - places[a])[of_point]
    along_ac = (places[c] - places[a])[of_point]
    spots = places[a][of_point] + s[:, None] * along_ab + t[:, None] * along_ac
    deeper_ab = (depth[b] - depth[a])[of_point]
    deeper_ac = (depth[c] - depth[a])[of_point]
    z = depth[a][of_point] + s * deeper_ab + t * deeper_ac
    return of_point, spots, z
