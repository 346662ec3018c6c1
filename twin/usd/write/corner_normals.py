"""Normals at the corners of triangles: smooth over bores, with edges where faces meet at larger angles."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.core.units import DEG

CREASE = 30 * DEG
"""Angle in rad between two faces, below which their normals are averaged: bores look smooth, edges stay visible."""


def corner_normals(vertices: Array, triangles: np.ndarray, crease: float = CREASE) -> Array:
    """Return unit normals (3 m, 3), one per triangle corner, averaged over faces that meet at angles below `crease`.

    Triangles (m, 3) are indices of vertices (n, 3); normals are averaged only over faces that share a vertex. Angles
    are in rad. A GLB has the same normals as the stage.
    """
    triangles = np.asarray(triangles)
    corners = triangles.ravel()
    vertices = np.asarray(vertices, float)
    a = vertices[triangles[:, 0]]
    b = vertices[triangles[:, 1]]
    c = vertices[triangles[:, 2]]
    doubled_areas = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled_areas, axis=1, keepdims=True)
    x, y, z = (doubled_areas / np.where(length > 0, length, 1.0)).T
    corner, mate = _corner_pairs(corners, len(vertices))
    triangle = corner // 3
    mate_triangle = mate // 3
    cosine = x[triangle] * x[mate_triangle] + y[triangle] * y[mate_triangle] + z[triangle] * z[mate_triangle]
    # a face without area is smooth with no other, but a corner counts for itself
    is_smooth = (cosine >= np.cos(crease)) | (corner == mate)
    corner = corner[is_smooth]
    mate_triangle = mate_triangle[is_smooth]
    # weighted by area, because the cross products are not normalised
    total = np.zeros((len(corners), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(corner, doubled_areas[mate_triangle, axis], len(corners))
    size = np.linalg.norm(total, axis=1, keepdims=True)
    # A triangle without area has no normal; the arbitrary direction z avoids NaN.
    return np.where(size > 0, total / np.where(size > 0, size, 1.0), [0.0, 0.0, 1.0])


def _corner_pairs(corners: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return all ordered pairs (m,), (m,) of corners at one vertex, each corner also with itself.

    `corners` (k,) are the vertices of the corners, which are numbered from 0. The pairs are formed without a loop:
    each corner is repeated as often as its vertex has corners.
    """
    order = np.argsort(corners, kind="stable")
    count = np.bincount(corners, minlength=vertex_count)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])  # place in `order` of the first corner of each vertex
    vertex_of = corners[order]
    mates = count[vertex_of]
    start = np.concatenate([[0], np.cumsum(mates)[:-1]])  # row of the first pair of each corner
    corner = np.repeat(order, mates)
    offset = np.repeat(first[vertex_of] - start, mates)
    mate = order[offset + np.arange(len(corner))]
    return corner, mate
